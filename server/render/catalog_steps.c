/* SPDX-License-Identifier: Apache-2.0
 *
 * The time steps of the catalog's volumes. An entry has the step that it was opened with. The
 * others are loaded when a view asks for them, and the next ones in the same direction ahead of
 * that. Steps stay loaded until memory is needed.
 *
 *   asked for ─► waiting ─► being loaded ─► loaded ─► evicted
 *                   │             └──────► failed, also if the volume is unloaded meanwhile
 *                   └─► dropped: its last user has left
 */
#include <stdlib.h>
#include <string.h>

#include "render/catalog_private.h"

enum { AHEAD = 2 }; /* steps that are loaded before someone asks for them */

static struct srv_volume *find_step(const struct srv_volume *entry, uint32_t number) {
    struct srv_volume *s = entry->steps;
    while (s && s->step != number)
        s = s->next;
    return s;
}

static void fail_removed(struct srv_volume *step) {
    step->state = SRV_VOLUME_FAILED;
    sp_fail(&step->error, SP_ERR_VOLUME_UNKNOWN, "/time/step",
            "the volume '%.100s' was unloaded before its time step %u was loaded", step->id,
            step->step);
}

/* Adds a step that waits; NULL = out of memory. */
static struct srv_volume *add_step(struct srv_catalog *catalog, struct srv_volume *entry,
                                   uint32_t number) {
    struct srv_volume *s = calloc(1, sizeof *s);
    if (!s)
        return NULL;
    memcpy(s->id, entry->id, sizeof s->id);
    memcpy(s->name, entry->name, sizeof s->name);
    s->parent = entry;
    s->step = number;
    s->state = SRV_VOLUME_LOADING;
    s->next = entry->steps;
    entry->steps = s;
    s->wanted_at = ++catalog->requests;
    return s;
}

static void unlink_step(struct srv_volume *step) {
    struct srv_volume **link = &step->parent->steps;
    while (*link != step)
        link = &(*link)->next;
    *link = step->next;
    step->next = NULL;
}

static bool is_queued(const struct srv_volume *step) {
    return step->state == SRV_VOLUME_LOADING && !step->is_loading;
}

/* Steps that were to be loaded ahead, and do not lie ahead any more. */
static struct srv_volume *drop_ahead(struct srv_volume *entry) {
    struct srv_volume *dropped = NULL;
    for (struct srv_volume *s = entry->steps, *next; s; s = next) {
        next = s->next;
        if (!is_queued(s) || s->uses > 0)
            continue;
        unlink_step(s);
        s->next = dropped;
        dropped = s;
    }
    return dropped;
}

/* Has the steps after `number` loaded, in the direction from the last one, round the ends. */
static void look_ahead(struct srv_catalog *catalog, struct srv_volume *entry, uint32_t number) {
    const uint32_t count = sp_volume_info(entry->volume)->steps.count;
    const uint32_t back = (entry->last_step + count - 1) % count;
    const uint32_t way = number == back && count > 2 ? count - 1 : 1;
    for (uint32_t i = 1; i <= AHEAD && i < count; i++) {
        const uint32_t next = (uint32_t)((number + (uint64_t)i * way) % count);
        struct srv_volume *s =
            next == entry->step || find_step(entry, next) ? NULL : add_step(catalog, entry, next);
        if (s)
            s->is_ahead = true;
    }
    entry->last_step = number;
}

struct srv_volume *srv_catalog_step(void *user, struct srv_volume *entry, uint32_t number) {
    struct srv_catalog *catalog = user;
    struct srv_volume *step, *dropped = NULL;
    pthread_mutex_lock(&catalog->mutex);
    const bool is_new = number != entry->last_step;
    if (is_new)
        dropped = drop_ahead(entry);
    step = number == entry->step ? entry : find_step(entry, number);
    if (!step)
        step = add_step(catalog, entry, number);
    if (step && step->parent) {
        step->uses++;
        step->is_ahead = step->is_left = false;
        step->wanted_at = ++catalog->requests;
        if (step->state == SRV_VOLUME_FAILED)
            step->state = SRV_VOLUME_LOADING; /* another try */
        if (is_queued(step) && entry->is_removed)
            fail_removed(step);
    }
    if (step)
        entry->uses++;
    if (step && is_new)
        look_ahead(catalog, entry, number);
    pthread_cond_broadcast(&catalog->changed);
    pthread_mutex_unlock(&catalog->mutex);
    srv_catalog_free_steps(catalog, dropped);
    return step;
}

