/* SPDX-License-Identifier: Apache-2.0
 *
 * The volumes of the daemon. Each source is loaded once, by a load thread, and shared. Of a time
 * series, one step is loaded; other steps are loaded when views ask for them.
 *
 *   add ─► loading ─► ready ─► remove
 *             └─────► failed ─► remove, or add again: the load is retried
 *
 * A `struct srv_volume` handle is one counted use. An entry that is removed while it is in use is
 * no longer found, and its memory is released after the last use. The bytes of the voxels are
 * reserved from the memory budget before they are allocated. All functions are thread-safe.
 */
#ifndef SRV_RENDER_CATALOG_H
#define SRV_RENDER_CATALOG_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

#include "config/token_file.h"
#include "protocol/measure.h"
#include "render/fingerprint.h"
#include "sp/histogram.h"
#include "sp/pick.h"
#include "sp/view.h"
#include "sp/volume.h"

struct srv_brick_cache;
struct srv_array_memory;
struct srv_catalog;
struct srv_volume;

enum {
    SRV_RENDERERS = 3
}; /* renderers that cache data of a volume: one per worker (render/worker.h) */

enum srv_volume_state {
    SRV_VOLUME_LOADING,
    SRV_VOLUME_READY,
    SRV_VOLUME_FAILED,
    SRV_VOLUME_UNLOADED /* only in notifications */
};
const char *srv_volume_state_name(enum srv_volume_state state); /* "loading", "ready", … */

struct srv_volume_request {
    const char *source;    /* a path, "demo:…", "upload:ID" or, with `memory`, "memory:ID" */
    const char *id, *name; /* NULL = derived from the source */
    bool confined;         /* a path must lie below the data folder */
    const char *pointer;   /* JSON pointer to the source, for errors; NULL = "/path" or "/uri" */
    const char *owner;     /* the token that opens it; NULL = the operator */
    bool is_limited;       /* the limits of one token hold (SP_ERR_QUOTA below) */
    unsigned volumes_max;  /* of the owner; 0 = no quota */
    struct srv_array_memory *memory; /* the samples, owned by srv_catalog_add() from the call on,
                                         also if it fails; NULL = the source is loaded. Such a
                                         volume is not persisted */
    bool is_restored; /* restored from an earlier run: a missing path makes a failed entry instead
                         of an error, and the number of loads is not limited */
};

struct srv_catalog_options {
    uint64_t memory_bytes;         /* budget for voxels */
    const char *data;              /* folder for loads over HTTP; NULL = none */
    struct srv_brick_cache *cache; /* owned by the caller; NULL = none */
    const char *allowed_hosts; /* of remote volumes, as in struct sp_load_options; NULL = none */
    const char *importer;      /* splat-import; NULL = the one beside the program */
    void *user;
    /* Reports the state of a volume, with the progress in [0, 1] and the reason of a failure (""
     * otherwise). Called from a load thread, and from srv_catalog_remove() with
     * SRV_VOLUME_UNLOADED; must not call the catalog. */
    void (*progress)(void *user, const char *id, enum srv_volume_state state, double progress,
                     const char *reason);
    /* Called when an entry was added (request has its resolved source) or removed (request is
     * NULL). Returns false if the change cannot be persisted; the next srv_catalog_add() of the
     * source tries again. Called with a lock held: must not call the catalog. NULL = volumes are
     * not persisted. */
    bool (*persist)(void *user, const char *id, const struct srv_volume_request *request);
    /* Opens a complete upload: writes the path of its file and the name that its client gave, and
     * keeps the file until upload_close(). upload_close() gets the final state of the volume:
     * SRV_VOLUME_READY, _FAILED, _UNLOADED (removed), or _LOADING (it was not loaded after all).
     * Called without a lock. NULL = there are no uploads. */
    bool (*upload_open)(void *user, const char *id, char path[PATH_MAX], char name[NAME_MAX + 1],
                        struct sp_error *err);
    void (*upload_close)(void *user, const char *id, enum srv_volume_state state);
    /* Called when loading a time step of this volume ended, with or without success
     * (srv_catalog_step_is_ready()). Called from a load thread, or by srv_catalog_remove(); may
     * call the catalog. NULL = not called. */
    void (*step)(void *user, const char *id);
    /* Called when an entry was removed or one of its time steps was evicted: the callee evicts the
     * cached data of the volume, and takes over one reference. */
    void (*unloaded)(void *user, struct sp_volume *volume);
};

