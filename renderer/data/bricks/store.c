/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "data/bricks/places.h"
#include "data/bricks/store_private.h"
#include "data/volume/volume.h"

enum { MANY_BRICKS = 64 }; /* from so many on, a coarser level is read first */
static const double poll_ms = 20;

struct sp_brick_store *sp_brick_store_of(const struct sp_volume *volume) {
    return sp_volume_source(volume);
}

const struct sp_brick_file *sp_brick_store_file(const struct sp_brick_store *store) {
    return store->file;
}

unsigned sp_brick_store_base(const struct sp_brick_store *store) {
    return store->base_level;
}

uint64_t sp_brick_store_subvolume_max(const struct sp_brick_store *store) {
    return sp_brick_memory_subvolume_max(store->memory, store);
}

bool sp_brick_store_is_alone(const struct sp_brick_store *store) {
    return sp_brick_memory_is_alone(store->memory, store);
}

static const struct sp_brick_level *level_of(const struct sp_brick_store *store, unsigned level) {
    return &sp_brick_file_header(store->file)->level[level];
}

/* Places the samples of an axis of the grid. Returns where coordinates of other axes go. */
static double *place_axis(const struct sp_brick_header *header, unsigned l, int a, uint32_t first,
                          struct sp_grid *grid, double *numbers) {
    const struct sp_brick_level *level = &header->level[l];
    const double *places = level->places[a];
    const uint32_t count = grid->dims[a];
    grid->spacing[a] *= level->step[a];
    grid->coordinates[a] = NULL;
    if (!places)
        return numbers;
    if (count == 1) { /* the only sample: it keeps the width that it has among its neighbours */
        grid->spacing[a] = sp_brick_distance(header, l, a, first + 0.5) -
                           sp_brick_distance(header, l, a, first - 0.5);
        return numbers;
    }
    for (uint32_t i = 0; i < count; i++)
        numbers[i] = places[first + i] - places[first];
    grid->coordinates[a] = numbers;
    return numbers + count;
}

bool sp_brick_store_grid(const struct sp_brick_store *store, const struct sp_brick_need *need,
                         struct sp_grid *grid, double **numbers) {
    const struct sp_brick_header *header = sp_brick_file_header(store->file);
    const struct sp_brick_level *level = level_of(store, need->level);
    uint32_t first[3];
    *grid = header->info.grid;
    sp_brick_need_box(need, level, first, grid->dims);
    double *next = *numbers = malloc(sp_grid_axes_max(grid) * sizeof *next);
    if (!next)
        return false;
    for (int a = 0; a < 3; a++) {
        const double offset = sp_brick_distance(header, need->level, a, first[a]);
        next = place_axis(header, need->level, a, first[a], grid, next);
        for (int r = 0; r < 3; r++)
            grid->origin[r] += grid->direction[r][a] * offset;
    }
    return true;
}

struct sp_whole_part sp_brick_store_part(const struct sp_brick_store *store,
                                         const struct sp_brick_need *need) {
    const struct sp_brick_level *level = level_of(store, need->level);
    struct sp_whole_part part = { .level = need->level };
    uint32_t size[3];
    sp_brick_need_box(need, level, part.first, size);
    memcpy(part.dims, level->dims, sizeof part.dims);
    memcpy(part.step, level->step, sizeof part.step);
    return part;
}

const float (*sp_brick_store_vectors(const struct sp_brick_store *store,
                                     const struct sp_brick_need *need, const void *samples))[3] {
    if (!need->has_vectors || !samples)
        return NULL;
    return (const float(*)[3])(const void *)((const char *)samples +
                                             sp_brick_need_vectors_at(store->file, need));
}

void sp_brick_subvolume_clear(struct sp_brick_store_subvolume *w) {
    sp_volume_unref(&w->volume);
    free(w->need.wanted);
    free(w->lost);
    *w = (struct sp_brick_store_subvolume){ .volume = NULL };
}

void sp_brick_request_clear(struct sp_brick_request *r) {
    free(r->need.wanted);
    *r = (struct sp_brick_request){ .asked = 0 };
}