bool srv_catalog_step_is_ready(void *user, struct srv_volume *step, struct sp_error *err) {
    struct srv_catalog *catalog = user;
    pthread_mutex_lock(&catalog->mutex);
    const enum srv_volume_state state = step->state;
    if (state == SRV_VOLUME_FAILED && err)
        *err = step->error;
    else if (state == SRV_VOLUME_LOADING)
        sp_fail(err, SP_ERR_NOT_READY, "/time/step", "time step %u of the volume '%s' is loading",
                step->step, step->id);
    pthread_mutex_unlock(&catalog->mutex);
    return state == SRV_VOLUME_READY;
}

/* Releases a step, which is loaded nevertheless. */
static void leave_step(struct srv_catalog *catalog, struct srv_volume *step) {
    pthread_mutex_lock(&catalog->mutex);
    step->is_ahead = step->is_left = step->parent && step->state == SRV_VOLUME_LOADING;
    pthread_mutex_unlock(&catalog->mutex);
    srv_catalog_release(catalog, step);
}

struct srv_volume *srv_catalog_ready_step(struct srv_catalog *catalog, struct srv_volume *volume,
                                          uint32_t number, struct sp_error *err) {
    struct srv_volume *step = srv_catalog_step(catalog, volume, number);
    srv_catalog_release(catalog, volume);
    if (!step)
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a time step");
    if (!step || srv_catalog_step_is_ready(catalog, step, err))
        return step;
    leave_step(catalog, step);
    return NULL;
}

uint32_t srv_catalog_steps(void *user, struct srv_volume *volume) {
    (void)user;
    return sp_volume_info(srv_catalog_entry_of(volume)->volume)->steps.count;
}

/* With the mutex held. */
static struct srv_volume *find_nearest(struct srv_volume *entry, uint32_t number) {
    struct srv_volume *nearest = entry;
    for (struct srv_volume *s = entry->steps; s; s = s->next)
        if (s->state == SRV_VOLUME_READY &&
            llabs((long long)s->step - number) < llabs((long long)nearest->step - number))
            nearest = s;
    return nearest;
}

struct srv_volume *srv_catalog_nearest_step(void *user, struct srv_volume *entry, uint32_t number) {
    struct srv_catalog *catalog = user;
    pthread_mutex_lock(&catalog->mutex);
    struct srv_volume *nearest = find_nearest(entry, number);
    entry->uses++;
    nearest->uses += nearest != entry;
    pthread_mutex_unlock(&catalog->mutex);
    return nearest;
}

/* The step of another volume that a frame of the step `number` of `volume` shows: it follows a
 * series, up to its own last step. */
static uint32_t number_beside(const struct srv_volume *volume, const struct srv_volume *other,
                              uint32_t number) {
    const uint32_t count = sp_volume_info(other->volume)->steps.count;
    if (sp_volume_info(srv_catalog_entry_of(volume)->volume)->steps.count < 2)
        return other->step;
    return number < count ? number : count - 1;
}

/* Returns a use of the entry of this id if it is a series, and the step that is shown of it. */
static struct srv_volume *use_series(struct srv_catalog *catalog, const struct srv_volume *volume,
                                     const char *id, uint32_t *number) {
    pthread_mutex_lock(&catalog->mutex);
    struct srv_volume *v = *id ? srv_catalog_entry(catalog, id) : NULL;
    if (v && (v->state != SRV_VOLUME_READY || sp_volume_info(v->volume)->steps.count < 2))
        v = NULL;
    if (v) {
        v->uses++;
        *number = number_beside(volume, v, *number);
    }
    pthread_mutex_unlock(&catalog->mutex);
    return v;
}

bool srv_catalog_other_steps(void *user, struct srv_volume *volume, const struct sp_view *view,
                             struct srv_volume *steps[2 * SP_LAYERS_MAX], unsigned *count) {
    *count = 0;
    for (uint32_t i = 0; i < 2 * view->layer_count; i++) {
        const struct sp_layer *layer = &view->layers[i / 2];
        uint32_t number = view->time.step;
        struct srv_volume *entry =
            layer->visible ? use_series(user, volume, i % 2 ? layer->color_by : layer->id, &number)
                           : NULL;
        if (!entry)
            continue;
        steps[*count] = srv_catalog_step(user, entry, number);
        srv_catalog_release(user, entry);
        if (!steps[*count])
            return false;
        ++*count;
    }
    return true;
}

