/* SPDX-License-Identifier: Apache-2.0 */
#include "render/catalog.h"

#include <assert.h>
#include <errno.h>
#include <inttypes.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "common/clock.h"
#include "render/redact.h"
#include "render/source.h"
#include "sp/log.h"

enum { ENTRIES_MAX = 1024 };
#define PROGRESS_MS 100.0 /* between two progress notifications of one load */

struct srv_volume {
    struct srv_volume *next;
    char id[SP_NAME_BYTES], name[SP_NAME_BYTES];
    char *source; /* resolved (render/source.h): the key */
    bool confined, is_persisted;
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
    bool is_removed; /* while it was loading: the load thread frees it */
};

struct srv_catalog {
    struct srv_catalog_options options;
    char *data; /* resolved; NULL = none */
    /* Taken before `mutex`: notifications are sent in the order in which the events happened. */
    pthread_mutex_t notify_mutex;
    pthread_mutex_t joint_mutex; /* taken alone; held while a joint histogram is counted */
    pthread_mutex_t mutex;       /* guards what follows */
    pthread_cond_t changed;      /* there is something to load, or stop */
    pthread_t loader;
    struct srv_volume *entries; /* in the order of adding */
    unsigned count;
    uint64_t used_bytes;
    struct srv_volume *loading; /* by the load thread now */
    bool stop, is_joined;
};

const char *srv_volume_state_name(enum srv_volume_state state) {
    static const char *const names[] = { "loading", "ready", "failed", "unloaded" };
    return names[state];
}

/* The load thread. */

/* sp_load_options.reserve */
static bool reserve(void *user, uint64_t bytes, struct sp_error *err) {
    struct srv_catalog *catalog = user;
    bool ok = true;
    pthread_mutex_lock(&catalog->mutex);
    uint64_t budget = catalog->options.memory_bytes;
    uint64_t left = budget > catalog->used_bytes ? budget - catalog->used_bytes : 0;
    if (catalog->loading->is_removed) {
        ok = sp_fail(err, SP_ERR_CANCELLED, NULL, "cancelled");
    } else if (bytes > left) {
        ok = sp_fail(err, SP_ERR_BUDGET, catalog->loading->source,
                     "the volume needs %" PRIu64 " bytes and %" PRIu64 " of %" PRIu64
                     " are free; unload a volume or raise --memory",
                     bytes, left, budget);
    } else {
        catalog->used_bytes += bytes;
        catalog->loading->reserved_bytes += bytes;
    }
    pthread_mutex_unlock(&catalog->mutex);
    return ok;
}

static void notify(struct srv_catalog *catalog, const char *id, enum srv_volume_state state,
                   double fraction, const char *reason) {
    catalog->options.progress(catalog->options.user, id, state, fraction, reason);
}

static bool is_removed(struct srv_catalog *catalog, const struct srv_volume *v) {
    pthread_mutex_lock(&catalog->mutex);
    bool is_removed = v->is_removed;
    pthread_mutex_unlock(&catalog->mutex);
    return is_removed;
}

/* sp_load_options.progress; false cancels the load. */
static bool progress(void *user, double fraction) {
    struct srv_catalog *catalog = user;
    double now_ms = srv_clock_ms();
    pthread_mutex_lock(&catalog->mutex);
    struct srv_volume *v = catalog->loading;
    bool continues = !catalog->stop && !v->is_removed;
    bool is_due = now_ms - v->notified_ms >= PROGRESS_MS;
    v->progress = fraction;
    if (is_due)
        v->notified_ms = now_ms;
    pthread_mutex_unlock(&catalog->mutex);
    /* Without the lock: an entry that is loading keeps its id and is freed by this thread alone. */
    if (is_due) {
        pthread_mutex_lock(&catalog->notify_mutex);
        if (!is_removed(catalog, v)) /* else the id may belong to another entry by now */
            notify(catalog, v->id, SRV_VOLUME_LOADING, fraction, "");
        pthread_mutex_unlock(&catalog->notify_mutex);
    }
    return continues;
}

/* Clients see the error: they must not learn where the folders are. */
static void redact(const struct srv_catalog *catalog, const struct srv_volume *v,
                   struct sp_error *err) {
    srv_redact_text(catalog->data, v->source, err->place, sizeof err->place);
    srv_redact_text(catalog->data, v->source, err->text, sizeof err->text);
}

