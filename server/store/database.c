/* SPDX-License-Identifier: Apache-2.0 */
#include "store/database.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "sp/log.h"
#include "store/database_files.h"

enum { APPLICATION_ID = 0x53504c54 }; /* "SPLT" */

/* Step i upgrades schema i to schema i + 1. */
static const char *const schemas[] = {
    "CREATE TABLE record(kind TEXT NOT NULL, id TEXT NOT NULL, body TEXT NOT NULL,"
    " UNIQUE(kind, id));",
};
enum { SCHEMA = sizeof schemas / sizeof *schemas };

static const char *const kind_names[SRV_KINDS] = { "volume", "session", "view",
                                                   "preset", "path",    "clock" };

struct srv_database {
    struct srv_database_files files;
    const char *vfs;
    sqlite3 *sqlite; /* NULL = not open: srv_database_rewrite() failed */
    sqlite3_stmt *put, *remove;
    int64_t version; /* PRAGMA data_version: another one = another program has written */
};

/* Translates SQLite's error code into an error with a remedy for the administrator. */
static bool fail(const struct srv_database *d, const char *what, struct sp_error *err) {
    int code = sqlite3_errcode(d->sqlite);
    const char *text = sqlite3_errmsg(d->sqlite);
    switch (code & 0xff) {
    case SQLITE_ERROR: /* a table or a column is missing */
    case SQLITE_NOTADB:
    case SQLITE_CORRUPT:
        return sp_fail(err, SP_ERR_FORMAT, d->files.path,
                       "the database is damaged (%s: %s); restore a copy, or move the file "
                       "away and lose its contents",
                       what, text);
    case SQLITE_FULL:
        return sp_fail(err, SP_ERR_IO, d->files.path, "%s: the disk is full; free some space",
                       what);
    case SQLITE_READONLY:
    case SQLITE_CANTOPEN:
    case SQLITE_PERM:
        return sp_fail(err, SP_ERR_IO, d->files.path,
                       "%s: %s; the daemon's user needs write access to the file and its folder",
                       what, text);
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
        return sp_fail(err, SP_ERR_IO, d->files.path, "%s: another program has locked it", what);
    case SQLITE_NOMEM:
        return sp_fail(err, SP_ERR_MEMORY, d->files.path, "%s: out of memory", what);
    default:
        return sp_fail(err, SP_ERR_IO, d->files.path, "%s: %s (error %d)", what, text,
                       sqlite3_extended_errcode(d->sqlite));
    }
}

static bool run(struct srv_database *d, const char *sql, const char *what, struct sp_error *err) {
    return sqlite3_exec(d->sqlite, sql, NULL, NULL, NULL) == SQLITE_OK || fail(d, what, err);
}

/* Reads the first column of the first row. */
static bool ask(struct srv_database *d, const char *sql, int64_t *value, struct sp_error *err) {
    sqlite3_stmt *statement = NULL;
    bool ok = sqlite3_prepare_v2(d->sqlite, sql, -1, &statement, NULL) == SQLITE_OK &&
              sqlite3_step(statement) == SQLITE_ROW;
    if (ok)
        *value = sqlite3_column_int64(statement, 0);
    else
        fail(d, "cannot read", err);
    sqlite3_finalize(statement);
    return ok;
}

/* Creates the folder if it is missing, and syncs its parent folder. */
static bool make_folder(const char *folder, struct sp_error *err) {
    char above[PATH_MAX];
    if (mkdir(folder, 0700) != 0)
        return errno == EEXIST ||
               sp_fail(err, SP_ERR_IO, folder, "cannot create this folder for --state: %s",
                       strerror(errno));
    int size = snprintf(above, sizeof above, "%s/..", folder);
    return size >= (int)sizeof above ||
           srv_database_files_sync(above, err); /* lock_folder() reports a path that is too long */
}

