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
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "sp/log.h"

enum { APPLICATION_ID = 0x53504c54 }; /* "SPLT" */

/* Step i brings layout i to layout i + 1. */
static const char *const layouts[] = {
    "CREATE TABLE record(kind TEXT NOT NULL, id TEXT NOT NULL, body TEXT NOT NULL,"
    " UNIQUE(kind, id));",
};
enum { LAYOUT = sizeof layouts / sizeof *layouts };

static const char *const kind_names[SRV_KINDS] = { "volume", "session", "view",
                                                   "preset", "path",    "clock" };

struct srv_database {
    int lock;
    char path[PATH_MAX];
    sqlite3 *sqlite;
    sqlite3_stmt *put, *remove;
};

/* What the code of SQLite means to whoever runs the daemon. */
static bool fail(const struct srv_database *d, const char *what, struct sp_error *err) {
    int code = sqlite3_errcode(d->sqlite);
    const char *text = sqlite3_errmsg(d->sqlite);
    switch (code & 0xff) {
    case SQLITE_NOTADB:
    case SQLITE_CORRUPT:
        return sp_fail(err, SP_ERR_FORMAT, d->path,
                       "the database is damaged (%s: %s); restore a copy, or move it away and "
                       "what was kept is lost",
                       what, text);
    case SQLITE_FULL:
        return sp_fail(err, SP_ERR_IO, d->path, "%s: the disk is full; make room", what);
    case SQLITE_READONLY:
    case SQLITE_CANTOPEN:
    case SQLITE_PERM:
        return sp_fail(err, SP_ERR_IO, d->path,
                       "%s: %s; the user of the daemon must be allowed to write the file and its "
                       "folder",
                       what, text);
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
        return sp_fail(err, SP_ERR_IO, d->path, "%s: another program keeps it locked", what);
    case SQLITE_NOMEM:
        return sp_fail(err, SP_ERR_MEMORY, d->path, "%s: no memory", what);
    default:
        return sp_fail(err, SP_ERR_IO, d->path, "%s: %s (error %d)", what, text,
                       sqlite3_extended_errcode(d->sqlite));
    }
}

static bool run(struct srv_database *d, const char *sql, const char *what, struct sp_error *err) {
    return sqlite3_exec(d->sqlite, sql, NULL, NULL, NULL) == SQLITE_OK || fail(d, what, err);
}

/* The first column of the first row. */
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

/* What was made in a folder is still there after the machine went down. */
static bool sync_folder(const char *folder, struct sp_error *err) {
    int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    bool ok = fd >= 0 && fsync(fd) == 0;
    if (!ok)
        sp_fail(err, SP_ERR_IO, folder, "cannot write this folder to the disk: %s",
                strerror(errno));
    if (fd >= 0)
        close(fd);
    return ok;
}

/* Is it there, and as a name in the folder above it on the disk? */
static bool make_folder(const char *folder, struct sp_error *err) {
    char above[PATH_MAX];
    if (mkdir(folder, 0700) != 0)
        return errno == EEXIST ||
               sp_fail(err, SP_ERR_IO, folder, "cannot make this folder for --state: %s",
                       strerror(errno));
    int size = snprintf(above, sizeof above, "%s/..", folder);
    return size >= (int)sizeof above || sync_folder(above, err); /* too long: told below */
}

/* One daemon a folder. The lock ends with the process, however that ends. */
static bool take_folder(struct srv_database *d, const char *folder, struct sp_error *err) {
    struct stat found;
    if (!make_folder(folder, err))
        return false;
    if (stat(folder, &found) != 0 || !S_ISDIR(found.st_mode))
        return sp_fail(err, SP_ERR_IO, folder, "cannot use this for --state: it is no folder");
    if (found.st_mode & 077)
        sp_log(SP_LOG_WARN, "state %s is open to other users (mode %03o): it holds tokens", folder,
               (unsigned)(found.st_mode & 0777));
    char path[PATH_MAX];
    if (snprintf(path, sizeof path, "%s/" SRV_DATABASE_LOCK, folder) >= (int)sizeof path ||
        snprintf(d->path, sizeof d->path, "%s/" SRV_DATABASE_NAME, folder) >= (int)sizeof d->path)
        return sp_fail(err, SP_ERR_INVALID, "--state", "the path is longer than %d bytes",
                       PATH_MAX - 1);
    d->lock = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (d->lock < 0)
        return sp_fail(err, SP_ERR_IO, path,
                       "cannot write in the folder of --state: %s; the user of the daemon must be "
                       "allowed to",
                       strerror(errno));
    if (flock(d->lock, LOCK_EX | LOCK_NB) != 0)
        return sp_fail(err, SP_ERR_IO, folder,
                       "another splatd keeps its state here; give each a --state of its own");
    return true;
}