static void log_load(const struct srv_volume *v, const struct sp_volume *volume,
                     const struct sp_error *err, double took_ms) {
    if (volume) {
        const struct sp_volume_info *info = sp_volume_info(volume);
        sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "volume", v->id }),
                    "volume %s loaded: %ux%ux%u %s, %" PRIu64 " bytes, %.0f ms", v->id,
                    info->grid.dims[0], info->grid.dims[1], info->grid.dims[2],
                    sp_type_name(info->type), info->voxel_bytes, took_ms);
    } else if (err->code == SP_ERR_CANCELLED) {
        sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "volume", v->id }),
                    "loading of volume %s was cancelled", v->id);
    } else {
        sp_log_with(SP_LOG_ERROR, SP_LOG_FIELDS({ "volume", v->id }),
                    "volume %s failed to load: %s%s%s", v->id, err->place,
                    err->place[0] ? ": " : "", err->text);
    }
}

static void entry_free(struct srv_volume *v) {
    sp_volume_unref(&v->volume);
    free(v->joint);
    free(v->source);
    free(v);
}

/* The entry becomes ready or failed, or is freed if it was removed meanwhile. `volume`: the
 * reference is taken over; NULL = the load failed. */
static void end_load(struct srv_catalog *catalog, struct srv_volume *v, struct sp_volume *volume,
                     const struct sp_error *err) {
    char id[SP_NAME_BYTES];
    pthread_mutex_lock(&catalog->notify_mutex);
    pthread_mutex_lock(&catalog->mutex);
    catalog->loading = NULL; /* from here on srv_catalog_remove() frees the entry */
    v->volume = volume;
    v->error = *err;
    bool was_removed = v->is_removed;
    v->state = volume ? SRV_VOLUME_READY : SRV_VOLUME_FAILED;
    v->progress = volume ? 1 : v->progress;
    if (!volume && !was_removed) {
        catalog->used_bytes -= v->reserved_bytes;
        v->reserved_bytes = 0;
    }
    memcpy(id, v->id, sizeof id);
    double fraction = v->progress;
    pthread_mutex_unlock(&catalog->mutex);
    if (was_removed)
        entry_free(v);
    else
        notify(catalog, id, volume ? SRV_VOLUME_READY : SRV_VOLUME_FAILED, fraction, err->text);
    pthread_mutex_unlock(&catalog->notify_mutex);
}

static void load(struct srv_catalog *catalog, struct srv_volume *v) {
    struct sp_error err = { .code = SP_OK };
    struct sp_load_options options = { .reserve = reserve,
                                       .progress = progress,
                                       .user = catalog,
                                       .root = v->confined ? catalog->data : NULL,
                                       .importer = catalog->options.importer };
    double start_ms = srv_clock_ms();
    /* With the lock: after the last notification of an earlier entry with this id. */
    pthread_mutex_lock(&catalog->notify_mutex);
    notify(catalog, v->id, SRV_VOLUME_LOADING, 0, "");
    pthread_mutex_unlock(&catalog->notify_mutex);
    struct sp_volume *volume = sp_volume_load(v->source, &options, &err);
    if (volume)
        v->fingerprint = srv_fingerprint_volume(volume);
    log_load(v, volume, &err, srv_clock_ms() - start_ms);
    if (volume)
        sp_view_init(&v->view, sp_volume_info(volume), v->id);
    else
        redact(catalog, v, &err);
    end_load(catalog, v, volume, &err);
}

static void *load_thread(void *user) {
    struct srv_catalog *catalog = user;
    pthread_mutex_lock(&catalog->mutex);
    while (!catalog->stop) {
        struct srv_volume *v = catalog->entries;
        while (v && v->state != SRV_VOLUME_LOADING)
            v = v->next;
        catalog->loading = v;
        if (!v) {
            pthread_cond_wait(&catalog->changed, &catalog->mutex);
            continue;
        }
        pthread_mutex_unlock(&catalog->mutex);
        load(catalog, v);
        pthread_mutex_lock(&catalog->mutex);
    }
    pthread_mutex_unlock(&catalog->mutex);
    return NULL;
}

/* malloc'ed; NULL with errno set. */
static char *real_folder(const char *path) {
    char *real = realpath(path, NULL);
    struct stat found;
    if (real && (stat(real, &found) != 0 || !S_ISDIR(found.st_mode))) {
        free(real);
        real = NULL;
        errno = ENOTDIR;
    }
    return real;
}