/* With the mutex held: the subvolume that has all of a need; NULL = none. */
static struct sp_brick_store_subvolume *find_subvolume(struct sp_brick_store *store,
                                                       const struct sp_brick_need *need) {
    for (int i = 0; i < BRICK_SUBVOLUMES_MAX; i++)
        if (store->subvolumes[i].volume && sp_brick_need_is_in(need, &store->subvolumes[i].need))
            return &store->subvolumes[i];
    return NULL;
}

/* With the mutex held: true if a chunk of the subvolume could not be read and it is time to try
 * again: the network may work now. A damaged file is not read again. */
static bool is_due(const struct sp_brick_store *store, const struct sp_brick_store_subvolume *w) {
    return w->lost_count > 0 && sp_brick_file_chunks(store->file) &&
           sp_clock_ms() - w->read_ms >= store->retry_ms;
}

/* Wants the bricks of a coarser level that cover brick i, and which matter as much as it. */
static void mark_coarser(const struct sp_brick_level *from, const struct sp_brick_level *to,
                         const struct sp_brick_need *need, uint64_t i, struct sp_brick_need *out) {
    uint32_t first[3] = { need->first[0] + (uint32_t)(i % need->count[0]),
                          need->first[1] + (uint32_t)(i / need->count[0] % need->count[1]),
                          need->first[2] + (uint32_t)(i / need->count[0] / need->count[1]) };
    uint32_t count[3] = { 1, 1, 1 };
    for (int a = 0; a < 3; a++) {
        sp_brick_level_map(from, to, a, &first[a], &count[a]);
        first[a] -= out->first[a];
    }
    for (uint32_t z = first[2]; z < first[2] + count[2]; z++)
        for (uint32_t y = first[1]; y < first[1] + count[1]; y++)
            for (uint32_t x = first[0]; x < first[0] + count[0]; x++) {
                uint16_t *own = &out->wanted[((uint64_t)z * out->count[1] + y) * out->count[0] + x];
                const uint16_t number =
                    need->wanted[i] > BRICK_WANTED ? need->wanted[i] : BRICK_WANTED;
                *own = *own > number ? *own : number;
            }
}

bool sp_brick_store_coarsen(const struct sp_brick_store *store, const struct sp_brick_need *need,
                            unsigned steps, struct sp_brick_need *out) {
    *out = (struct sp_brick_need){ .level = need->level + steps, .is_sparse = need->is_sparse };
    if (out->level >= store->base_level)
        return false;
    const struct sp_brick_level *from = level_of(store, need->level),
                                *to = level_of(store, out->level);
    memcpy(out->first, need->first, sizeof out->first);
    memcpy(out->count, need->count, sizeof out->count);
    out->has_vectors = need->has_vectors;
    for (int a = 0; a < 3; a++)
        sp_brick_level_map(from, to, a, &out->first[a], &out->count[a]);
    if (!sp_brick_need_allocate(out, 0))
        return false;
    for (uint64_t i = 0; i < sp_brick_need_count(need); i++)
        if (need->wanted[i])
            mark_coarser(from, to, need, i, out);
    return true;
}

/* Counts the bricks of a need of which one of `arrays` could not be read, and finds one of them.
 * `lost` is by brick of the box `have`; `need` NULL = all of them count. */
static void count_lost(const struct sp_brick_store *store, const struct sp_brick_need *have,
                       const uint8_t *lost, const struct sp_brick_need *need, unsigned arrays,
                       struct sp_brick_subvolume *out) {
    const struct sp_brick_level *level = level_of(store, have->level);
    for (uint64_t i = 0; i < sp_brick_need_count(have); i++) {
        uint64_t at;
        const bool counts = (lost[i] & arrays) &&
                            (!need || (sp_brick_need_find(have, i, need, &at) && need->wanted[at]));
        if (counts && !out->lost++)
            sp_brick_store_box(store, have->level, sp_brick_need_at(have, level, i), out->lost_box);
    }
}

/* The wanted bricks of a need that a subvolume shows coarsely. */
static uint64_t count_missing(const struct sp_brick_need *need, const struct sp_brick_need *have) {
    uint64_t count = 0, at;
    for (uint64_t i = 0; i < sp_brick_need_count(need); i++)
        count += need->wanted[i] >= BRICK_WANTED && sp_brick_need_find(need, i, have, &at) &&
                 have->wanted[at] == BRICK_COARSE;
    return count;
}