struct sp_volume *srv_catalog_find_loaded(void *user, const char *id) {
    struct srv_loaded_search *search = user;
    struct srv_catalog *catalog = search->catalog;
    struct sp_volume *volume = NULL;
    pthread_mutex_lock(&catalog->mutex);
    struct srv_volume *v = srv_catalog_entry(catalog, id);
    if (v && v->state == SRV_VOLUME_READY) {
        const uint32_t wanted = number_beside(search->volume, v, search->step);
        const struct srv_volume *nearest = find_nearest(v, wanted);
        search->is_other |= nearest->step != wanted;
        volume = sp_volume_ref(nearest->volume);
    }
    pthread_mutex_unlock(&catalog->mutex);
    return volume;
}

/* Of the steps that wait to be loaded, with or without users, the one asked for last; of those to
 * be loaded ahead, the first one. */
static struct srv_volume *next_step(const struct srv_catalog *catalog, bool is_ahead) {
    struct srv_volume *next = NULL;
    for (struct srv_volume *v = catalog->entries; v; v = v->next)
        for (struct srv_volume *s = v->steps; s; s = s->next)
            if (is_queued(s) && !s->is_short && (s->uses == 0) == is_ahead &&
                srv_catalog_may_load(catalog, s) &&
                (!next ||
                 (is_ahead ? s->wanted_at < next->wanted_at : s->wanted_at > next->wanted_at)))
                next = s;
    return next;
}

struct srv_volume *srv_catalog_wanted_step(const struct srv_catalog *catalog) {
    return next_step(catalog, false);
}

struct srv_volume *srv_catalog_ahead_step(const struct srv_catalog *catalog) {
    return next_step(catalog, true);
}

bool srv_catalog_is_step_unwanted(const struct srv_catalog *catalog,
                                  const struct srv_volume *step) {
    if (!step->parent || step->uses > 1) /* 1: its loader */
        return false;
    for (const struct srv_volume *v = catalog->entries; v; v = v->next)
        for (const struct srv_volume *s = v->steps; s; s = s->next)
            if (is_queued(s) && s->uses > 0)
                return true;
    return false;
}

void srv_catalog_retry_steps(struct srv_catalog *catalog) {
    for (struct srv_volume *v = catalog->entries; v; v = v->next)
        for (struct srv_volume *s = v->steps; s; s = s->next)
            s->is_short = false;
    pthread_cond_broadcast(&catalog->changed);
}

/* True if another load may give memory back. */
static bool is_loading_others(const struct srv_catalog *catalog) {
    for (const struct srv_volume *v = catalog->entries; v; v = v->next) {
        if (v->is_loading)
            return true;
        for (const struct srv_volume *s = v->steps; s; s = s->next)
            if (s->is_loading)
                return true;
    }
    return false;
}

/* Bytes of the volumes that the owner of `v` opened by limited requests, with their time steps. */
static uint64_t bytes_of_owner(const struct srv_catalog *catalog, const struct srv_volume *v) {
    uint64_t bytes = 0;
    for (const struct srv_volume *e = catalog->entries; e; e = e->next) {
        if (!e->is_limited || strcmp(e->owner, v->owner) != 0)
            continue;
        bytes += e->reserved_bytes;
        for (const struct srv_volume *step = e->steps; step; step = step->next)
            bytes += step->reserved_bytes;
    }
    return bytes;
}

struct srv_pool srv_catalog_pool(struct srv_catalog *catalog, const struct srv_volume *entry) {
    return (struct srv_pool){ srv_catalog_free_bytes(catalog) + catalog->used_bytes,
                              catalog->used_bytes, bytes_of_owner(catalog, entry) };
}

/* A step that is loaded ahead does not evict others that are, unless someone asks for it again and
 * again. `owner`: only of its volumes; NULL = of all. */
static struct srv_volume *oldest_unused(const struct srv_catalog *catalog,
                                        const struct srv_volume *loading, const char *owner) {
    struct srv_volume *oldest = NULL;
    for (struct srv_volume *v = catalog->entries; v; v = v->next)
        for (struct srv_volume *s = v->steps; s; s = s->next)
            if (s->state == SRV_VOLUME_READY && s->uses == 0 &&
                (!owner || strcmp(v->owner, owner) == 0) &&
                !(loading->is_ahead && !loading->is_left && s->is_ahead) &&
                (!oldest || s->wanted_at < oldest->wanted_at))
                oldest = s;
    return oldest;
}

