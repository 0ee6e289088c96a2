/* SPDX-License-Identifier: Apache-2.0
 *
 * The entries of the catalog, for catalog.c (adding, removing), catalog_load.c (the load threads),
 * catalog_steps.c (time steps) and catalog_use.c (status and uses).
 */
#ifndef SRV_RENDER_CATALOG_PRIVATE_H
#define SRV_RENDER_CATALOG_PRIVATE_H

#include <pthread.h>

#include "common/fair_owners.h"
#include "common/fair_share.h"
#include "render/catalog.h"
#include "sp/bricks.h"

/* An entry, or a time step of an entry. A use of a step is also a use of its entry. */
struct srv_volume {
    struct srv_volume *next;
    struct srv_volume *parent; /* the entry to which this step belongs; NULL = this is an entry */
    struct srv_volume *steps;  /* entry: other steps that are wanted or loaded */
    uint32_t step;             /* of the time series */
    uint64_t wanted_at;        /* step: catalog->requests at the last request for it */
    uint32_t last_step;        /* entry: the step that was requested last */
    bool is_ahead;             /* step: is loaded ahead, before anyone asks for it */
    bool is_left;    /* step that is loaded ahead: someone has asked for it, and will ask again */
    bool is_loading; /* a load thread loads it now */
    bool is_short;   /* step: waits until another load releases memory */
    char id[SP_NAME_BYTES], name[SP_NAME_BYTES];
    char owner[SRV_TOKEN_NAME_BYTES]; /* "" = the operator */
    char *source;      /* resolved (render/source.h): the key; "upload:ID" for an uploaded file,
                          "memory:ID" for shared memory */
    char *file;        /* of an upload: its path; NULL = `source` is loaded */
    char *public_name; /* which clients see: of an upload "upload:NAME", of shared memory
                          "memory:NAME"; NULL = the redacted source */
    struct srv_array_memory *memory; /* of a client, until it is mapped; NULL = none */
    bool confined, is_limited, is_persisted, is_restored;
    enum srv_volume_state state;
    double progress, notified_ms; /* notified_ms: when progress() was called last */
    struct sp_error error;
    struct sp_volume *volume;           /* NULL unless ready; constant while used */
    struct sp_view view;                /* default; constant while used */
    struct srv_fingerprint fingerprint; /* constant while used */
    uint64_t reserved_bytes, cached_bytes[SRV_RENDERERS];
    struct sp_joint_histogram
        *joint; /* guarded by joint_mutex until it is set; NULL = not counted */
    unsigned uses;
    /* No longer in the list of entries. The load thread frees it if it is loading; otherwise its
     * last user does. */
    bool is_removed;
};

/* One owner has at most two of them (srv_catalog_may_load()). */
enum { SRV_LOADERS = 4 };

struct srv_loader { /* a load thread */
    struct srv_catalog *catalog;
    pthread_t thread;
    bool prefers_steps; /* loads waiting steps before waiting volumes, so that neither kind waits
                           for all of the other kind */
};

struct srv_catalog {
    struct srv_catalog_options options;
    char *data; /* resolved; NULL = none */
    /* Taken before `mutex`: notifications are sent in the order in which the events happened. */
    pthread_mutex_t notify_mutex;
    pthread_mutex_t joint_mutex; /* taken alone; held while a joint histogram is counted */
    pthread_mutex_t mutex;       /* guards what follows */
    pthread_cond_t changed;      /* there is something to load, or stop */
    struct srv_volume *entries;  /* in the order of adding */
    unsigned count;
    uint64_t used_bytes; /* of the budget, without subvolumes: srv_catalog_acquire_bytes() */
    struct sp_brick_memory *brick_memory; /* of brick files: what the budget has left */
    uint64_t requests;                    /* how often a time step was asked for */
    bool stop;
    unsigned running;            /* load threads to join */
    unsigned loading;            /* load threads that load now */
    struct srv_fair_owners fair; /* the time that the loads of each owner took */
    struct srv_loader loaders[SRV_LOADERS];
};

/* The entry that a handle belongs to. */
static inline const struct srv_volume *srv_catalog_entry_of(const struct srv_volume *volume) {
    return volume->parent ? volume->parent : volume;
}

/* Finds an entry. With the mutex held. */
struct srv_volume *srv_catalog_entry(struct srv_catalog *catalog, const char *id);