/* Locks the folder for this daemon, and creates it if it is missing. */
static bool lock_folder(struct srv_database *d, const char *folder, struct sp_error *err) {
    struct stat found;
    if (!make_folder(folder, err))
        return false;
    if (stat(folder, &found) != 0 || !S_ISDIR(found.st_mode))
        return sp_fail(err, SP_ERR_IO, folder, "cannot use this for --state: it is not a folder");
    if (found.st_mode & 077)
        sp_log(SP_LOG_WARN, "state %s is open to other users (mode %03o), but it contains tokens",
               folder, (unsigned)(found.st_mode & 0777));
    return srv_database_files_open(&d->files, folder, err);
}

/* Only commits of other connections change it. */
static bool read_version(struct srv_database *d, int64_t *version, struct sp_error *err) {
    return ask(d, "PRAGMA data_version", version, err);
}

/* Reads the version of the schema. Refuses a file that is damaged, newer, or not ours. */
static bool check(struct srv_database *d, int64_t *schema, struct sp_error *err) {
    int64_t application, objects;
    if (!ask(d, "PRAGMA application_id", &application, err) ||
        !ask(d, "PRAGMA user_version", schema, err) ||
        !ask(d, "SELECT count(*) FROM sqlite_schema", &objects, err))
        return false;
    if (application == 0 && *schema == 0 && objects == 0)
        return true; /* new */
    if (application != APPLICATION_ID || *schema < 1)
        return sp_fail(err, SP_ERR_FORMAT, d->files.path,
                       "this database belongs to another program; give --state its own folder");
    if (*schema > SCHEMA)
        return sp_fail(err, SP_ERR_UNSUPPORTED, d->files.path,
                       "a newer splatd wrote this database (schema %lld; this version knows %d); "
                       "start that version",
                       (long long)*schema, SCHEMA);
    sqlite3_stmt *statement = NULL;
    bool ok =
        sqlite3_prepare_v2(d->sqlite, "PRAGMA quick_check(1)", -1, &statement, NULL) == SQLITE_OK &&
        sqlite3_step(statement) == SQLITE_ROW;
    const char *found = ok ? (const char *)sqlite3_column_text(statement, 0) : NULL;
    if (!found)
        fail(d, "cannot check", err);
    else if (strcmp(found, "ok") != 0)
        ok = sp_fail(err, SP_ERR_FORMAT, d->files.path,
                     "the database is damaged (%.200s); restore a copy, or move the file away "
                     "and lose its contents",
                     found);
    sqlite3_finalize(statement);
    return ok && found;
}

/* Switches to WAL. SQLite answers with the mode in effect, which may be another one. */
static bool use_wal(struct srv_database *d, struct sp_error *err) {
    sqlite3_stmt *statement = NULL;
    const char *mode = NULL;
    if (sqlite3_prepare_v2(d->sqlite, "PRAGMA journal_mode=WAL", -1, &statement, NULL) ==
            SQLITE_OK &&
        sqlite3_step(statement) == SQLITE_ROW)
        mode = (const char *)sqlite3_column_text(statement, 0);
    bool ok = mode && strcmp(mode, "wal") == 0;
    if (!mode)
        fail(d, "cannot write", err);
    else if (!ok)
        sp_fail(err, SP_ERR_UNSUPPORTED, d->files.path,
                "the file system does not support SQLite's WAL mode (got '%.16s'); give --state a "
                "folder on a local disk",
                mode);
    sqlite3_finalize(statement);
    return ok;
}

/* Upgrades the schema in one transaction, which also proves that writing works. */
static bool upgrade(struct srv_database *d, int64_t schema, struct sp_error *err) {
    char marks[96];
    snprintf(marks, sizeof marks, "PRAGMA application_id=%d;PRAGMA user_version=%d;",
             APPLICATION_ID, SCHEMA);
    bool ok = run(d, "BEGIN IMMEDIATE", "cannot write", err);
    for (int64_t i = schema; ok && i < SCHEMA; i++)
        ok = run(d, schemas[i], "cannot upgrade the schema", err);
    ok = ok && run(d, marks, "cannot write", err) && run(d, "COMMIT", "cannot write", err);
    if (!ok)
        sqlite3_exec(d->sqlite, "ROLLBACK", NULL, NULL, NULL);
    return ok;
}

