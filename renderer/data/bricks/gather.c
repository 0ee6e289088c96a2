/* SPDX-License-Identifier: Apache-2.0 */
#include "data/bricks/gather.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "data/bricks/chunks.h"

enum { READERS_MAX = 64 };

struct gather {
    const struct sp_gather_job *job;
    const struct sp_chunk_source *source;
    const struct sp_chunk_level *chunks;
    const struct sp_brick_level *level;
    size_t sample;
    uint32_t first[3], size[3];      /* samples of the box */
    uint32_t first_chunk[3], end[3]; /* chunks that meet it */
    uint16_t *numbers; /* owned: by chunk, the largest number of its missing bricks; 0 = none */
    uint32_t *order;   /* owned: the chunks that are read, in this order */
    size_t order_count, begin;  /* where the part that is read now begins */
    void *buffers[READERS_MAX]; /* a chunk per reader; NULL = not needed yet */
    atomic_bool ended;          /* cancelled, or out of memory */
    pthread_mutex_t mutex;      /* guards what follows */
    struct sp_error *why, end_error;
};

static void end_with(struct gather *g, const struct sp_error *why) {
    pthread_mutex_lock(&g->mutex);
    g->end_error = *why;
    pthread_mutex_unlock(&g->mutex);
    atomic_store(&g->ended, true);
}

/* Where a box of samples and one brick meet. False if they do not. */
static bool intersect(const uint32_t first[3], const uint32_t size[3], const uint32_t other[3],
                      const uint32_t extent[3], uint32_t low[3], uint32_t high[3]) {
    for (int a = 0; a < 3; a++) {
        const uint32_t end = first[a] + size[a], other_end = other[a] + extent[a];
        low[a] = first[a] > other[a] ? first[a] : other[a];
        high[a] = end < other_end ? end : other_end;
        if (low[a] >= high[a])
            return false;
    }
    return true;
}

/* Copies the samples that a chunk shares with brick i of the box. first, size: of the chunk. */
static void copy_overlap(const struct gather *g, const char *chunk, const uint32_t first[3],
                         const uint32_t size[3], uint64_t i) {
    const struct sp_brick_place place = sp_brick_place(g->job->box, g->level, g->sample, i);
    uint32_t brick[3], extent[3], low[3], high[3];
    sp_brick_box(g->level, sp_brick_need_at(g->job->need, g->level, i), brick, extent);
    if (!intersect(first, size, brick, extent, low, high))
        return;
    for (uint32_t z = low[2]; z < high[2]; z++)
        for (uint32_t y = low[1]; y < high[1]; y++) {
            const size_t from =
                ((size_t)(z - first[2]) * size[1] + (y - first[1])) * size[0] + (low[0] - first[0]);
            char *to = place.samples + (z - brick[2]) * place.slice + (y - brick[1]) * place.row +
                       (low[0] - brick[0]) * g->sample;
            memcpy(to, chunk + from * g->sample, (high[0] - low[0]) * g->sample);
        }
}

/* Calls visit() for each missing brick that meets a box. */
typedef void visit_fn(struct gather *g, uint64_t i, void *user);

static void visit_missing(struct gather *g, const uint32_t first[3], const uint32_t size[3],
                          visit_fn *visit, void *user) {
    const struct sp_brick_need *need = g->job->need;
    uint32_t low[3], high[3];
    for (int a = 0; a < 3; a++) {
        const uint32_t begin = first[a] / BRICK_SIDE, end = (first[a] + size[a] - 1) / BRICK_SIDE;
        low[a] = begin > need->first[a] ? begin - need->first[a] : 0;
        if (end < need->first[a])
            return;
        high[a] = end - need->first[a] + 1;
        high[a] = high[a] < need->count[a] ? high[a] : need->count[a];
    }
    for (uint32_t z = low[2]; z < high[2]; z++)
        for (uint32_t y = low[1]; y < high[1]; y++)
            for (uint32_t x = low[0]; x < high[0]; x++) {
                const uint64_t i = ((uint64_t)z * need->count[1] + y) * need->count[0] + x;
                if (g->job->missing[i])
                    visit(g, i, user);
            }
}

struct chunk {
    const char *samples;
    uint32_t first[3], size[3];
};

static void copy_to_brick(struct gather *g, uint64_t i, void *user) {
    const struct chunk *chunk = user;
    copy_overlap(g, chunk->samples, chunk->first, chunk->size, i);
}

/* Several chunks of a brick may fail at once. */
static void mark_failed(struct gather *g, uint64_t i, void *user) {
    (void)user;
    __atomic_store_n(&g->job->failed[i], 1, __ATOMIC_RELAXED);
}

static bool is_ended(void *user) {
    struct gather *g = user;
    if (atomic_load_explicit(&g->ended, memory_order_relaxed))
        return true;
    if (!g->job->is_cancelled || !g->job->is_cancelled(g->job->user))
        return false;
    struct sp_error why;
    sp_fail(&why, SP_ERR_CANCELLED, "", "cancelled");
    end_with(g, &why);
    return true;
}

static void gather_chunk(struct gather *g, const uint32_t place[3], unsigned worker) {
    struct chunk chunk;
    struct sp_error err;
    sp_chunk_box(g->chunks, place, chunk.first, chunk.size);
    if (!g->buffers[worker])
        g->buffers[worker] = malloc((size_t)sp_chunk_bytes_max(g->source));
    if (!g->buffers[worker]) {
        sp_fail(&err, SP_ERR_MEMORY, "", "out of memory for a chunk");
        end_with(g, &err);
        return;
    }
    chunk.samples = g->buffers[worker];
    if (g->source->read(g->source->user, worker, g->job->need->level, place, g->buffers[worker],
                        is_ended, g, &err)) {
        visit_missing(g, chunk.first, chunk.size, copy_to_brick, &chunk);
    } else if (err.code == SP_ERR_CANCELLED) {
        end_with(g, &err);
    } else {
        visit_missing(g, chunk.first, chunk.size, mark_failed, NULL);
        pthread_mutex_lock(&g->mutex);
        *g->why = err;
        pthread_mutex_unlock(&g->mutex);
    }
}

