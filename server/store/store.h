/* SPDX-License-Identifier: Apache-2.0
 *
 * What outlives the request that made it, and with a folder also the daemon: volumes, sessions,
 * kept views, presets, camera paths and a clock, each a text (JSON) of some kind under an id.
 *
 *   any thread                                    writer thread
 *   put, remove ──► table in memory ──(changed)──► one transaction ──► folder/splatd.db
 *   get, each   ◄──┘                                    └─► whoever waits in srv_store_flush()
 *
 * The table is the truth while the daemon runs; the database follows it. So nobody waits for the
 * disk who does not ask to, and a disk that is full or gone stops nothing: what changed stays
 * marked as changed and is tried again until it is written.
 *
 * What has been flushed survives a crash of the daemon at any moment, and of the machine as far as
 * its disk keeps what fsync() confirmed (SQLite, WAL, synchronous=FULL). Without a folder nothing
 * is written, and all else is the same.
 *
 * All functions are thread-safe unless they say otherwise. No time of day is used.
 */
#ifndef SRV_STORE_STORE_H
#define SRV_STORE_STORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/status.h"

struct srv_store;

enum srv_kind {
    SRV_KIND_VOLUME,
    SRV_KIND_SESSION,
    SRV_KIND_VIEW,
    SRV_KIND_PRESET,
    SRV_KIND_PATH,
    SRV_KIND_CLOCK,
    SRV_KINDS
};
enum { SRV_STORE_ID_MAX = 127 }; /* bytes of an id */

struct srv_store_options {
    const char *folder;      /* made with mode 0700 if it is not there; NULL = keep nothing */
    const char *vfs;         /* SQLite's way to the disk; NULL = the system's */
    double pause_ms;         /* between two writes that nobody waits for */
    double retry_ms;         /* after a write that failed */
    unsigned max[SRV_KINDS]; /* records of a kind; 0 = no limit */
};

/* Reads what was kept. SP_ERR_IO, SP_ERR_FORMAT or SP_ERR_UNSUPPORTED with the file in err->place
 * and what to do: the folder cannot be used or is used by another daemon, the database is damaged,
 * of another program or of a newer version, or cannot be written. */
struct srv_store *srv_store_create(const struct srv_store_options *options, struct sp_error *err);
/* Starts the writer. Before each write it calls collect(user), which may put and remove: there
 * belongs what changes too often to be put each time. False: not all of it could be put; then
 * nobody is told that it is durable, and it is tried again. NULL = nothing to collect. */
bool srv_store_start(struct srv_store *store, bool (*collect)(void *user), void *user,
                     struct sp_error *err);
/* Writes what is left and ends the writer. Nothing is written from then on. Call it from one
 * thread. */
void srv_store_stop(struct srv_store *store);
void srv_store_destroy(struct srv_store **store); /* stops first; accepts NULL; nulls */

/* Keeps a copy of `text` in place of what was there. SP_ERR_BUDGET (too many of that kind),
 * SP_ERR_MEMORY: nothing has changed. */
bool srv_store_put(struct srv_store *store, enum srv_kind kind, const char *id, const char *text,
                   size_t size, struct sp_error *err);
struct srv_store_share {      /* of a kind's records, those of one owner */
    const char *beginning;    /* of their texts, and of nobody else's */
    unsigned most;            /* of them; 0 = no limit */
    const char *name, *place; /* whose, and err->place of what is over it */
};
/* The same for what is of one owner. What is there of that id stays as it is. */
bool srv_store_add(struct srv_store *store, enum srv_kind kind, const char *id, const char *text,
                   size_t size, const struct srv_store_share *share, struct sp_error *err);
/* False: it was not there. */
bool srv_store_remove(struct srv_store *store, enum srv_kind kind, const char *id);
/* malloc'ed with a NUL behind it, the caller's. NULL: SP_ERR_NOT_FOUND, SP_ERR_MEMORY. `size` may
 * be NULL. */
char *srv_store_get(struct srv_store *store, enum srv_kind kind, const char *id, size_t *size,
                    struct sp_error *err);
/* All ids of a kind in the order in which they were put first, each with its NUL, and an empty one
 * behind the last: malloc'ed, the caller's. NULL when out of memory. */
char *srv_store_ids(struct srv_store *store, enum srv_kind kind);

struct srv_page;
/* Shows all ids of a kind, of texts with this beginning, to a page of char[SRV_STORE_ID_MAX + 1].
 */
void srv_store_page(struct srv_store *store, enum srv_kind kind, const char *beginning,
                    struct srv_page *page);

/* There is something to collect. Cheap: may be called for every change. */
void srv_store_nudge(struct srv_store *store);
/* Calls done() once, on any thread and perhaps before it returns, when all that was put, removed or
 * can be collected by now is written (`durable`), or when that failed or nothing is ever written.
 */
void srv_store_flush(struct srv_store *store, void (*done)(void *user, bool durable), void *user);

struct srv_store_status {
    bool has_folder;
    bool is_failing;             /* the last write failed, or not all could be collected for it */
    char reason[SP_ERROR_TEXT];  /* then why */
    unsigned records[SRV_KINDS]; /* in memory */
    uint64_t bytes;              /* of their ids and texts */
    unsigned waiting;            /* changes that are not written yet */
    uint64_t writes, failures;   /* transactions so far */
    double write_ms;             /* that the last one took */
};
void srv_store_status(struct srv_store *store, struct srv_store_status *status);

#endif