static bool prepare(struct srv_database *d, const char *sql, sqlite3_stmt **statement,
                    struct sp_error *err) {
    return sqlite3_prepare_v3(d->sqlite, sql, -1, SQLITE_PREPARE_PERSISTENT, statement, NULL) ==
               SQLITE_OK ||
           fail(d, "cannot use", err);
}

static bool prepare_statements(struct srv_database *d, struct sp_error *err) {
    return prepare(d,
                   "INSERT INTO record(kind, id, body) VALUES(?1, ?2, ?3)"
                   " ON CONFLICT(kind, id) DO UPDATE SET body = excluded.body",
                   &d->put, err) &&
           prepare(d, "DELETE FROM record WHERE kind = ?1 AND id = ?2", &d->remove, err);
}

/* Opens the file, which is created if it is missing, with flags for open(2). */
static bool connect(struct srv_database *d, int creation, struct sp_error *err) {
    int made = open(d->files.path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | creation, 0600);
    if (made < 0)
        return sp_fail(err, SP_ERR_IO, d->files.path,
                       "cannot open the database: %s; the daemon's user needs write access",
                       strerror(errno));
    close(made);
    int flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_NOFOLLOW;
    int code = sqlite3_open_v2(d->files.path, &d->sqlite, flags, d->vfs);
    if (!d->sqlite)
        return sp_fail(err, SP_ERR_MEMORY, d->files.path,
                       "out of memory while opening the database");
    if (code != SQLITE_OK)
        return fail(d, "cannot open", err);
    sqlite3_busy_timeout(d->sqlite, 1000); /* another program may be making a copy */
    /* Do not run code from a prepared file (triggers, views). */
    sqlite3_db_config(d->sqlite, SQLITE_DBCONFIG_DEFENSIVE, 1, NULL);
    sqlite3_db_config(d->sqlite, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, NULL);
    return run(d, "PRAGMA synchronous=FULL", "cannot write", err);
}

static bool open_file(struct srv_database *d, struct sp_error *err) {
    int64_t schema = 0;
    if (!connect(d, 0, err) || !check(d, &schema, err) || !use_wal(d, err) ||
        !upgrade(d, schema, err) || !prepare_statements(d, err) ||
        !srv_database_files_sync(d->files.folder, err) || !read_version(d, &d->version, err))
        return false;
    srv_database_files_note(&d->files);
    srv_database_files_set_used(&d->files);
    if (schema == 0 && d->files.was_used)
        sp_log(
            SP_LOG_ERROR,
            "%s is new and empty, but there was a database before: its volumes, sessions, views, "
            "presets and camera paths are not known any more. To have them back, stop the daemon "
            "and put a copy of " SRV_DATABASE_NAME " here",
            d->files.path);
    d->files.was_used = false; /* said once */
    return true;
}

struct srv_database *srv_database_open(const char *folder, const char *vfs, struct sp_error *err) {
    struct srv_database *d = calloc(1, sizeof *d);
    if (!d) {
        sp_fail(err, SP_ERR_MEMORY, folder, "out of memory while opening the database");
        return NULL;
    }
    d->files.lock = -1;
    d->vfs = vfs;
    if (!lock_folder(d, folder, err) || !open_file(d, err))
        srv_database_close(&d);
    return d;
}

static void disconnect(struct srv_database *d) {
    sqlite3_finalize(d->put);
    sqlite3_finalize(d->remove);
    sqlite3_close(d->sqlite);
    d->put = d->remove = NULL;
    d->sqlite = NULL;
}

/* Ends the connection, but writes nothing into the file, which may not be ours any more. */
static void abandon(struct srv_database *d) {
    if (d->sqlite)
        sqlite3_db_config(d->sqlite, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, NULL);
    disconnect(d);
}