struct srv_catalog *srv_catalog_create(const struct srv_catalog_options *options,
                                       struct sp_error *err) {
    struct srv_catalog *catalog = calloc(1, sizeof *catalog);
    if (!catalog) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the catalog");
        return NULL;
    }
    catalog->options = *options;
    if (options->data && !(catalog->data = real_folder(options->data))) {
        sp_fail(err, SP_ERR_IO, options->data, "cannot use this folder for --data: %s",
                strerror(errno));
        free(catalog);
        return NULL;
    }
    pthread_mutex_init(&catalog->mutex, NULL);
    pthread_mutex_init(&catalog->notify_mutex, NULL);
    pthread_mutex_init(&catalog->joint_mutex, NULL);
    pthread_cond_init(&catalog->changed, NULL);
    int failed = pthread_create(&catalog->loader, NULL, load_thread, catalog);
    if (failed) {
        sp_fail(err, SP_ERR_IO, NULL, "cannot start the load thread: %s", strerror(failed));
        free(catalog->data);
        free(catalog);
        return NULL;
    }
    return catalog;
}

void srv_catalog_stop(struct srv_catalog *catalog) {
    pthread_mutex_lock(&catalog->mutex);
    catalog->stop = true;
    pthread_cond_signal(&catalog->changed);
    bool join = !catalog->is_joined;
    catalog->is_joined = true;
    pthread_mutex_unlock(&catalog->mutex);
    if (join)
        pthread_join(catalog->loader, NULL);
}

void srv_catalog_destroy(struct srv_catalog **catalog_pointer) {
    struct srv_catalog *catalog = *catalog_pointer;
    *catalog_pointer = NULL;
    if (!catalog)
        return;
    srv_catalog_stop(catalog);
    while (catalog->entries) {
        struct srv_volume *v = catalog->entries;
        catalog->entries = v->next;
        assert(v->uses == 0);
        entry_free(v);
    }
    pthread_cond_destroy(&catalog->changed);
    pthread_mutex_destroy(&catalog->mutex);
    pthread_mutex_destroy(&catalog->notify_mutex);
    pthread_mutex_destroy(&catalog->joint_mutex);
    free(catalog->data);
    free(catalog);
}

static struct srv_volume *find(struct srv_catalog *catalog, const char *id) {
    struct srv_volume *v = catalog->entries;
    while (v && strcmp(v->id, id) != 0)
        v = v->next;
    return v;
}

static void unique_id(struct srv_catalog *catalog, char id[SP_NAME_BYTES]) {
    size_t length = strlen(id);
    for (unsigned i = 2; find(catalog, id); i++)
        snprintf(id + length, SP_NAME_BYTES - length, "-%u", i);
}

/* Appends an entry. With the mutex held. Takes over `source` on success. */
static struct srv_volume *add_entry(struct srv_catalog *catalog,
                                    const struct srv_volume_request *request, char *source,
                                    bool *conflict, struct sp_error *err) {
    if (request->id && find(catalog, request->id)) {
        *conflict = true;
        sp_fail(err, SP_ERR_INVALID, "/id", "the id '%s' belongs to another volume", request->id);
        return NULL;
    }
    if (catalog->count >= ENTRIES_MAX) {
        sp_fail(err, SP_ERR_BUDGET, NULL, "%u volumes exist, which is the limit; unload one",
                catalog->count);
        return NULL;
    }
    struct srv_volume *v = calloc(1, sizeof *v);
    if (!v) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a volume");
        return NULL;
    }
    if (request->id) {
        snprintf(v->id, sizeof v->id, "%s", request->id);
    } else {
        srv_source_default_id(source, v->id);
        unique_id(catalog, v->id);
    }
    snprintf(v->name, sizeof v->name, "%s", request->name ? request->name : v->id);
    v->source = source;
    struct srv_volume **link = &catalog->entries;
    while (*link)
        link = &(*link)->next;
    *link = v;
    catalog->count++;
    v->is_persisted = request->is_restored;
    return v;
}

/* With the mutex held. */
static void persist(struct srv_catalog *catalog, struct srv_volume *v) {
    const struct srv_volume_request request = {
        .source = v->source, .id = v->id, .name = v->name, .confined = v->confined
    };
    if (catalog->options.persist && !v->is_persisted)
        v->is_persisted = catalog->options.persist(catalog->options.user, v->id, &request);
}

