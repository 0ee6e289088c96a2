/* SPDX-License-Identifier: Apache-2.0
 *
 * The load threads of the catalog.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "render/array_memory.h"
#include "render/brick_cache.h"
#include "render/catalog_private.h"
#include "sp/log.h"

#define PROGRESS_MS 100.0 /* between two progress notifications of one load */

/* What the load callbacks get. */
struct load {
    struct srv_catalog *catalog;
    struct srv_volume *volume; /* an entry or a step of one */
};

/* sp_load_options.reserve. Evicts unused time steps where memory is short. */
static bool reserve(void *user, uint64_t bytes, struct sp_error *err) {
    const struct load *load = user;
    struct srv_catalog *catalog = load->catalog;
    bool ok = true;
    pthread_mutex_lock(&catalog->mutex);
    const uint64_t budget = catalog->options.memory_bytes;
    const struct srv_volume *v = srv_catalog_entry_of(load->volume);
    struct srv_volume *evicted = srv_catalog_evict_steps(catalog, load->volume, bytes);
    const uint64_t left = srv_catalog_free_bytes(catalog);
    const struct srv_pool pool = srv_catalog_pool(catalog, v);
    if (v->is_removed) {
        ok = sp_fail(err, SP_ERR_CANCELLED, NULL, "cancelled");
    } else if (bytes > left) {
        ok = sp_fail(err, SP_ERR_BUDGET, v->source,
                     "the volume needs %" PRIu64 " bytes and %" PRIu64 " of %" PRIu64
                     " are free; unload a volume or raise --memory",
                     bytes, left, budget);
    } else if (bytes > srv_fair_left(&pool, v->is_limited)) {
        ok = sp_fail(err, SP_ERR_BUDGET, v->source,
                     "the volume needs %" PRIu64 " bytes; the volumes of %s have %" PRIu64
                     " and may have %" PRIu64 " (its share of --memory); close some, or ask an "
                     "admin to open it",
                     bytes, v->owner, pool.own, pool.own + srv_fair_left(&pool, true));
    } else {
        srv_catalog_acquire_bytes(catalog, load->volume, bytes);
    }
    pthread_mutex_unlock(&catalog->mutex);
    srv_catalog_free_steps(catalog, evicted);
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
    const struct load *load = user;
    struct srv_catalog *catalog = load->catalog;
    struct srv_volume *v = load->volume;
    double now_ms = srv_clock_ms();
    pthread_mutex_lock(&catalog->mutex);
    bool continues = !catalog->stop && !srv_catalog_entry_of(v)->is_removed &&
                     !srv_catalog_is_step_unwanted(catalog, v);
    bool is_due = !v->parent && now_ms - v->notified_ms >= PROGRESS_MS;
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

/* Loads of time steps are frequent: only their failures are logged by default. */
static void log_load(const struct srv_volume *v, const struct sp_volume *volume,
                     const struct sp_error *err, double took_ms, bool is_ahead) {
    const enum sp_log_level level = v->parent ? SP_LOG_DEBUG : SP_LOG_INFO;
    char step[32] = "";
    if (v->parent)
        snprintf(step, sizeof step, ", step %u", v->step);
    if (volume) {
        const struct sp_volume_info *info = sp_volume_info(volume);
        const uint32_t *dims = info->grid.dims;
        char size[48];
        if (info->elements.kind == SP_KIND_GRID)
            snprintf(size, sizeof size, "%ux%ux%u %s", dims[0], dims[1], dims[2],
                     sp_type_name(info->type));
        else
            snprintf(size, sizeof size, "%u elements (%s)", info->elements.count,
                     sp_kind_name(info->elements.kind));
        sp_log_with(level, SP_LOG_FIELDS({ "volume", v->id }),
                    "volume %s%s loaded: %s, %" PRIu64 " bytes, %.0f ms", v->id, step, size,
                    sp_volume_bytes(info), took_ms);
        for (int i = 0; !v->parent && i < SP_WARNINGS_MAX && info->warnings[i][0]; i++)
            sp_log_with(SP_LOG_WARN, SP_LOG_FIELDS({ "volume", v->id }), "volume %s: %s", v->id,
                        info->warnings[i]);
    } else if (err->code == SP_ERR_CANCELLED || (is_ahead && err->code == SP_ERR_BUDGET)) {
        sp_log_with(level, SP_LOG_FIELDS({ "volume", v->id }),
                    "loading of volume %s%s was cancelled: %s", v->id, step, err->text);
    } else {
        sp_log_with(SP_LOG_ERROR, SP_LOG_FIELDS({ "volume", v->id }),
                    "volume %s%s failed to load: %s%s%s", v->id, step, err->place,
                    err->place[0] ? ": " : "", err->text);
    }
}

/* True if loading the same source again can help. */
static bool may_succeed_later(enum sp_code code) {
    return code != SP_ERR_FORMAT && code != SP_ERR_UNSUPPORTED && code != SP_ERR_INVALID &&
           code != SP_ERR_DENIED;
}

/* A load that failed is not tried again after a restart, unless the volume comes from an earlier
 * run, where its sessions wait for it, and may load again. With the mutex held. */
static void forget_failed(struct srv_catalog *catalog, struct srv_volume *v) {
    if (!catalog->options.persist || !v->is_persisted ||
        (v->is_restored && may_succeed_later(v->error.code)))
        return;
    catalog->options.persist(catalog->options.user, v->id, NULL);
    v->is_persisted = false;
}

/* The entry becomes ready or failed, or is freed if it was removed meanwhile. `volume`: the
 * reference is taken over; NULL = the load failed. */
static void end_load(struct srv_catalog *catalog, struct srv_volume *v, struct sp_volume *volume,
                     const struct sp_error *err) {
    char id[SP_NAME_BYTES], reason[SP_ERROR_PLACE + SP_ERROR_TEXT + 4] = "";
    pthread_mutex_lock(&catalog->notify_mutex);
    pthread_mutex_lock(&catalog->mutex);
    v->is_loading = false; /* from here on srv_catalog_remove() frees the entry */
    v->volume = volume;
    v->step = v->last_step = volume ? sp_volume_info(volume)->steps.index : 0;
    v->error = *err;
    bool was_removed = v->is_removed;
    bool was_stopped = !volume && !was_removed && err->code == SP_ERR_CANCELLED;
    v->state = volume ? SRV_VOLUME_READY : SRV_VOLUME_FAILED;
    srv_catalog_retry_steps(catalog);
    v->progress = volume ? 1 : v->progress;
    if (!volume && !was_removed) {
        srv_catalog_release_bytes(catalog, v);
        if (!was_stopped)
            forget_failed(catalog, v);
    }
    memcpy(id, v->id, sizeof id);
    if (!volume)
        snprintf(reason, sizeof reason, "%s%s%s", err->place, err->place[0] ? ": " : "", err->text);
    double fraction = v->progress;
    /* The other steps of a series are read from the file when a view shows them. */
    bool needs_file = volume && !was_removed && sp_volume_info(volume)->steps.count > 1;
    /* The entry may be removed by another thread as soon as the mutex is free. */
    char *upload = was_stopped || needs_file ? NULL : srv_catalog_upload_to_close(catalog, v);
    pthread_mutex_unlock(&catalog->mutex);
    if (upload)
        srv_catalog_close_upload(catalog, upload,
                                 was_removed ? SRV_VOLUME_UNLOADED
                                 : volume    ? SRV_VOLUME_READY
                                             : SRV_VOLUME_FAILED);
    free(upload);
    if (was_removed)
        srv_catalog_entry_free(v);
    else
        notify(catalog, id, volume ? SRV_VOLUME_READY : SRV_VOLUME_FAILED, fraction, reason);
    pthread_mutex_unlock(&catalog->notify_mutex);
}

/* Loads a volume that does not fit into memory from the brick cache. If it cannot be converted
 * (SP_ERR_UNSUPPORTED), *err keeps the first error, with the reason appended. */
static struct sp_volume *load_cached(struct srv_catalog *catalog, const char *file,
                                     const struct sp_load_options *options, struct sp_error *err) {
    struct sp_error why;
    struct sp_volume *volume = srv_brick_cache_load(catalog->options.cache, file, options, &why);
    if (volume)
        return volume;
    if (why.code == SP_ERR_UNSUPPORTED) {
        const size_t used = strlen(err->text);
        snprintf(err->text + used, sizeof err->text - used, "; %.200s", why.text);
    } else {
        *err = why;
    }
    return NULL;
}

/* Maps the shared memory of an entry. It is not needed afterwards: the volume has the mapping, and
 * after a failure the client passes it again. */
static struct sp_volume *map(struct load *load, struct sp_error *err) {
    struct srv_volume *v = load->volume;
    struct sp_volume *volume = NULL;
    if (srv_array_memory_fingerprint(&v->fingerprint, err))
        volume = srv_array_memory_map(v->memory, v->name, reserve, load, err);
    srv_array_memory_destroy(&v->memory);
    return volume;
}

static void load(struct srv_catalog *catalog, struct srv_volume *v) {
    struct sp_error err = { .code = SP_OK };
    struct load own = { catalog, v };
    const struct srv_volume *entry = srv_catalog_entry_of(v);
    struct sp_load_options options = { .reserve = reserve,
                                       .progress = progress,
                                       .user = &own,
                                       .is_finest = catalog->options.cache != NULL,
                                       .subvolumes = catalog->brick_memory,
                                       .root = entry->confined ? catalog->data : NULL,
                                       .allowed_hosts = catalog->options.allowed_hosts,
                                       .importer = catalog->options.importer,
                                       .step = v->step,
                                       .has_step = v->parent != NULL };
    double start_ms = srv_clock_ms();
    if (!v->parent) {
        /* With the lock: after the last notification of an earlier entry with this id. */
        pthread_mutex_lock(&catalog->notify_mutex);
        notify(catalog, v->id, SRV_VOLUME_LOADING, 0, "");
        pthread_mutex_unlock(&catalog->notify_mutex);
    }
    const char *file = entry->file ? entry->file : entry->source;
    const bool is_memory = entry->memory != NULL;
    struct sp_volume *volume = is_memory ? map(&own, &err) : sp_volume_load(file, &options, &err);
    if (!volume && err.code == SP_ERR_BUDGET && catalog->options.cache && !is_memory)
        volume = load_cached(catalog, file, &options, &err);
    if (volume && !is_memory)
        v->fingerprint = srv_fingerprint_volume(volume);
    if (volume && !v->parent)
        sp_view_choose(&v->view, volume, v->id);
    pthread_mutex_lock(&catalog->mutex);
    const bool is_ahead = v->is_ahead;
    pthread_mutex_unlock(&catalog->mutex);
    log_load(v, volume, &err, srv_clock_ms() - start_ms, is_ahead);
    if (!volume)
        srv_catalog_redact(catalog, entry, &err);
    if (v->parent)
        srv_catalog_end_step(catalog, v, volume, &err);
    else
        end_load(catalog, v, volume, &err);
}

bool srv_catalog_may_load(const struct srv_catalog *catalog, const struct srv_volume *volume) {
    const char *owner = srv_catalog_entry_of(volume)->owner;
    unsigned own = 0;
    for (const struct srv_volume *v = catalog->entries; v; v = v->next) {
        if (strcmp(v->owner, owner) != 0)
            continue;
        own += v->is_loading;
        for (const struct srv_volume *step = v->steps; step; step = step->next)
            own += step->is_loading;
    }
    return catalog->loading + own < SRV_LOADERS;
}

/* The oldest entry that waits, of the owner whose loads took the least time. */
static struct srv_volume *waiting_entry(const struct srv_catalog *catalog) {
    struct srv_volume *first = NULL;
    double first_ms = 0;
    for (struct srv_volume *v = catalog->entries; v; v = v->next) {
        if (v->state != SRV_VOLUME_LOADING || v->is_loading || !srv_catalog_may_load(catalog, v))
            continue;
        const double start_ms = srv_fair_owners_start(&catalog->fair, v->owner);
        if (!first || start_ms < first_ms) {
            first = v;
            first_ms = start_ms;
        }
    }
    return first;
}

/* Returns the next entry to load: first volumes and time steps that clients wait for (the thread
 * decides which kind goes first), then steps that will be wanted soon. With the mutex held. */
static struct srv_volume *next_load(const struct srv_loader *loader) {
    struct srv_volume *entry = waiting_entry(loader->catalog);
    struct srv_volume *step = srv_catalog_wanted_step(loader->catalog);
    struct srv_volume *first = loader->prefers_steps ? step : entry;
    struct srv_volume *second = loader->prefers_steps ? entry : step;
    return first ? first : second ? second : srv_catalog_ahead_step(loader->catalog);
}

static void *load_thread(void *user) {
    const struct srv_loader *loader = user;
    struct srv_catalog *catalog = loader->catalog;
    pthread_mutex_lock(&catalog->mutex);
    while (!catalog->stop) {
        struct srv_volume *v = next_load(loader);
        if (!v) {
            pthread_cond_wait(&catalog->changed, &catalog->mutex);
            continue;
        }
        char owner[SRV_TOKEN_NAME_BYTES]; /* the load may free the entry */
        memcpy(owner, srv_catalog_entry_of(v)->owner, sizeof owner);
        const double start_ms = srv_clock_ms();
        v->is_loading = true;
        catalog->loading++;
        srv_fair_owners_begin(&catalog->fair, owner);
        if (v->parent) { /* stays while it is loaded */
            v->uses++;
            v->parent->uses++;
        }
        pthread_mutex_unlock(&catalog->mutex);
        load(catalog, v);
        pthread_mutex_lock(&catalog->mutex);
        catalog->loading--;
        srv_fair_owners_charge(&catalog->fair, owner, srv_clock_ms() - start_ms);
        pthread_cond_broadcast(&catalog->changed); /* another load of the owner may begin */
    }
    pthread_mutex_unlock(&catalog->mutex);
    return NULL;
}

bool srv_catalog_start_loaders(struct srv_catalog *catalog, struct sp_error *err) {
    for (unsigned i = 0; i < SRV_LOADERS; i++) {
        struct srv_loader *loader = &catalog->loaders[i];
        *loader = (struct srv_loader){ .catalog = catalog, .prefers_steps = i % 2 == 1 };
        int failed = pthread_create(&loader->thread, NULL, load_thread, loader);
        if (failed)
            return sp_fail(err, SP_ERR_IO, NULL, "cannot start a load thread: %s",
                           strerror(failed));
        catalog->running++;
    }
    return true;
}