/* Describes a subvolume for a need of its level, or of a finer one: then all of it counts. */
static void describe(const struct sp_brick_store *store, struct sp_brick_store_subvolume *w,
                     const struct sp_brick_need *need, struct sp_brick_subvolume *out) {
    const bool is_own = need->level == w->need.level;
    out->volume = sp_volume_ref(w->volume);
    out->level = w->need.level;
    out->bytes = w->bytes;
    out->missing = is_own ? count_missing(need, &w->need) : 0;
    const bool is_fine = is_own && !out->missing && !sp_brick_need_coarse(need);
    out->coarsest = is_fine ? w->need.level : w->coarsest;
    if (w->lost_count)
        count_lost(store, &w->need, w->lost, is_own ? need : NULL, sp_brick_need_arrays(need), out);
    sp_brick_need_box(&w->need, level_of(store, w->need.level), out->first, out->size);
}

/* Describes the base, without a reference. */
static void describe_base(struct sp_brick_store *store, bool has_vectors,
                          struct sp_brick_subvolume *out) {
    const unsigned arrays = has_vectors ? BRICK_SAMPLES | BRICK_VECTORS : BRICK_SAMPLES;
    *out = (struct sp_brick_subvolume){ .volume = store->base,
                                        .level = store->base_level,
                                        .coarsest = store->base_level };
    count_lost(store, &store->base_need, store->base_lost, NULL, arrays, out);
    sp_brick_need_box(&store->base_need, level_of(store, out->level), out->first, out->size);
}

void sp_brick_store_get_base(struct sp_brick_store *store, bool has_vectors,
                             struct sp_brick_subvolume *out) {
    describe_base(store, has_vectors, out);
    sp_volume_ref(out->volume);
}

/* With the mutex held: the finest subvolume of a coarser level that covers a need; NULL = the base.
 */
static struct sp_brick_store_subvolume *find_coarser(struct sp_brick_store *store,
                                                     const struct sp_brick_need *need) {
    struct sp_brick_store_subvolume *w = NULL;
    struct sp_brick_need coarse;
    for (unsigned steps = 1; !w && sp_brick_store_coarsen(store, need, steps, &coarse); steps++) {
        w = find_subvolume(store, &coarse);
        free(coarse.wanted);
    }
    if (w)
        w->used = ++store->memory->clock;
    return w;
}

/* With the mutex held: chooses what a frame shows until its subvolume is read. */
static void choose_fallback(struct sp_brick_store *store, const struct sp_brick_need *need,
                            struct sp_brick_subvolume *out) {
    for (int i = 0; i < BRICK_SUBVOLUMES_MAX; i++) {
        struct sp_brick_store_subvolume *w = &store->subvolumes[i];
        if (w->volume && w->is_partial && sp_brick_need_is_covered(need, &w->need)) {
            w->used = ++store->memory->clock;
            describe(store, w, need, out);
            return;
        }
    }
    struct sp_brick_store_subvolume *w = find_coarser(store, need);
    if (w)
        describe(store, w, need, out);
    else
        sp_brick_store_get_base(store, need->has_vectors, out);
}

static bool is_stopped(const struct sp_brick_store *store) {
    return atomic_load_explicit(&store->stop, memory_order_relaxed);
}

void sp_brick_store_publish(struct sp_brick_store *store, struct sp_brick_store_subvolume *made) {
    for (int i = 0; i < BRICK_SUBVOLUMES_MAX; i++) {
        struct sp_brick_store_subvolume *w = &store->subvolumes[i];
        if (w->volume && (w->is_partial || sp_brick_need_is_in(&w->need, &made->need)))
            sp_brick_subvolume_clear(w);
    }
    sp_brick_memory_make_space(store->memory, store, made->bytes);
    for (int i = 0; i < BRICK_SUBVOLUMES_MAX; i++)
        if (!store->subvolumes[i].volume) {
            store->subvolumes[i] = *made;
            store->subvolumes[i].used = ++store->memory->clock;
            break;
        }
    store->published++;
    pthread_cond_broadcast(&store->done);
}