bool srv_catalog_add(struct srv_catalog *catalog, const struct srv_volume_request *request,
                     char id_out[SP_NAME_BYTES], bool *existed, bool *conflict,
                     struct sp_error *err) {
    *conflict = *existed = false;
    if (request->id && !srv_source_is_id(request->id))
        return sp_fail(err, SP_ERR_INVALID, "/id",
                       "must be 1 to %d characters of [A-Za-z0-9._-], and not '.' or '..'",
                       SP_NAME_BYTES - 1);
    struct sp_error why = { .code = SP_OK };
    char *source = srv_source_resolve(request->source, request->confined, catalog->data, &why);
    bool is_lost = !source && why.code != SP_ERR_MEMORY && request->is_restored;
    if (is_lost)
        source = strdup(request->source);
    if (!source) {
        if (is_lost)
            sp_fail(&why, SP_ERR_MEMORY, NULL, "out of memory for a path");
        if (err)
            *err = why;
        return false;
    }
    pthread_mutex_lock(&catalog->mutex);
    struct srv_volume *v = catalog->entries;
    while (v && strcmp(v->source, source) != 0)
        v = v->next;
    *existed = v && v->state != SRV_VOLUME_FAILED;
    if (v) {
        free(source);
    } else if (!(v = add_entry(catalog, request, source, conflict, err))) {
        pthread_mutex_unlock(&catalog->mutex);
        free(source);
        return false;
    }
    if (!*existed) {
        v->confined = request->confined && !srv_source_is_demo(v->source);
        v->state = is_lost ? SRV_VOLUME_FAILED : SRV_VOLUME_LOADING;
        v->error = why;
        redact(catalog, v, &v->error);
        v->progress = 0;
        pthread_cond_signal(&catalog->changed);
    }
    persist(catalog, v);
    memcpy(id_out, v->id, sizeof v->id);
    pthread_mutex_unlock(&catalog->mutex);
    return true;
}

bool srv_catalog_remove(struct srv_catalog *catalog, const char *id, bool *conflict,
                        struct sp_error *err) {
    *conflict = false;
    pthread_mutex_lock(&catalog->notify_mutex);
    pthread_mutex_lock(&catalog->mutex);
    struct srv_volume **link = &catalog->entries;
    while (*link && strcmp((*link)->id, id) != 0)
        link = &(*link)->next;
    struct srv_volume *v = *link;
    bool ok = true, is_loading = false;
    if (!v) {
        ok = sp_fail(err, SP_ERR_NOT_FOUND, NULL, "there is no volume '%s'", id);
    } else if (v->uses > 0) {
        *conflict = true;
        ok = sp_fail(err, SP_ERR_INVALID, NULL,
                     "the volume is in use %u times, by sessions and renders; end them first",
                     v->uses);
    } else {
        is_loading = v->is_removed = v == catalog->loading;
        *link = v->next;
        if (catalog->options.persist)
            catalog->options.persist(catalog->options.user, v->id, NULL);
        catalog->count--;
        catalog->used_bytes -= v->reserved_bytes;
    }
    pthread_mutex_unlock(&catalog->mutex);
    if (ok)
        notify(catalog, id, SRV_VOLUME_UNLOADED, 0, "");
    pthread_mutex_unlock(&catalog->notify_mutex);
    if (ok)
        sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "volume", id }), "volume %s unloaded", id);
    if (ok && !is_loading) {
        if (v->volume)
            catalog->options.unloaded(catalog->options.user, sp_volume_ref(v->volume));
        entry_free(v);
    }
    return ok;
}

static void status_of(const struct srv_catalog *catalog, const struct srv_volume *v,
                      struct srv_volume_status *status) {
    memcpy(status->id, v->id, sizeof v->id);
    memcpy(status->name, v->name, sizeof v->name);
    srv_redact_source(catalog->data, v->source, status->source, sizeof status->source);
    status->state = v->state;
    status->progress = v->progress;
    status->error = v->error;
    status->volume = v->volume ? sp_volume_ref(v->volume) : NULL;
    status->cached_bytes = 0;
    status->voxel_bytes = v->reserved_bytes;
    memcpy(status->cached_per_renderer, v->cached_bytes, sizeof status->cached_per_renderer);
    for (int r = 0; r < SRV_RENDERERS; r++)
        status->cached_bytes += v->cached_bytes[r];
    status->uses = v->uses;
}

bool srv_catalog_at(struct srv_catalog *catalog, unsigned i, struct srv_volume_status *status) {
    pthread_mutex_lock(&catalog->mutex);
    struct srv_volume *v = catalog->entries;
    while (v && i-- > 0)
        v = v->next;
    if (v)
        status_of(catalog, v, status);
    pthread_mutex_unlock(&catalog->mutex);
    return v != NULL;
}