/* Computes the place of the chunk with number `i` among the chunks that meet the box. */
static void compute_place(const struct gather *g, size_t i, uint32_t place[3]) {
    for (int a = 0; a < 3; a++) {
        const size_t count = g->end[a] - g->first_chunk[a];
        place[a] = g->first_chunk[a] + (uint32_t)(i % count);
        i /= count;
    }
}

static void gather_chunks(void *user, size_t begin, size_t end, unsigned worker) {
    struct gather *g = user;
    for (size_t n = begin; n < end && !is_ended(g); n++) {
        uint32_t place[3];
        compute_place(g, g->order[g->begin + n], place);
        gather_chunk(g, place, worker);
    }
}

static void mark_unread(struct gather *g, uint64_t i, void *user) {
    (void)user;
    g->job->has[i] = 0;
}

/* Missing bricks are there if none of their chunks is left, from `end` on, and none failed. */
static void mark_read(struct gather *g, size_t end) {
    for (uint64_t i = 0; i < sp_brick_need_count(g->job->need); i++)
        if (g->job->missing[i])
            g->job->has[i] = !g->job->failed[i];
    for (; end < g->order_count; end++) {
        uint32_t place[3], first[3], size[3];
        compute_place(g, g->order[end], place);
        sp_chunk_box(g->chunks, place, first, size);
        visit_missing(g, first, size, mark_unread, NULL);
    }
}

/* Reads some chunks after the other, and tells which bricks are there. */
static void gather_batches(struct gather *g) {
    const struct sp_gather_job *job = g->job;
    const size_t batch = (size_t)BRICK_BATCH * sp_pool_threads(job->pool);
    for (g->begin = 0; g->begin < g->order_count && !is_ended(g); g->begin += batch) {
        const size_t left = g->order_count - g->begin;
        sp_parallel_for(job->pool, left < batch ? left : batch, 1, gather_chunks, g);
        if (left <= batch || !job->is_due || !job->is_due(job->user))
            continue;
        mark_read(g, g->begin + batch);
        job->progress(job->user, job->has);
    }
}

static void update_largest(struct gather *g, uint64_t i, void *user) {
    uint16_t *number = user;
    const uint16_t own = g->job->need->wanted[i];
    *number = own > *number ? own : *number;
}

/* Finds which chunks are read, and in which order. False if memory ran out. */
static bool order_chunks(struct gather *g, size_t count) {
    if (!(g->numbers = calloc(count, sizeof *g->numbers)))
        return false;
    for (size_t i = 0; i < count; i++) {
        uint32_t place[3], first[3], size[3];
        compute_place(g, i, place);
        sp_chunk_box(g->chunks, place, first, size);
        visit_missing(g, first, size, update_largest, &g->numbers[i]);
    }
    return (g->order = sp_brick_order(g->numbers, count, &g->order_count)) != NULL;
}

static void learn(void *user, size_t begin, size_t end, unsigned worker) {
    struct gather *g = user;
    const struct sp_gather_job *job = g->job;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        if (!job->missing[i] || job->failed[i])
            continue;
        const uint64_t number = sp_brick_need_at(job->need, g->level, i);
        const struct sp_brick_place place = sp_brick_place(job->box, g->level, g->sample, i);
        struct sp_brick_view view = { .samples = place.samples,
                                      .type = g->source->info.type,
                                      .width = place.row / g->sample,
                                      .height = place.slice / place.row };
        struct sp_brick_ranges ranges;
        memcpy(view.size, place.size, sizeof view.size);
        sp_brick_ranges_measure(&view, &ranges);
        sp_brick_file_learn(job->file, job->need->level, number, &ranges);
    }
}

bool sp_gather(const struct sp_gather_job *job, struct sp_error *why, struct sp_error *err) {
    struct gather *g = calloc(1, sizeof *g);
    size_t count = 1;
    if (!g)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for reading chunks");
    g->job = job;
    g->source = sp_brick_file_chunks(job->file);
    g->chunks = &g->source->level[job->need->level];
    g->level = &sp_brick_file_header(job->file)->level[job->need->level];
    g->sample = sp_type_size(g->source->info.type);
    g->why = why;
    why->code = SP_OK;
    sp_brick_need_box(job->need, g->level, g->first, g->size);
    for (int a = 0; a < 3; a++) {
        g->first_chunk[a] = g->first[a] / g->chunks->chunk[a];
        g->end[a] = (g->first[a] + g->size[a] - 1) / g->chunks->chunk[a] + 1;
        count *= g->end[a] - g->first_chunk[a];
    }
    atomic_init(&g->ended, false);
    pthread_mutex_init(&g->mutex, NULL);
    if (order_chunks(g, count)) {
        gather_batches(g);
    } else {
        struct sp_error memory;
        sp_fail(&memory, SP_ERR_MEMORY, "", "out of memory for reading chunks");
        end_with(g, &memory);
    }
    const bool ok = !atomic_load(&g->ended);
    if (ok)
        sp_parallel_for(job->pool, (size_t)sp_brick_need_count(job->need), 1, learn, g);
    else
        sp_fail(err, g->end_error.code, "", "%s", g->end_error.text);
    for (int i = 0; i < READERS_MAX; i++)
        free(g->buffers[i]);
    pthread_mutex_destroy(&g->mutex);
    free(g->numbers);
    free(g->order);
    free(g);
    return ok;
}