/* Reads a need and publishes the subvolume. With the mutex held, which is released meanwhile. */
static bool serve(struct sp_brick_store *store, struct sp_brick_need *need, struct sp_error *err) {
    struct sp_brick_store_subvolume made;
    const uint64_t cost = sp_brick_need_cost(store->file, need);
    struct sp_brick_subvolume coarser = { .volume = NULL };
    struct sp_brick_store_subvolume *from = find_coarser(store, need);
    if (from)
        describe(store, from, need, &coarser);
    else /* without a reference: the base waits for this thread when it is destroyed */
        describe_base(store, need->has_vectors, &coarser);
    sp_brick_memory_make_space(store->memory, store, cost);
    store->memory->reading += cost;
    pthread_mutex_unlock(&store->memory->mutex);
    bool ok = sp_brick_store_fill(store, need, &coarser, &made, err);
    pthread_mutex_lock(&store->memory->mutex);
    if (from)
        sp_volume_unref(&coarser.volume);
    store->memory->reading -= cost;
    if (ok) {
        sp_brick_store_publish(store, &made);
        return true;
    }
    sp_brick_subvolume_clear(&made);
    for (int i = 0; i < BRICK_SUBVOLUMES_MAX; i++)
        if (store->subvolumes[i].is_partial)
            sp_brick_subvolume_clear(&store->subvolumes[i]);
    return false;
}

/* With the mutex held: the request that was asked for last; NULL = none waits. */
static struct sp_brick_request *newest(struct sp_brick_store *store) {
    struct sp_brick_request *newest = NULL;
    for (int i = 0; i < BRICK_QUEUE_MAX; i++) {
        struct sp_brick_request *r = &store->queue[i];
        if (r->need.wanted && !r->has_failed && (!newest || r->asked > newest->asked))
            newest = r;
    }
    return newest;
}

/* What is read first for a request: a coarser level if there are many bricks to read and nothing
 * finer than the base shows them yet, and that of bricks that are shown coarsely. With the mutex
 * held. Copies; false without memory. */
static bool choose_step(struct sp_brick_store *store, const struct sp_brick_need *need,
                        struct sp_brick_need *step) {
    struct sp_brick_need coarse;
    if (sp_brick_need_coarse(need) && sp_brick_store_coarsen(store, need, 1, &coarse)) {
        const bool is_there = find_subvolume(store, &coarse) != NULL;
        const bool ok = is_there || choose_step(store, &coarse, step);
        free(coarse.wanted);
        if (!is_there)
            return ok;
    }
    for (unsigned steps = 1;
         sp_brick_need_wanted(need) >= (uint64_t)MANY_BRICKS << 3 * (steps - 1) &&
         sp_brick_store_coarsen(store, need, steps, &coarse);
         steps++) {
        const bool is_there = find_subvolume(store, &coarse) != NULL;
        if (!is_there && sp_brick_need_wanted(&coarse) < MANY_BRICKS) {
            *step = coarse;
            return true;
        }
        free(coarse.wanted);
        if (is_there)
            break;
    }
    return sp_brick_need_copy(need, step);
}

static bool is_same(const struct sp_brick_need *a, const struct sp_brick_need *b) {
    return sp_brick_need_is_in(a, b) && sp_brick_need_is_in(b, a);
}

/* With the mutex held. */
static void note_failure(struct sp_brick_store *store, const struct sp_brick_need *need,
                         const struct sp_error *why) {
    for (int i = 0; i < BRICK_QUEUE_MAX; i++) {
        struct sp_brick_request *r = &store->queue[i];
        if (r->need.wanted && is_same(need, &r->need)) {
            r->has_failed = true;
            r->why = *why;
        }
    }
    pthread_cond_broadcast(&store->done);
}

void *sp_brick_store_read(void *user) {
    struct sp_brick_store *store = user;
    pthread_mutex_lock(&store->memory->mutex);
    while (!is_stopped(store)) {
        struct sp_brick_request *r = newest(store);
        struct sp_brick_need step;
        struct sp_error err = { .code = SP_ERR_MEMORY, .text = "out of memory for bricks" };
        if (!r) {
            pthread_cond_wait(&store->asked, &store->memory->mutex);
            continue;
        }
        const struct sp_brick_store_subvolume *w = find_subvolume(store, &r->need);
        if (w && !is_due(store, w)) {
            sp_brick_request_clear(r);
            continue;
        }
        struct sp_brick_need need;
        if (!sp_brick_need_copy(&r->need, &need)) {
            note_failure(store, &r->need, &err);
            continue;
        }
        if (!choose_step(store, &need, &step) || !serve(store, &step, &err))
            note_failure(store, &need, &err);
        free(need.wanted);
    }
    pthread_mutex_unlock(&store->memory->mutex);
    return NULL;
}