bool srv_catalog_find(struct srv_catalog *catalog, const char *id,
                      struct srv_volume_status *status) {
    pthread_mutex_lock(&catalog->mutex);
    struct srv_volume *v = find(catalog, id);
    if (v)
        status_of(catalog, v, status);
    pthread_mutex_unlock(&catalog->mutex);
    return v != NULL;
}

void srv_catalog_memory(struct srv_catalog *catalog, uint64_t *used, uint64_t *budget) {
    pthread_mutex_lock(&catalog->mutex);
    *used = catalog->used_bytes;
    *budget = catalog->options.memory_bytes;
    pthread_mutex_unlock(&catalog->mutex);
}

void *srv_catalog_acquire(void *user, const char *id, struct sp_error *err) {
    struct srv_catalog *catalog = user;
    struct srv_volume *found;
    pthread_mutex_lock(&catalog->mutex);
    if (id && *id) {
        found = find(catalog, id);
    } else {
        found = catalog->entries; /* the first entry that is ready, else the first one */
        for (struct srv_volume *v = found; v; v = v->next)
            if (v->state == SRV_VOLUME_READY) {
                found = v;
                break;
            }
    }
    if (!found && id && *id)
        sp_fail(err, SP_ERR_VOLUME_UNKNOWN, "/volume", "there is no volume '%s'", id);
    else if (!found)
        sp_fail(err, SP_ERR_VOLUME_UNKNOWN, "/volume",
                "no volume is loaded; load one with POST /api/v1/volumes");
    else if (found->state == SRV_VOLUME_LOADING)
        sp_fail(err, SP_ERR_NOT_READY, "/volume", "the volume '%s' is still loading (%.0f %%)",
                found->id, found->progress * 100);
    else if (found->state == SRV_VOLUME_FAILED)
        sp_fail(err, SP_ERR_VOLUME_FAILED, "/volume", "the volume '%s' failed to load: %.300s",
                found->id, found->error.text);
    bool ok = found && found->state == SRV_VOLUME_READY;
    if (ok)
        found->uses++;
    pthread_mutex_unlock(&catalog->mutex);
    return ok ? found : NULL;
}

void *srv_catalog_ref(void *user, void *volume) {
    struct srv_catalog *catalog = user;
    struct srv_volume *v = volume;
    pthread_mutex_lock(&catalog->mutex);
    v->uses++;
    pthread_mutex_unlock(&catalog->mutex);
    return v;
}

void srv_catalog_release(void *user, void *volume) {
    struct srv_catalog *catalog = user;
    struct srv_volume *v = volume;
    pthread_mutex_lock(&catalog->mutex);
    assert(v->uses > 0);
    v->uses--;
    pthread_mutex_unlock(&catalog->mutex);
}

void srv_catalog_default_view(void *user, void *volume, struct sp_view *view) {
    (void)user;
    *view = ((struct srv_volume *)volume)->view;
}

void srv_catalog_pick(void *user, void *volume, const struct sp_view *view, const uint32_t size[2],
                      const double at[2], struct sp_pick *pick) {
    (void)user;
    sp_pick_at(((struct srv_volume *)volume)->volume, view, size, at, pick);
}

struct sp_volume *srv_volume_voxels(const struct srv_volume *volume) {
    return volume->volume;
}

const struct srv_fingerprint *srv_volume_fingerprint(const struct srv_volume *volume) {
    return &volume->fingerprint;
}

const struct sp_joint_histogram *srv_catalog_joint_histogram(struct srv_catalog *catalog,
                                                             struct srv_volume *volume,
                                                             struct sp_error *err) {
    pthread_mutex_lock(&catalog->joint_mutex);
    if (!volume->joint) {
        struct sp_joint_histogram *joint = malloc(sizeof *joint);
        if (!joint)
            sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the histogram");
        else if (sp_joint_histogram_count(volume->volume, joint, err))
            volume->joint = joint;
        else
            free(joint);
    }
    const struct sp_joint_histogram *joint = volume->joint;
    pthread_mutex_unlock(&catalog->joint_mutex);
    return joint;
}

void srv_catalog_set_cached(struct srv_catalog *catalog, struct srv_volume *volume,
                            unsigned renderer, uint64_t bytes) {
    assert(renderer < SRV_RENDERERS);
    pthread_mutex_lock(&catalog->mutex);
    volume->cached_bytes[renderer] = bytes;
    pthread_mutex_unlock(&catalog->mutex);
}