/* NULL with *err set: SP_ERR_IO (the data folder, the load thread), SP_ERR_MEMORY. */
struct srv_catalog *srv_catalog_create(const struct srv_catalog_options *options,
                                       struct sp_error *err);
/* Cancels the load in progress and ends the load thread: progress() is no longer called. One
 * thread at a time. */
void srv_catalog_stop(struct srv_catalog *catalog);
/* After all uses were released. Stops first; accepts NULL. */
void srv_catalog_destroy(struct srv_catalog **catalog);

/* Queues a load. *id_out is the entry's id. *existed is true if the source was added before and has
 * not failed. A failed source is loaded again and then belongs to the owner of the new request.
 * Errors: SP_ERR_DENIED, SP_ERR_NOT_FOUND (path), SP_ERR_INVALID (the place is a JSON pointer;
 * *conflict: the id belongs to another source), SP_ERR_BUDGET (too many entries), SP_ERR_QUOTA (the
 * owner has volumes_max volumes, or, if the request is limited, too many loads that wait),
 * SP_ERR_MEMORY. Volumes that one owner opened by limited requests take at most three quarters of
 * the memory budget; a load that needs more fails. */
bool srv_catalog_add(struct srv_catalog *catalog, const struct srv_volume_request *request,
                     char id_out[SP_NAME_BYTES], bool *existed, bool *conflict,
                     struct sp_error *err);
/* Builds the source for other fields of the file of an entry. Where `field` or `vectors` is NULL,
 * it keeps the field or the vectors of the entry. Fills request->confined, and sets *source,
 * malloc'ed, for request->source. SP_ERR_NOT_FOUND and SP_ERR_INVALID (a built-in volume) at
 * "/volume", SP_ERR_MEMORY. */
bool srv_catalog_field(struct srv_catalog *catalog, const char *id, const char *field,
                       const char *vectors, struct srv_volume_request *request, char **source,
                       struct sp_error *err);
/* Cancels a load in progress. The voxels stay until the last use ends. `by`: the token that asks,
 * NULL = an admin. SP_ERR_NOT_FOUND, SP_ERR_DENIED (`by` is not the owner). */
bool srv_catalog_remove(struct srv_catalog *catalog, const char *id, const char *by,
                        struct sp_error *err);

struct srv_volume_status {
    char id[SP_NAME_BYTES], name[SP_NAME_BYTES];
    char owner[SRV_TOKEN_NAME_BYTES]; /* the token that opened it; "" = the operator */
    char source[1024];                /* redacted, as the error (render/redact.h) */
    enum srv_volume_state state;
    double progress;          /* [0, 1] */
    struct sp_error error;    /* of a failed load */
    struct sp_volume *volume; /* a reference of the caller's if ready, else NULL */
    uint64_t voxel_bytes;     /* bytes reserved for the volume and for its other time steps */
    uint64_t step_bytes;      /* part of voxel_bytes that belongs to the other time steps */
    uint64_t cached_bytes;    /* bytes cached by all renderers together */
    uint64_t cached_per_renderer[SRV_RENDERERS];
    unsigned uses;
};
/* Gets entry i in the order of adding, or the entry of this id; false if there is none. Unref
 * status->volume. */
bool srv_catalog_at(struct srv_catalog *catalog, unsigned i, struct srv_volume_status *status);
bool srv_catalog_find(struct srv_catalog *catalog, const char *id,
                      struct srv_volume_status *status);
/* Returns the resolved data folder; NULL = none. Constant. */
const char *srv_catalog_data(const struct srv_catalog *catalog);
/* True if remote volumes of some hosts may be loaded. Constant. */
bool srv_catalog_allows_hosts(const struct srv_catalog *catalog);
/* Gets the bytes of the memory budget: used (without subvolumes of brick files), the limit, and the
 * bytes of these subvolumes. */
void srv_catalog_memory(struct srv_catalog *catalog, uint64_t *used, uint64_t *budget,
                        uint64_t *brick_bytes);

/* Uses: the functions of struct srv_volume_source (session/hub.h), with `user` the catalog. */
struct srv_volume *srv_catalog_acquire(void *catalog, const char *id, struct sp_error *err);
struct srv_volume *srv_catalog_ref(void *catalog, struct srv_volume *volume);
void srv_catalog_release(void *catalog, struct srv_volume *volume);
void srv_catalog_default_view(void *catalog, struct srv_volume *volume, struct sp_view *view);
double srv_catalog_spacing(void *catalog, struct srv_volume *volume);
/* Returns a use of a time step of the volume, and starts to load the step if necessary. `step` is
 * below the number of steps. NULL = out of memory. Once the step is ready, all functions below
 * accept it in place of the volume. */