/* Ours, and of which layout? Refuses what is not. */
static bool check(struct srv_database *d, int64_t *layout, struct sp_error *err) {
    int64_t application, objects;
    if (!ask(d, "PRAGMA application_id", &application, err) ||
        !ask(d, "PRAGMA user_version", layout, err) ||
        !ask(d, "SELECT count(*) FROM sqlite_schema", &objects, err))
        return false;
    if (application == 0 && *layout == 0 && objects == 0)
        return true; /* new */
    if (application != APPLICATION_ID || *layout < 1)
        return sp_fail(err, SP_ERR_FORMAT, d->path,
                       "this is the database of another program; give --state a folder of its own");
    if (*layout > LAYOUT)
        return sp_fail(err, SP_ERR_UNSUPPORTED, d->path,
                       "a newer splatd wrote this (layout %lld, this one knows %d); start that one",
                       (long long)*layout, LAYOUT);
    sqlite3_stmt *statement = NULL;
    bool ok =
        sqlite3_prepare_v2(d->sqlite, "PRAGMA quick_check(1)", -1, &statement, NULL) == SQLITE_OK &&
        sqlite3_step(statement) == SQLITE_ROW;
    const char *found = ok ? (const char *)sqlite3_column_text(statement, 0) : NULL;
    if (!found)
        fail(d, "cannot check", err);
    else if (strcmp(found, "ok") != 0)
        ok = sp_fail(err, SP_ERR_FORMAT, d->path,
                     "the database is damaged (%.200s); restore a copy, or move it away and what "
                     "was kept is lost",
                     found);
    sqlite3_finalize(statement);
    return ok && found;
}

/* SQLite answers with the mode that there is now, which need not be the one asked for. */
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
        sp_fail(err, SP_ERR_UNSUPPORTED, d->path,
                "the file system has no shared memory for SQLite (journal mode '%.16s', not WAL); "
                "give --state a folder on a local disk",
                mode);
    sqlite3_finalize(statement);
    return ok;
}

/* To the layout of today in one transaction, which also shows that writing works. */
static bool bring_up_to_date(struct srv_database *d, int64_t layout, struct sp_error *err) {
    char marks[96];
    snprintf(marks, sizeof marks, "PRAGMA application_id=%d;PRAGMA user_version=%d;",
             APPLICATION_ID, LAYOUT);
    bool ok = run(d, "BEGIN IMMEDIATE", "cannot write", err);
    for (int64_t i = layout; ok && i < LAYOUT; i++)
        ok = run(d, layouts[i], "cannot bring the layout up to date", err);
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

static bool open_file(struct srv_database *d, const char *vfs, struct sp_error *err) {
    int64_t layout = 0;
    int made = open(d->path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (made < 0)
        return sp_fail(err, SP_ERR_IO, d->path,
                       "cannot open the database: %s; the user of the daemon must be allowed to "
                       "write it",
                       strerror(errno));
    close(made);
    int flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_NOFOLLOW;
    int code = sqlite3_open_v2(d->path, &d->sqlite, flags, vfs);
    if (!d->sqlite)
        return sp_fail(err, SP_ERR_MEMORY, d->path, "no memory for the database");
    if (code != SQLITE_OK)
        return fail(d, "cannot open", err);
    sqlite3_busy_timeout(d->sqlite, 1000); /* somebody makes a copy */
    /* What lies in a foreign file shall not run here. */
    sqlite3_db_config(d->sqlite, SQLITE_DBCONFIG_DEFENSIVE, 1, NULL);
    sqlite3_db_config(d->sqlite, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, NULL);
    return check(d, &layout, err) && use_wal(d, err) &&
           run(d, "PRAGMA synchronous=FULL", "cannot write", err) &&
           bring_up_to_date(d, layout, err) &&
           prepare(d,
                   "INSERT INTO record(kind, id, body) VALUES(?1, ?2, ?3)"
                   " ON CONFLICT(kind, id) DO UPDATE SET body = excluded.body",
                   &d->put, err) &&
           prepare(d, "DELETE FROM record WHERE kind = ?1 AND id = ?2", &d->remove, err);
}

struct srv_database *srv_database_open(const char *folder, const char *vfs, struct sp_error *err) {
    struct srv_database *d = calloc(1, sizeof *d);
    if (!d) {
        sp_fail(err, SP_ERR_MEMORY, folder, "no memory for the database");
        return NULL;
    }
    d->lock = -1;
    if (!take_folder(d, folder, err) || !open_file(d, vfs, err) || !sync_folder(folder, err))
        srv_database_close(&d);
    return d;
}

void srv_database_close(struct srv_database **database) {
    struct srv_database *d = *database;
    *database = NULL;
    if (!d)
        return;
    sqlite3_finalize(d->put);
    sqlite3_finalize(d->remove);
    sqlite3_close(d->sqlite);
    if (d->lock >= 0)
        close(d->lock);
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
            if (kind == SRV_KINDS || strlen(id) > SRV_STORE_ID_MAX)
                sp_log(SP_LOG_WARN, "%s: a record of kind '%.32s' is not known here", d->path,
                       kind_name);
            else if (!srv_table_put(table, kind, id, body,
                                    (size_t)sqlite3_column_bytes(statement, 2), false))
                break;
        }
    }
    bool ok = step == SQLITE_DONE;
    if (step == SQLITE_ROW)
        sp_fail(err, SP_ERR_MEMORY, d->path, "no memory for what was kept");
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

/* Ends what a failed write left open. That can fail as well: without memory it stays for later. */
static void roll_back(struct srv_database *d) {
    if (!sqlite3_get_autocommit(d->sqlite))
        sqlite3_exec(d->sqlite, "ROLLBACK", NULL, NULL, NULL);
}

bool srv_database_write(struct srv_database *d, const struct srv_change *changes,
                        struct sp_error *err) {
    roll_back(d);
    bool ok = run(d, "BEGIN IMMEDIATE", "cannot write", err);
    for (const struct srv_change *c = changes; ok && c; c = c->next)
        ok = write_one(d, c, err);
    ok = ok && run(d, "COMMIT", "cannot write", err);
    if (!ok)
        roll_back(d);
    return ok;
}