/* Returns the bytes that loads may take. If a brick file is open, an eighth of the budget is
 * reserved for subvolumes of brick files; a load takes the rest from the subvolumes. With the mutex
 * held. */
uint64_t srv_catalog_free_bytes(struct srv_catalog *catalog);
/* Acquires bytes of the budget for an entry or a step, or releases all its bytes. With the mutex
 * held. */
void srv_catalog_acquire_bytes(struct srv_catalog *catalog, struct srv_volume *volume,
                               uint64_t bytes);
void srv_catalog_release_bytes(struct srv_catalog *catalog, struct srv_volume *volume);

/* Frees a removed entry that has no use and is not loading. With no lock of the catalog
 * held. */
void srv_catalog_free_removed(struct srv_catalog *catalog, struct srv_volume *volume);

void srv_catalog_entry_free(struct srv_volume *volume); /* with its steps */

/* Removes the names of folders from an error, because clients see it. */
void srv_catalog_redact(const struct srv_catalog *catalog, const struct srv_volume *volume,
                        struct sp_error *err);

/* Tells the uploads the final state of an uploaded file. With no lock held. */
void srv_catalog_close_upload(struct srv_catalog *catalog, const char *source,
                              enum srv_volume_state state);
/* Returns the source of an entry for srv_catalog_close_upload(), malloc'ed; NULL = there is nothing
 * to tell. With the mutex held. */
char *srv_catalog_upload_to_close(const struct srv_catalog *catalog,
                                  const struct srv_volume *volume);

/* True if a load thread may load this entry or step now. An owner whose loads occupy n threads gets
 * another one only while n more are idle, so that a short load of another owner never waits for all
 * loads of one owner. With the mutex held. */
bool srv_catalog_may_load(const struct srv_catalog *catalog, const struct srv_volume *volume);

/* Starts the load threads. After a failure the caller stops the catalog. */
bool srv_catalog_start_loaders(struct srv_catalog *catalog, struct sp_error *err);

/* Time steps (catalog_steps.c). The next functions are called with the mutex held: */

/* Returns the step to load next: the most recently requested one among the steps that someone waits
 * for; NULL = none. */
struct srv_volume *srv_catalog_wanted_step(const struct srv_catalog *catalog);
/* Returns the same among the steps that are loaded ahead. */
struct srv_volume *srv_catalog_ahead_step(const struct srv_catalog *catalog);
/* True if the step, which is being loaded, no longer has users while users wait for other steps. */
bool srv_catalog_is_step_unwanted(const struct srv_catalog *catalog, const struct srv_volume *step);
/* Call it when a load has ended. Steps that wait for memory are tried again. */
void srv_catalog_retry_steps(struct srv_catalog *catalog);
/* Returns the memory of volumes as a pool, with the part that the owner of an entry has. */
struct srv_pool srv_catalog_pool(struct srv_catalog *catalog, const struct srv_volume *entry);
/* Removes steps without users from the catalog, the least recently requested first, until `bytes`
 * are free for `loading`. Returns the steps, for srv_catalog_free_steps(). */
struct srv_volume *srv_catalog_evict_steps(struct srv_catalog *catalog,
                                           const struct srv_volume *loading, uint64_t bytes);
/* Call it when an entry was removed. Its waiting steps are no longer loaded. True if there was a
 * waiting step; then the caller calls options.step(), without the mutex. */
bool srv_catalog_fail_steps(struct srv_volume *entry);
/* Ends a use of a step. Returns the step if it must be freed, otherwise NULL. */
struct srv_volume *srv_catalog_drop_step(struct srv_volume *step);
/* Ends a use of an entry or a step. *dropped is for srv_catalog_free_steps(). True: the entry must
 * be freed by srv_catalog_free_removed(). */
bool srv_catalog_let_go(struct srv_volume *volume, struct srv_volume **dropped);

/* The next functions are called without the mutex: */

/* Frees the list of steps and evicts their data from the caches of renderers. */
void srv_catalog_free_steps(struct srv_catalog *catalog, struct srv_volume *steps);
/* Call it when loading a step ended, with or without success. Takes over the volume. */
void srv_catalog_end_step(struct srv_catalog *catalog, struct srv_volume *step,
                          struct sp_volume *volume, const struct sp_error *err);

#endif