void srv_database_close(struct srv_database **database) {
    struct srv_database *d = *database;
    *database = NULL;
    if (!d)
        return;
    if (d->files.main.ino && srv_database_files_changed(&d->files, false))
        abandon(d);
    else
        disconnect(d);
    srv_database_files_close(&d->files);
    free(d);
}

static enum srv_kind kind_from(const char *name) {
    int kind = 0;
    while (kind < SRV_KINDS && strcmp(kind_names[kind], name) != 0)
        kind++;
    return (enum srv_kind)kind;
}

bool srv_database_read(struct srv_database *d, struct srv_table *table, struct sp_error *err) {
    sqlite3_stmt *statement = NULL;
    int step = SQLITE_ERROR;
    if (sqlite3_prepare_v2(d->sqlite, "SELECT kind, id, body FROM record ORDER BY rowid", -1,
                           &statement, NULL) == SQLITE_OK) {
        while ((step = sqlite3_step(statement)) == SQLITE_ROW) {
            const char *kind_name = (const char *)sqlite3_column_text(statement, 0);
            const char *id = (const char *)sqlite3_column_text(statement, 1);
            const char *body = (const char *)sqlite3_column_text(statement, 2);
            if (!kind_name || !id || !body)
                break;
            enum srv_kind kind = kind_from(kind_name);
            if (kind == SRV_KINDS || strlen(id) > SRV_STORE_ID_MAX || !*id)
                sp_log(
                    SP_LOG_ERROR,
                    "%s: a record is damaged and ignored: the kind '%.32s' or the id '%.140s' is "
                    "not valid",
                    d->files.path, kind_name, id);
            else if (!srv_table_put(table, kind, id, body,
                                    (size_t)sqlite3_column_bytes(statement, 2), false))
                break;
        }
    }
    bool ok = step == SQLITE_DONE;
    if (step == SQLITE_ROW)
        sp_fail(err, SP_ERR_MEMORY, d->files.path, "out of memory while reading the records");
    else if (!ok)
        fail(d, "cannot read", err);
    sqlite3_finalize(statement);
    return ok;
}

static bool write_one(struct srv_database *d, const struct srv_change *c, struct sp_error *err) {
    sqlite3_stmt *statement = c->text ? d->put : d->remove;
    bool ok =
        sqlite3_bind_text(statement, 1, kind_names[c->kind], -1, SQLITE_STATIC) == SQLITE_OK &&
        sqlite3_bind_text(statement, 2, c->id, -1, SQLITE_STATIC) == SQLITE_OK &&
        (!c->text || sqlite3_bind_text64(statement, 3, c->text, c->size, SQLITE_STATIC,
                                         SQLITE_UTF8) == SQLITE_OK) &&
        sqlite3_step(statement) == SQLITE_DONE;
    if (!ok)
        fail(d, "cannot write", err);
    sqlite3_reset(statement);
    sqlite3_clear_bindings(statement);
    return ok;
}

/* Rolls back a transaction that a failed write left open. If that fails too, for want of memory,
 * the next write tries again. */
static void roll_back(struct srv_database *d) {
    if (!sqlite3_get_autocommit(d->sqlite))
        sqlite3_exec(d->sqlite, "ROLLBACK", NULL, NULL, NULL);
}

static bool begin(struct srv_database *d, struct sp_error *err) {
    roll_back(d);
    return run(d, "BEGIN IMMEDIATE", "cannot write", err);
}

/* Ends the transaction. */
static bool commit(struct srv_database *d, const struct srv_change *changes, struct sp_error *err) {
    bool ok = true;
    for (const struct srv_change *c = changes; ok && c; c = c->next)
        ok = write_one(d, c, err);
    ok = ok && run(d, "COMMIT", "cannot write", err);
    if (!ok)
        roll_back(d);
    return ok;
}

