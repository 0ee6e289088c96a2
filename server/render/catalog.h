/* SPDX-License-Identifier: Apache-2.0
 *
 * The volumes of the daemon: each source is loaded once, by the load thread, and shared.
 *
 *   add ─► loading ─► ready ─► (unused) remove
 *             └─────► failed ─► add again retries
 *
 * A `struct srv_volume` handle is one counted use; an entry in use is not removed. Before voxels
 * are allocated their bytes are reserved from the memory budget. All functions are thread-safe.
 */
#ifndef SRV_RENDER_CATALOG_H
#define SRV_RENDER_CATALOG_H

#include <stdbool.h>
#include <stdint.h>

#include "render/fingerprint.h"
#include "sp/pick.h"
#include "sp/view.h"
#include "sp/volume.h"

struct srv_catalog;
struct srv_volume;

enum { SRV_RENDERERS = 3 };

enum srv_volume_state { SRV_VOLUME_LOADING, SRV_VOLUME_READY, SRV_VOLUME_FAILED };
const char *srv_volume_state_name(enum srv_volume_state state); /* "loading", "ready", "failed" */
#define SRV_VOLUME_UNLOADED "unloaded"

struct srv_volume_request {
    const char *source;    /* a path or "demo:…" */
    const char *id, *name; /* NULL = from the source */
    bool confined;         /* a path must lie below the data folder */
    bool is_kept;          /* of an earlier run: if it cannot be found there is a failed entry */
};

struct srv_catalog_options {
    uint64_t memory_bytes; /* budget for voxels */
    const char *data;      /* folder for loads by HTTP; NULL = none */
    const char *importer;  /* splat-import; NULL = beside the program */
    void *user;
    /* A state's name from the load thread, and SRV_VOLUME_UNLOADED from srv_catalog_remove; must
     * not call the catalog. */
    void (*progress)(void *user, const char *id, const char *state, double progress,
                     const char *reason);
    /* There is an entry of this id from now on, with its resolved source, or (NULL) none any more.
     * False: it cannot be kept; who adds it again has it tried again. With a lock held: must not
     * call the catalog. NULL = nothing is kept. */
    bool (*keep)(void *user, const char *id, const struct srv_volume_request *request);
    /* The entry is gone: forget what was derived; the callee unrefs. */
    void (*unloaded)(void *user, struct sp_volume *volume);
};

struct srv_catalog *srv_catalog_create(const struct srv_catalog_options *options,
                                       struct sp_error *err);
/* Stops the load thread (a load under way is cancelled). After all uses were released. */
void srv_catalog_destroy(struct srv_catalog **catalog);
/* Cancels what is loading and loads nothing more; no progress is told after it returned. Call it
 * from one thread. */
void srv_catalog_stop(struct srv_catalog *catalog);

/* Queues a load. *id_out gets the entry's id; *existed is true if the source was there already (a
 * failed one is tried again). SP_ERR_DENIED, SP_ERR_NOT_FOUND (path), SP_ERR_INVALID (id; place is
 * the JSON pointer), SP_ERR_BUDGET (too many entries). *conflict: the id belongs to another
 * source. */
bool srv_catalog_add(struct srv_catalog *catalog, const struct srv_volume_request *request,
                     char id_out[SP_NAME_BYTES], bool *existed, bool *conflict,
                     struct sp_error *err);
/* A load under way is given up. *conflict: in use. */
bool srv_catalog_remove(struct srv_catalog *catalog, const char *id, bool *conflict,
                        struct sp_error *err);

struct srv_volume_status {
    char id[SP_NAME_BYTES], name[SP_NAME_BYTES];
    char source[1024]; /* this and the next without folders (shown.h) */
    enum srv_volume_state state;
    double progress;
    struct sp_error error;    /* of a failed load */
    struct sp_volume *volume; /* a reference of the caller's if ready, else NULL */
    uint64_t voxel_bytes;     /* reserved for it */
    uint64_t cached_bytes;    /* kept by the renderers */
    uint64_t cached_per_renderer[SRV_RENDERERS];
    unsigned uses;
};
/* Entry i in the order of adding; false past the end. Or by id. Unref status->volume. */
bool srv_catalog_at(struct srv_catalog *catalog, unsigned i, struct srv_volume_status *status);
bool srv_catalog_find(struct srv_catalog *catalog, const char *id,
                      struct srv_volume_status *status);
void srv_catalog_memory(struct srv_catalog *catalog, uint64_t *used, uint64_t *budget);

/* Uses; the functions of struct srv_volume_source (session/hub.h), with `user` the catalog. */
void *srv_catalog_acquire(void *catalog, const char *id, struct sp_error *err);
void *srv_catalog_ref(void *catalog, void *volume);
void srv_catalog_release(void *catalog, void *volume);
void srv_catalog_default_view(void *catalog, void *volume, struct sp_view *view);
void srv_catalog_pick(void *catalog, void *volume, const struct sp_view *view,
                      const uint32_t size[2], const double at[2], struct sp_pick *pick);

/* Of a used volume, as long as the use: the voxels, and what they and their grid are. */
struct sp_volume *srv_volume_voxels(const struct srv_volume *volume);
const struct srv_fingerprint *srv_volume_fingerprint(const struct srv_volume *volume);
/* What renderer `lane` < SRV_RENDERERS keeps of the volume. */
void srv_catalog_set_cached(struct srv_catalog *catalog, struct srv_volume *volume, unsigned lane,
                            uint64_t bytes);

#endif