struct srv_volume *srv_catalog_step(void *catalog, struct srv_volume *volume, uint32_t step);
/* True if the step is loaded. Otherwise *err is set: SP_ERR_NOT_READY while it loads, or the reason
 * why loading failed. */
bool srv_catalog_step_is_ready(void *catalog, struct srv_volume *step, struct sp_error *err);
/* Returns a use of the loaded step that is nearest to `step`. */
struct srv_volume *srv_catalog_nearest_step(void *catalog, struct srv_volume *volume,
                                            uint32_t step);
/* Exchanges a use of a volume for a use of a loaded time step. NULL with *err set: SP_ERR_NOT_READY
 * (the step is being loaded: ask again), SP_ERR_MEMORY, or the reason why it cannot be loaded. */
struct srv_volume *srv_catalog_ready_step(struct srv_catalog *catalog, struct srv_volume *volume,
                                          uint32_t step, struct sp_error *err);
/* Returns the number of time steps, at least 1. */
uint32_t srv_catalog_steps(void *catalog, struct srv_volume *volume);
bool srv_catalog_fits(void *catalog, struct srv_volume *volume, const struct sp_view *view,
                      struct sp_error *err);
bool srv_catalog_pick(void *catalog, struct srv_volume *volume, const struct sp_view *view,
                      const uint32_t size[2], const double at[2], struct sp_pick *pick,
                      struct sp_error *err);
bool srv_catalog_measure(void *catalog, struct srv_volume *volume, const struct sp_view *view,
                         const struct sp_measure *measure, double samples,
                         struct proto_measure_value *value, struct sp_error *err);

/* Returns a volume with the samples that a measurement needs, and sets *level. For a volume that is
 * larger than memory, these are the samples around the points, unless the measurement is a part, a
 * path, a distance or an angle. Otherwise it is the volume itself. One reference; NULL with *err
 * set, as in sp_bricks_around(). Reads bricks for up to 10 s: call it with no lock held. */
struct sp_volume *srv_measured_samples(struct sp_volume *volume, const struct sp_measure *measure,
                                       unsigned *level, struct sp_error *err);

/* Return the voxels and the fingerprint of a used volume; valid as long as the use. */
struct sp_volume *srv_volume_voxels(const struct srv_volume *volume);
const struct srv_fingerprint *srv_volume_fingerprint(const struct srv_volume *volume);

/* Other volumes: those that layers of a view name. Each shows the time step of the view, or its
 * last one if it has fewer; beside a volume with one step, the step that it was opened with. */

/* Writes uses of the time steps of other volumes to steps[]; the caller releases them. A volume
 * with one step adds none. False when out of memory; *count uses were taken before the failure. */
bool srv_catalog_other_steps(void *catalog, struct srv_volume *volume, const struct sp_view *view,
                             struct srv_volume *steps[2 * SP_LAYERS_MAX], unsigned *count);
/* The context of srv_catalog_find_loaded(). */
struct srv_loaded_search {
    struct srv_catalog *catalog;
    const struct srv_volume *volume; /* the caller has a use of it */
    uint32_t step;                   /* of the view */
    bool is_other; /* srv_catalog_find_loaded() returned another step, because the step of the view
                      is not loaded */
};
/* sp_render_options.find(), with `user` a struct srv_loaded_search: returns a reference to the
 * loaded step that is nearest to srv_loaded_search.step; NULL = the volume is not ready. */
struct sp_volume *srv_catalog_find_loaded(void *user, const char *id);
/* Hashes all volumes that decide the pixels of a view: the used volume, and the volumes that its
 * layers name. */
struct srv_fingerprint srv_catalog_fingerprint(struct srv_catalog *catalog,
                                               const struct srv_volume *volume,
                                               const struct sp_view *view);
/* Returns the joint histogram of a used volume, which is valid as long as the use; NULL with *err
 * set on failure. The first call per volume counts for tens of milliseconds, one volume at a time;
 * later calls return the same histogram. Thread-safe. */
const struct sp_joint_histogram *srv_catalog_joint_histogram(struct srv_catalog *catalog,
                                                             struct srv_volume *volume,
                                                             struct sp_error *err);
/* Records how many bytes a renderer, [0, SRV_RENDERERS), caches of the volume. */
void srv_catalog_set_cached(struct srv_catalog *catalog, struct srv_volume *volume,
                            unsigned renderer, uint64_t bytes);

#endif
