/* SPDX-License-Identifier: Apache-2.0
 *
 * The store keeps volumes, sessions, saved views, presets, camera paths and a clock: records of
 * text (JSON), each of a kind and under an id. With a folder they also survive the daemon.
 *
 *   any thread                                    writer thread
 *   put, remove ──► table in memory ──(changed)──► one transaction ──► folder/splatd.db
 *   get, page   ◄──┘                                    └─► callers of srv_store_flush()
 *
 * While the daemon runs, the table is authoritative and the database follows it. So a thread waits
 * for the disk only if it asks to, and a disk that is full or fails stops nothing: changes stay
 * marked and are written again until that succeeds. If the database is deleted, replaced or written
 * by another program, the writer notices it before it confirms anything, or after check_ms, and
 * writes all records to a new one.
 *
 * A flushed change survives a crash of the daemon at any moment, and a crash of the machine if its
 * disk keeps what fsync() confirmed (SQLite, WAL, synchronous=FULL). Without a folder nothing is
 * written, and everything else is the same.
 *
 * All functions are thread-safe unless they say otherwise. The time of day is not used.
 */
#ifndef SRV_STORE_STORE_H
#define SRV_STORE_STORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/status.h"
#include "store/kind.h"

struct srv_store;
struct srv_page;

struct srv_store_options {
    const char *folder;      /* created with mode 0700 if missing; NULL = memory only */
    const char *vfs;         /* name of SQLite's file system layer; NULL = the default */
    double pause_ms;         /* between two writes that no flush waits for, ms */
    double retry_ms;         /* until a failed write is tried again, ms */
    double check_ms;         /* between two checks that the database is still there, ms */
    unsigned max[SRV_KINDS]; /* records per kind; 0 = no limit */
};

/* Opens the folder and reads its records. NULL: SP_ERR_MEMORY; or SP_ERR_IO, SP_ERR_FORMAT or
 * SP_ERR_UNSUPPORTED with the file in err->place and the remedy in err->text. Reasons: the folder
 * cannot be used or another daemon uses it; the database is damaged, belongs to another program or
 * to a newer version, or cannot be written. */
struct srv_store *srv_store_create(const struct srv_store_options *options, struct sp_error *err);
/* Starts the writer thread. It calls collect(user) before each write; collect() may put and remove,
 * and is the place for changes that are too frequent to be put one by one. False: not everything
 * could be put; then no flush is answered as durable, and the writer tries again. NULL = nothing to
 * collect. */
bool srv_store_start(struct srv_store *store, bool (*collect)(void *user), void *user,
                     struct sp_error *err);
/* Writes the remaining changes and ends the writer thread. Nothing is written afterwards. Call it
 * from one thread. */
void srv_store_stop(struct srv_store *store);
void srv_store_destroy(struct srv_store **store); /* stops first */

/* Stores a copy of `text` as the record of the id, and replaces an existing record. False, nothing
 * changed: SP_ERR_BUDGET (too many records of the kind), SP_ERR_MEMORY. */
bool srv_store_put(struct srv_store *store, enum srv_kind kind, const char *id, const char *text,
                   size_t size, struct sp_error *err);
struct srv_store_owner { /* an owner of records */
    /* prefix of the texts of this owner's records, and of no other records */
    const char *beginning;
    const char *name;
    unsigned most;   /* its quota of records; 0 = none */
    bool is_limited; /* without a quota: its share of the kind's limit is limited
                        (common/fair_share.h) */
};
/* Stores a new record of an owner. If a record with this id exists, it stays unchanged, and the
 * function succeeds. Errors as srv_store_put(), and SP_ERR_QUOTA: the owner has too many
 * records. */
bool srv_store_add(struct srv_store *store, enum srv_kind kind, const char *id, const char *text,
                   size_t size, const struct srv_store_owner *owner, struct sp_error *err);
/* False: there is no such record. */
bool srv_store_remove(struct srv_store *store, enum srv_kind kind, const char *id);
/* Returns a copy of the text with a NUL after it; malloc'ed, the caller's. `size` may be NULL.
 * NULL: SP_ERR_NOT_FOUND, SP_ERR_MEMORY, SP_ERR_IO (damaged). */
char *srv_store_get(struct srv_store *store, enum srv_kind kind, const char *id, size_t *size,
                    struct sp_error *err);
/* Like srv_store_get(), but also returns the text of a damaged record, so that its owner can be
 * read. */
char *srv_store_get_any(struct srv_store *store, enum srv_kind kind, const char *id, size_t *size,
                        struct sp_error *err);
/* Marks a record as damaged, and logs it: its text cannot be used, and `why` is the reason. The
 * record stays until it is put again or removed. Out of memory is only logged: it is not damage. */
void srv_store_damage(struct srv_store *store, enum srv_kind kind, const char *id,
                      const struct sp_error *why);
/* False with *err set if there is a damaged record of that id. */
bool srv_store_is_sound(struct srv_store *store, enum srv_kind kind, const char *id,
                        struct sp_error *err);
/* Returns all ids of a kind in the order in which they were first put: each with its NUL, and an
 * empty one at the end; malloc'ed, the caller's. NULL = out of memory. */
char *srv_store_ids(struct srv_store *store, enum srv_kind kind);

/* Offers the ids of all records of a kind whose texts begin with `beginning` to the page. Its items
 * are char[SRV_STORE_ID_MAX + 1]. */
void srv_store_page(struct srv_store *store, enum srv_kind kind, const char *beginning,
                    struct srv_page *page);

/* Tells the writer that collect() has something to store. Fast: call it for every change. */
void srv_store_nudge(struct srv_store *store);
/* Calls done() exactly once, on any thread, perhaps before this function returns. durable = true:
 * everything that was put or removed before this call, or that collect() puts, is on the disk.
 * durable = false: writing failed, or there is no folder. */
void srv_store_flush(struct srv_store *store, void (*done)(void *user, bool durable), void *user);

struct srv_store_status {
    bool has_folder;
    bool is_failing;             /* the last write failed, or collect() returned false */
    char reason[SP_ERROR_TEXT];  /* why, if is_failing; else empty */
    unsigned records[SRV_KINDS]; /* in memory */
    uint64_t bytes;              /* of their ids and texts */
    unsigned waiting;            /* changes that are not yet written */
    uint64_t writes, failures;   /* transactions so far */
    double write_ms;             /* duration of the last successful write */
};
void srv_store_status(struct srv_store *store, struct srv_store_status *status);

#endif