/* With the mutex held: asks the thread for a need. NULL without memory. */
static struct sp_brick_request *ask(struct sp_brick_store *store,
                                    const struct sp_brick_need *need) {
    struct sp_brick_request *r = &store->queue[0];
    for (int i = 0; i < BRICK_QUEUE_MAX; i++) {
        if (store->queue[i].need.wanted && is_same(need, &store->queue[i].need)) {
            r = &store->queue[i];
            r->asked = ++store->memory->clock;
            return r;
        }
        if (!store->queue[i].need.wanted || (r->need.wanted && store->queue[i].asked < r->asked))
            r = &store->queue[i];
    }
    sp_brick_request_clear(r);
    if (!sp_brick_need_copy(need, &r->need))
        return NULL;
    r->asked = ++store->memory->clock;
    pthread_cond_signal(&store->asked);
    return r;
}

/* Waits for a change, but not long: the caller looks whether it is cancelled. */
static void wait_a_while(struct sp_brick_store *store, double ms) {
    struct timespec until;
    const double now = sp_clock_ms(), end = now + fmin(ms, poll_ms);
    until.tv_sec = (time_t)(end / 1000);
    until.tv_nsec = (long)fmod(end * 1e6, 1e9);
    pthread_cond_timedwait(&store->done, &store->memory->mutex, &until);
}

bool sp_brick_store_get(struct sp_brick_store *store, const struct sp_brick_need *need,
                        double wait_ms, bool takes_parts, bool (*is_cancelled)(void *user),
                        void *user, struct sp_brick_subvolume *out, struct sp_error *err) {
    const double deadline = sp_clock_ms() + wait_ms;
    const uint64_t cost = sp_brick_need_cost(store->file, need);
    bool ok = true;
    *out = (struct sp_brick_subvolume){ .volume = NULL };
    pthread_mutex_lock(&store->memory->mutex);
    const uint64_t published = store->published;
    store->cost = cost;
    store->asked_ms = sp_clock_ms();
    while (ok && !out->volume) {
        struct sp_brick_store_subvolume *w = find_subvolume(store, need);
        const bool is_over = w && is_due(store, w);
        struct sp_brick_request *r = w && !is_over ? NULL : ask(store, w ? &w->need : need);
        const double left = deadline - sp_clock_ms();
        if (w && (!is_over || left <= 0 || !r || r->has_failed)) {
            w->used = ++store->memory->clock;
            if (r && r->has_failed)
                sp_brick_request_clear(r);
            describe(store, w, need, out);
            out->is_wanted = true;
        } else if (is_cancelled && is_cancelled(user)) {
            ok = sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
        } else if (isinf(wait_ms) && (!r || r->has_failed)) {
            ok = r ? sp_fail(err, r->why.code, r->why.place, "%s", r->why.text)
                   : sp_fail(err, SP_ERR_MEMORY, "", "out of memory for bricks");
            if (r)
                sp_brick_request_clear(r);
        } else if (!r || r->has_failed || left <= 0 ||
                   (takes_parts && store->published != published)) {
            if (r && r->has_failed)
                sp_brick_request_clear(r); /* the next frame tries again */
            choose_fallback(store, need, out);
        } else {
            wait_a_while(store, left);
        }
    }
    pthread_mutex_unlock(&store->memory->mutex);
    return ok;
}

void sp_brick_store_usage(struct sp_brick_store *store, uint64_t *bricks, uint64_t *bytes) {
    *bricks = *bytes = 0;
    pthread_mutex_lock(&store->memory->mutex);
    for (int i = 0; i < BRICK_SUBVOLUMES_MAX; i++)
        if (store->subvolumes[i].volume) {
            *bricks += sp_brick_need_wanted(&store->subvolumes[i].need);
            *bytes += store->subvolumes[i].bytes;
        }
    pthread_mutex_unlock(&store->memory->mutex);
}
