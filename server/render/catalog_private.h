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
    struct srv_volume *parent; /* the entry that this is a step of; NULL = it is an entry */
    struct srv_volume *steps; /* of an entry: those that are wanted or loaded, apart from its own */
    uint32_t step;            /* of the time series */
    uint64_t wanted_at;       /* of a step: catalog->requests when it was asked for last */
    uint32_t last_step;       /* of an entry: the step that was asked for last */
    bool is_ahead;            /* of a step: it is to be loaded before someone asks for it */
    bool is_left;             /* of such a step: someone has asked, and will ask again */
    bool is_loading;          /* by a load thread now */
    bool is_short;            /* of a step: it waits until another load gives memory back */
    char id[SP_NAME_BYTES], name[SP_NAME_BYTES];
    char owner[SRV_TOKEN_NAME_BYTES]; /* "" = the operator */
    char *source;      /* resolved (render/source.h): the key; "upload:ID" for an uploaded file */
    char *file;        /* of an upload: its path; NULL = `source` is loaded */
    char *public_name; /* of an upload: "upload:NAME", which clients see; NULL = the redacted source
                        */
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
    /* No longer an entry. While it loads, the load thread frees it, or else its last user. */
    bool is_removed;
};

/* One owner has at most two of them (srv_catalog_may_load()). */
enum { SRV_LOADERS = 4 };

struct srv_loader { /* a load thread */
    struct srv_catalog *catalog;
    pthread_t thread;
    bool prefers_steps; /* to volumes that wait, so that neither waits for all of the others */
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
    uint64_t used_bytes; /* of the budget, without windows: srv_catalog_acquire_bytes() */
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

/* Bytes that loads may take. An eighth of the budget is kept for windows of brick files if one is
 * open; a load takes what they have beyond that. With the mutex held. */
uint64_t srv_catalog_free_bytes(struct srv_catalog *catalog);
/* Takes bytes of the budget for an entry or a step, or gives all of its bytes back. With the mutex
 * held. */
void srv_catalog_acquire_bytes(struct srv_catalog *catalog, struct srv_volume *volume,
                               uint64_t bytes);
void srv_catalog_release_bytes(struct srv_catalog *catalog, struct srv_volume *volume);

/* Frees a removed entry that has no use and is not loading. With no lock of the catalog
 * held. */
void srv_catalog_free_removed(struct srv_catalog *catalog, struct srv_volume *volume);

void srv_catalog_entry_free(struct srv_volume *volume); /* with its steps */

/* Clients see the error: they must not learn where the folders are. */
void srv_catalog_redact(const struct srv_catalog *catalog, const struct srv_volume *volume,
                        struct sp_error *err);

/* Tells the owner of an uploaded file what became of it. With no lock held. */
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

/* Time steps (catalog_steps.c). These with the mutex held: */

/* The step to load next: of those that someone waits for, the one that was asked for last; NULL =
 * there is none. */
struct srv_volume *srv_catalog_wanted_step(const struct srv_catalog *catalog);
/* The same of those that are loaded ahead. */
struct srv_volume *srv_catalog_ahead_step(const struct srv_catalog *catalog);
/* True if a step is being loaded that no longer has users, while users wait for others. */
bool srv_catalog_is_step_unwanted(const struct srv_catalog *catalog, const struct srv_volume *step);
/* A load has ended: steps that wait for memory are tried again. */
void srv_catalog_retry_steps(struct srv_catalog *catalog);
/* The memory of volumes, and what of it the owner of an entry has. */
struct srv_pool srv_catalog_pool(struct srv_catalog *catalog, const struct srv_volume *entry);
/* Takes steps without users out of the catalog, those first that were asked for longest ago,
 * until `bytes` are free for `loading`. Returns them, for srv_catalog_free_steps(). */
struct srv_volume *srv_catalog_evict_steps(struct srv_catalog *catalog,
                                           const struct srv_volume *loading, uint64_t bytes);
/* The entry was removed: steps that wait are loaded no more. True if there was one; the caller
 * calls options.step() then, without the mutex. */
bool srv_catalog_fail_steps(struct srv_volume *entry);
/* A use of a step has ended. Returns it if it is to be freed; else NULL. */
struct srv_volume *srv_catalog_drop_step(struct srv_volume *step);
/* Gives a use back. *dropped is for srv_catalog_free_steps(). True: the entry is free, for
 * srv_catalog_free_removed(). */
bool srv_catalog_let_go(struct srv_volume *volume, struct srv_volume **dropped);

/* These without: */

/* Frees the list and evicts what renderers cache of it. */
void srv_catalog_free_steps(struct srv_catalog *catalog, struct srv_volume *steps);
/* A step was loaded, or not. Takes over the volume. */
void srv_catalog_end_step(struct srv_catalog *catalog, struct srv_volume *step,
                          struct sp_volume *volume, const struct sp_error *err);

#endif