/* Whose step goes so that `bytes` fit: of any volume if memory is short, of the owner if its share
 * is used up; NULL = they fit, or nothing helps. */
static struct srv_volume *step_to_evict(struct srv_catalog *catalog,
                                        const struct srv_volume *loading, uint64_t bytes) {
    const struct srv_volume *entry = srv_catalog_entry_of(loading);
    const struct srv_pool pool = srv_catalog_pool(catalog, entry);
    if (bytes > catalog->options.memory_bytes)
        return NULL;
    if (bytes > srv_catalog_free_bytes(catalog))
        return oldest_unused(catalog, loading, NULL);
    return bytes > srv_fair_left(&pool, entry->is_limited)
               ? oldest_unused(catalog, loading, entry->owner)
               : NULL;
}

struct srv_volume *srv_catalog_evict_steps(struct srv_catalog *catalog,
                                           const struct srv_volume *loading, uint64_t bytes) {
    struct srv_volume *evicted = NULL, *s;
    while ((s = step_to_evict(catalog, loading, bytes))) {
        srv_catalog_release_bytes(catalog, s);
        unlink_step(s);
        s->next = evicted;
        evicted = s;
    }
    return evicted;
}

bool srv_catalog_fail_steps(struct srv_volume *entry) {
    bool has_failed = false;
    for (struct srv_volume *s = entry->steps; s; s = s->next)
        if (is_queued(s)) {
            fail_removed(s);
            has_failed = true;
        }
    return has_failed;
}

void srv_catalog_free_steps(struct srv_catalog *catalog, struct srv_volume *steps) {
    while (steps) {
        struct srv_volume *step = steps;
        steps = step->next;
        if (step->volume)
            catalog->options.unloaded(catalog->options.user, sp_volume_ref(step->volume));
        srv_catalog_entry_free(step);
    }
}

struct srv_volume *srv_catalog_drop_step(struct srv_volume *step) {
    if (step->uses > 0 || step->is_loading || step->is_ahead || step->state == SRV_VOLUME_READY)
        return NULL;
    unlink_step(step);
    return step;
}

/* An error for clients: which step, and why. */
static void explain(const struct srv_volume *step, const struct sp_error *why,
                    struct sp_error *err) {
    const bool is_damaged =
        why->code != SP_ERR_BUDGET && why->code != SP_ERR_MEMORY && why->code != SP_ERR_CANCELLED;
    sp_fail(err, is_damaged ? SP_ERR_VOLUME_FAILED : why->code, "/time/step",
            "time step %u of the volume '%.100s' cannot be loaded: %.100s%s%.200s", step->step,
            step->id, why->place, why->place[0] ? ": " : "", why->text);
}

void srv_catalog_end_step(struct srv_catalog *catalog, struct srv_volume *step,
                          struct sp_volume *volume, const struct sp_error *err) {
    pthread_mutex_lock(&catalog->mutex);
    step->is_loading = false;
    step->volume = volume;
    if (!volume)
        explain(step, err, &step->error);
    /* Someone who has come since a load was cancelled or found no memory gets another one. */
    const bool is_short = !volume && err->code == SP_ERR_BUDGET && is_loading_others(catalog);
    const bool again = !volume && step->uses > 1 && (err->code == SP_ERR_CANCELLED || is_short);
    step->state = volume ? SRV_VOLUME_READY : again ? SRV_VOLUME_LOADING : SRV_VOLUME_FAILED;
    if (!volume && step->parent->is_removed)
        fail_removed(step);
    srv_catalog_retry_steps(catalog);
    step->is_short = is_short && step->state == SRV_VOLUME_LOADING;
    step->is_ahead = step->is_ahead && volume;
    if (!volume)
        srv_catalog_release_bytes(catalog, step);
    char id[SP_NAME_BYTES];
    memcpy(id, step->id, sizeof id);
    struct srv_volume *entry = step->parent, *dropped;
    /* Before the next load begins: it may need the memory of this step. */
    const bool is_last = srv_catalog_let_go(step, &dropped);
    pthread_mutex_unlock(&catalog->mutex);
    if (catalog->options.step)
        catalog->options.step(catalog->options.user, id);
    srv_catalog_free_steps(catalog, dropped);
    if (is_last)
        srv_catalog_free_removed(catalog, entry);
}
