/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "base/clock.h"
#include "bricks/places.h"
#include "bricks/store_private.h"
#include "volume/volume.h"

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

uint64_t sp_brick_store_window_max(const struct sp_brick_store *store) {
    return sp_brick_memory_window_max(store->memory, store);
}

static const struct sp_brick_level *level_of(const struct sp_brick_store *store, unsigned level) {
    return &sp_brick_file_header(store->file)->level[level];
}

void sp_brick_store_unmap(void *samples, size_t bytes) {
    munmap(samples, bytes);
}

void *sp_brick_store_map(size_t bytes, struct sp_error *err) {
    void *memory = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (memory != MAP_FAILED)
        return memory;
    sp_fail(err, SP_ERR_MEMORY, "", "out of memory for %zu bytes of bricks", bytes);
    return NULL;
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
    if (count == 1) { /* the only sample is as wide as it is among the others */
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
    double *next = *numbers =
        malloc(((size_t)grid->dims[0] + grid->dims[1] + grid->dims[2]) * sizeof *next);
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

void sp_brick_window_clear(struct sp_brick_store_window *w) {
    sp_volume_unref(&w->volume);
    free(w->need.wanted);
    free(w->lost);
    *w = (struct sp_brick_store_window){ .volume = NULL };
}

void sp_brick_request_clear(struct sp_brick_request *r) {
    free(r->need.wanted);
    *r = (struct sp_brick_request){ .asked = 0 };
}

/* With the mutex held: the window that has all of a need; NULL = none. */
static struct sp_brick_store_window *find_window(struct sp_brick_store *store,
                                                 const struct sp_brick_need *need) {
    for (int i = 0; i < BRICK_WINDOWS_MAX; i++)
        if (store->windows[i].volume && sp_brick_need_is_in(need, &store->windows[i].need))
            return &store->windows[i];
    return NULL;
}

/* With the mutex held: a chunk of the window could not be read, and it is time to read it again:
 * the network may work now. A damaged file stays as it is. */
static bool is_due(const struct sp_brick_store *store, const struct sp_brick_store_window *w) {
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
                *own = *own > need->wanted[i] ? *own : need->wanted[i];
            }
}

/* The need for a coarser level of the same box. False without memory, or if there is none finer
 * than the base. */
static bool coarsen(const struct sp_brick_store *store, const struct sp_brick_need *need,
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

/* Counts the bricks of a need that could not be read, and finds one of them. `lost` is by brick of
 * the box `have`; `need` NULL = all of them count. */
static void find_lost(const struct sp_brick_store *store, const struct sp_brick_need *have,
                      const uint8_t *lost, const struct sp_brick_need *need,
                      struct sp_brick_window *out) {
    const struct sp_brick_level *level = level_of(store, have->level);
    for (uint64_t i = 0; i < sp_brick_need_count(have); i++) {
        uint64_t at;
        const bool counts =
            lost[i] && (!need || (sp_brick_need_find(have, i, need, &at) && need->wanted[at]));
        if (counts && !out->lost++)
            sp_brick_store_box(store, have->level, sp_brick_need_at(have, level, i), out->lost_box);
    }
}

/* Describes a window for a need; NULL = for one of a finer level. */
static void describe(const struct sp_brick_store *store, struct sp_brick_store_window *w,
                     const struct sp_brick_need *need, struct sp_brick_window *out) {
    out->volume = sp_volume_ref(w->volume);
    out->level = w->need.level;
    if (w->lost_count)
        find_lost(store, &w->need, w->lost, need, out);
    sp_brick_need_box(&w->need, level_of(store, w->need.level), out->first, out->size);
}

void sp_brick_store_get_base(struct sp_brick_store *store, struct sp_brick_window *out) {
    *out = (struct sp_brick_window){ .volume = sp_volume_ref(store->base),
                                     .level = store->base_level };
    find_lost(store, &store->base_need, store->base_lost, NULL, out);
    sp_brick_need_box(&store->base_need, level_of(store, out->level), out->first, out->size);
}

/* With the mutex held: the finest window that covers a need coarsely, or the base. */
static void find_coarser(struct sp_brick_store *store, const struct sp_brick_need *need,
                         struct sp_brick_window *out) {
    struct sp_brick_need coarse;
    for (unsigned steps = 1; coarsen(store, need, steps, &coarse); steps++) {
        struct sp_brick_store_window *w = find_window(store, &coarse);
        free(coarse.wanted);
        if (w) {
            w->used = ++store->memory->clock;
            describe(store, w, NULL, out);
            return;
        }
    }
    sp_brick_store_get_base(store, out);
}

/* Reading. */

static bool is_stopped(void *user) {
    const struct sp_brick_store *store = user;
    return atomic_load_explicit(&store->stop, memory_order_relaxed);
}

/* References to the windows, from which bricks are copied. */
struct known {
    struct sp_volume *volumes[BRICK_WINDOWS_MAX];
    struct sp_brick_need needs[BRICK_WINDOWS_MAX]; /* owned */
    uint8_t *lost[BRICK_WINDOWS_MAX];
    struct sp_brick_box_samples samples[BRICK_WINDOWS_MAX];
    size_t count;
};

/* With the mutex held. */
static void take_known(struct sp_brick_store *store, unsigned level, struct known *known) {
    known->count = 0;
    for (int i = 0; i < BRICK_WINDOWS_MAX; i++) {
        struct sp_brick_store_window *w = &store->windows[i];
        const size_t n = known->count;
        if (!w->volume || w->need.level != level)
            continue;
        const uint64_t count = sp_brick_need_count(&w->need);
        known->lost[n] = malloc(count);
        if (!known->lost[n] || !sp_brick_need_copy(&w->need, &known->needs[n])) {
            free(known->lost[n]);
            continue;
        }
        memcpy(known->lost[n], w->lost, count);
        known->volumes[n] = sp_volume_ref(w->volume);
        /* They are only read. */
        known->samples[n] = (struct sp_brick_box_samples){
            .need = &known->needs[n],
            .samples = w->need.is_sparse ? NULL : (void *)sp_volume_voxels(w->volume),
            .blocks = (struct sp_blocks *)sp_volume_blocks(w->volume),
            .vectors = sp_volume_vectors(w->volume),
            .lost = known->lost[n]
        };
        known->count++;
    }
}

static void drop_known(struct known *known) {
    for (size_t i = 0; i < known->count; i++) {
        sp_volume_unref(&known->volumes[i]);
        free(known->needs[i].wanted);
        free(known->lost[i]);
    }
}

/* Makes a volume of the samples of a need, which it takes over, also on failure. */
static struct sp_volume *derive(const struct sp_brick_store *store,
                                const struct sp_brick_need *need, void *samples, uint64_t bytes,
                                struct sp_error *err) {
    const struct sp_whole_part part = sp_brick_store_part(store, need);
    struct sp_volume *volume = NULL;
    struct sp_grid grid;
    double *numbers;
    if (!sp_brick_store_grid(store, need, &grid, &numbers)) {
        munmap(samples, bytes);
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for bricks");
        return NULL;
    }
    if (need->is_sparse)
        volume = sp_volume_derive_blocks(store->base, &grid, &part, samples, bytes,
                                         sp_brick_store_unmap, err);
    else
        volume = sp_volume_derive_part(store->base, &grid, &part, samples,
                                       sp_brick_store_vectors(store, need, samples), bytes,
                                       sp_brick_store_unmap, err);
    free(numbers);
    return volume;
}

/* Reads the bricks of a need into a window, which takes over the need. */
static bool read_window(struct sp_brick_store *store, struct sp_brick_need *need,
                        struct sp_brick_store_window *w, struct sp_error *err) {
    const uint64_t bytes = need->is_sparse ? sp_brick_blocks_bytes(store->file, need)
                                           : sp_brick_need_bytes(store->file, need),
                   bricks = sp_brick_need_count(need);
    struct sp_error why = { .code = SP_OK };
    struct known known;
    *w = (struct sp_brick_store_window){ .need = *need,
                                         .bytes = sp_brick_need_cost(store->file, need),
                                         .lost = calloc(1, bricks) };
    need->wanted = NULL;
    void *samples = w->lost ? sp_brick_store_map(bytes, err) : NULL;
    if (!samples)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for bricks");
    pthread_mutex_lock(&store->memory->mutex);
    take_known(store, w->need.level, &known);
    pthread_mutex_unlock(&store->memory->mutex);
    const struct sp_brick_fill_job job = {
        .file = store->file,
        .need = &w->need,
        .coarse = { .need = &store->base_need,
                    .samples = (void *)sp_volume_voxels(store->base), /* only read */
                    .vectors = sp_volume_vectors(store->base),
                    .lost = store->base_lost },
        .known = known.samples,
        .known_count = known.count,
        .pool = store->pool,
        .is_cancelled = is_stopped,
        .user = store,
        .samples = w->need.is_sparse ? NULL : samples,
        .blocks = w->need.is_sparse ? sp_brick_blocks_init(store->file, &w->need, samples) : NULL,
        .vectors = (float(*)[3])sp_brick_store_vectors(store, &w->need, samples),
        .lost = w->lost,
    };
    bool ok = sp_brick_fill(&job, &why, err);
    drop_known(&known);
    for (uint64_t i = 0; ok && i < bricks; i++)
        w->lost_count += w->lost[i];
    pthread_mutex_lock(&store->memory->mutex);
    if (ok)
        sp_brick_store_heal(store, &w->need, w->lost);
    if (why.code != SP_OK)
        sp_brick_store_note(store, &w->need, w->lost, &why);
    pthread_mutex_unlock(&store->memory->mutex);
    if (!ok) {
        munmap(samples, bytes);
        return false;
    }
    w->read_ms = sp_clock_ms();
    w->volume = derive(store, &w->need, samples, bytes, err);
    return w->volume != NULL;
}

/* Reads a need and publishes the window. With the mutex held, which is released meanwhile. */
static bool serve(struct sp_brick_store *store, struct sp_brick_need *need, struct sp_error *err) {
    struct sp_brick_store_window made;
    const uint64_t cost = sp_brick_need_cost(store->file, need);
    sp_brick_memory_make_space(store->memory, store, cost);
    store->memory->reading += cost;
    pthread_mutex_unlock(&store->memory->mutex);
    bool ok = read_window(store, need, &made, err);
    pthread_mutex_lock(&store->memory->mutex);
    store->memory->reading -= cost;
    if (!ok) {
        sp_brick_window_clear(&made);
        return false;
    }
    for (int i = 0; i < BRICK_WINDOWS_MAX; i++)
        if (store->windows[i].volume && sp_brick_need_is_in(&store->windows[i].need, &made.need))
            sp_brick_window_clear(&store->windows[i]); /* the new one has all of it */
    sp_brick_memory_make_space(store->memory, store, made.bytes);
    for (int i = 0; i < BRICK_WINDOWS_MAX; i++)
        if (!store->windows[i].volume) {
            store->windows[i] = made;
            store->windows[i].used = ++store->memory->clock;
            break;
        }
    pthread_cond_broadcast(&store->done);
    return true;
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
 * finer than the base shows them yet. With the mutex held. Copies; false without memory. */
static bool choose_step(struct sp_brick_store *store, const struct sp_brick_need *need,
                        struct sp_brick_need *step) {
    struct sp_brick_need coarse;
    for (unsigned steps = 1;
         sp_brick_need_wanted(need) >= (uint64_t)MANY_BRICKS << 3 * (steps - 1) &&
         coarsen(store, need, steps, &coarse);
         steps++) {
        const bool is_there = find_window(store, &coarse) != NULL;
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
        const struct sp_brick_store_window *w = find_window(store, &r->need);
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
                        double wait_ms, bool (*is_cancelled)(void *user), void *user,
                        struct sp_brick_window *out, struct sp_error *err) {
    const double deadline = sp_clock_ms() + wait_ms;
    const uint64_t cost = sp_brick_need_cost(store->file, need);
    bool ok = true;
    *out = (struct sp_brick_window){ .volume = NULL };
    pthread_mutex_lock(&store->memory->mutex);
    store->cost = cost;
    store->asked_ms = sp_clock_ms();
    while (ok && !out->volume) {
        struct sp_brick_store_window *w = find_window(store, need);
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
        } else if (!r || r->has_failed || left <= 0) {
            if (r && r->has_failed)
                sp_brick_request_clear(r); /* the next frame tries again */
            find_coarser(store, need, out);
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
    for (int i = 0; i < BRICK_WINDOWS_MAX; i++)
        if (store->windows[i].volume) {
            *bricks += sp_brick_need_wanted(&store->windows[i].need);
            *bytes += store->windows[i].bytes;
        }
    pthread_mutex_unlock(&store->memory->mutex);
}