/* Returns how the database was changed, a constant; NULL = only by this daemon, as far as it can be
 * read. */
static const char *changed(struct srv_database *d) {
    int64_t version = d->version;
    const char *how = srv_database_files_changed(&d->files, false);
    if (!how && read_version(d, &version, NULL) && version != d->version)
        how = SRV_DATABASE_FOREIGN;
    return how;
}

bool srv_database_is_intact(struct srv_database *d) {
    return d->sqlite && !changed(d) && srv_database_files_hold(&d->files, NULL);
}

static bool fail_changed(const struct srv_database *d, const char *how, struct sp_error *err) {
    return sp_fail(err, SP_ERR_IO, d->files.path,
                   "the database %s during a write; writing all records to a new one", how);
}

bool srv_database_write(struct srv_database *d, const struct srv_change *changes,
                        struct sp_error *err) {
    int64_t version = d->version;
    if (!begin(d, err))
        return false;
    /* No other program can write by SQLite now. */
    if (!read_version(d, &version, err) || version != d->version) {
        roll_back(d);
        return version == d->version ? false : fail_changed(d, SRV_DATABASE_FOREIGN, err);
    }
    const bool ok = commit(d, changes, err);
    const char *how = srv_database_files_changed(&d->files, true);
    if (ok && how)
        return fail_changed(d, how, err);
    if (ok)
        srv_database_files_note(&d->files);
    else if (!how)
        srv_database_files_note_log(&d->files);
    return ok;
}

/* Writes a complete database beside the old one. */
static bool write_fresh(const struct srv_database *d, const char *path,
                        const struct srv_change *changes, struct sp_error *err) {
    struct srv_database *fresh = calloc(1, sizeof *fresh);
    char journal[PATH_MAX];
    if (!fresh)
        return sp_fail(err, SP_ERR_MEMORY, path, "out of memory while writing the database");
    snprintf(fresh->files.path, sizeof fresh->files.path, "%s", path);
    fresh->vfs = d->vfs;
    unlink(path); /* of an earlier attempt */
    if (snprintf(journal, sizeof journal, "%s-journal", path) < (int)sizeof journal)
        unlink(journal);
    bool ok = connect(fresh, O_EXCL, err) && upgrade(fresh, 0, err) &&
              prepare_statements(fresh, err) && begin(fresh, err) && commit(fresh, changes, err);
    disconnect(fresh);
    free(fresh);
    if (!ok)
        unlink(path);
    return ok;
}

static void log_rewrite(const struct srv_database *d, const char *how, const char *kept) {
    if (*kept)
        sp_log(SP_LOG_ERROR,
               "%s %s while the daemon ran; writing all records to a new one. The file that was "
               "found there is now %s; to use it, stop the daemon and rename it back",
               d->files.path, how, kept);
    else
        sp_log(SP_LOG_ERROR,
               "%s %s while the daemon ran; writing all records to a new one. Stop the daemon "
               "before you touch its files",
               d->files.path, how);
}

bool srv_database_rewrite(struct srv_database *d, const struct srv_change *records,
                          struct sp_error *err) {
    char fresh[PATH_MAX], kept[PATH_MAX];
    const char *how = d->sqlite ? changed(d) : srv_database_files_changed(&d->files, false);
    if (!srv_database_files_hold(&d->files, err))
        return false;
    if (snprintf(fresh, sizeof fresh, "%s.new", d->files.path) >= (int)sizeof fresh)
        return sp_fail(err, SP_ERR_INVALID, "--state", "the path is too long");
    if (!write_fresh(d, fresh, records, err))
        return false;
    abandon(d);
    bool ok = srv_database_files_replace(&d->files, fresh, kept, err);
    if (ok && how)
        log_rewrite(d, how, kept);
    if (ok && open_file(d, err))
        return true;
    abandon(d);
    if (ok) /* opening may have written before it failed */
        srv_database_files_note(&d->files);
    return false;
}
