/* SPDX-License-Identifier: Apache-2.0 */
#include "frame/pool.h"

#include <assert.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>

#include "sp/budget.h"
#include "sp/view.h"

enum { ALIGN = 64 };

struct block {
    struct sp_frame frame; /* first, so that a frame's address is its block's */
    atomic_uint refs;
    struct sp_frame_pool *pool;
    struct sp_budget *budget; /* the pool's: the pool may be freed before its last block */
    struct block *next;       /* in the idle list, the most recently used first */
    size_t capacity;          /* bytes of pixels */
};

struct sp_frame_pool {
    pthread_mutex_t lock;
    struct block *idle;
    size_t idle_bytes, cap_bytes;
    size_t live; /* frames with references; the pool is freed after the last one */
    uint64_t allocations;
    struct sp_budget *budget; /* NULL = none */
    bool closed;
};

static size_t round_up(size_t n) {
    return (n + ALIGN - 1) / ALIGN * ALIGN;
}

struct sp_frame_pool *sp_frame_pool_create(size_t cap_bytes, struct sp_error *err) {
    struct sp_frame_pool *pool = calloc(1, sizeof *pool);
    if (!pool) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a frame pool");
        return NULL;
    }
    pthread_mutex_init(&pool->lock, NULL);
    pool->cap_bytes = cap_bytes;
    return pool;
}

static void free_pool(struct sp_frame_pool *pool) {
    pthread_mutex_destroy(&pool->lock);
    free(pool);
}

/* Unlinks the least recently used blocks until `bytes` more fit below the cap; returns them as a
 * list, to be freed outside the lock. */
static struct block *evict(struct sp_frame_pool *pool, size_t bytes) {
    struct block **link = &pool->idle;
    size_t kept = bytes;
    while (*link && kept + (*link)->capacity <= pool->cap_bytes) {
        kept += (*link)->capacity;
        link = &(*link)->next;
    }
    struct block *gone = *link;
    *link = NULL;
    for (const struct block *b = gone; b; b = b->next)
        pool->idle_bytes -= b->capacity;
    return gone;
}

/* Of a block in memory. */
static size_t size_of(size_t capacity) {
    return round_up(sizeof(struct block)) + capacity;
}

static void free_blocks(struct block *list) {
    while (list) {
        struct block *next = list->next;
        sp_budget_release(list->budget, SP_BUDGET_IMAGES, size_of(list->capacity));
        free(list);
        list = next;
    }
}

void sp_frame_pool_destroy(struct sp_frame_pool **pool) {
    struct sp_frame_pool *p = *pool;
    if (!p)
        return;
    *pool = NULL;
    pthread_mutex_lock(&p->lock);
    assert(!p->closed);
    p->closed = true;
    struct block *gone = p->idle;
    p->idle = NULL;
    p->idle_bytes = 0;
    bool last = p->live == 0;
    pthread_mutex_unlock(&p->lock);
    free_blocks(gone);
    if (last)
        free_pool(p);
}

void sp_frame_pool_set_budget(struct sp_frame_pool *pool, struct sp_budget *budget) {
    pool->budget = budget;
}

void sp_frame_pool_trim(struct sp_frame_pool *pool) {
    pthread_mutex_lock(&pool->lock);
    struct block *gone = pool->idle;
    pool->idle = NULL;
    pool->idle_bytes = 0;
    pthread_mutex_unlock(&pool->lock);
    free_blocks(gone);
}

/* Returns the smallest idle block that is large enough and wastes at most half; NULL if there is
 * none. */
static struct block *pop_idle(struct sp_frame_pool *pool, size_t bytes) {
    struct block **best = NULL;
    for (struct block **link = &pool->idle; *link; link = &(*link)->next) {
        size_t capacity = (*link)->capacity;
        if (capacity >= bytes && capacity / 2 <= bytes && (!best || capacity < (*best)->capacity))
            best = link;
    }
    if (!best)
        return NULL;
    struct block *b = *best;
    *best = b->next;
    pool->idle_bytes -= b->capacity;
    return b;
}

/* Allocates a block for that many bytes of pixels. */
static struct block *allocate(struct sp_frame_pool *pool, uint32_t width, uint32_t height,
                              size_t bytes, struct sp_error *err) {
    const size_t size = size_of(bytes);
    if (!sp_budget_acquire(pool->budget, SP_BUDGET_IMAGES, size)) {
        sp_frame_pool_trim(pool);
        if (!sp_budget_acquire(pool->budget, SP_BUDGET_IMAGES, size)) {
            sp_budget_fail(pool->budget, "pixels", size, err);
            return NULL;
        }
    }
    struct block *b = aligned_alloc(ALIGN, size);
    if (!b) {
        sp_budget_release(pool->budget, SP_BUDGET_IMAGES, size);
        sp_fail(err, SP_ERR_MEMORY, "/size", "out of memory for a frame of %u × %u px (%zu bytes)",
                width, height, bytes);
        return NULL;
    }
    b->capacity = bytes;
    b->budget = pool->budget;
    return b;
}

static struct sp_frame *create(struct sp_frame_pool *pool, uint32_t width, uint32_t height,
                               enum sp_pixel_format format, bool has_depth, struct sp_error *err) {
    assert(width >= 1 && width <= SP_SIZE_MAX && height >= 1 && height <= SP_SIZE_MAX);
    assert(format == SP_RGBA8 || format == SP_RGBAF32);
    size_t stride = round_up((size_t)width * (format == SP_RGBAF32 ? 16 : 4));
    size_t depth_stride = has_depth ? round_up(width * sizeof(float)) : 0;
    size_t pixels = stride * height, plane = depth_stride * height;
    size_t bytes = pixels + 2 * plane, header = round_up(sizeof(struct block));
    pthread_mutex_lock(&pool->lock);
    assert(!pool->closed);
    struct block *b = pop_idle(pool, bytes);
    pool->live++;
    if (!b)
        pool->allocations++;
    pthread_mutex_unlock(&pool->lock);
    if (!b && !(b = allocate(pool, width, height, bytes, err))) {
        pthread_mutex_lock(&pool->lock);
        pool->live--;
        pthread_mutex_unlock(&pool->lock);
        return NULL;
    }
    b->pool = pool;
    b->next = NULL;
    atomic_init(&b->refs, 1);
    b->frame = (struct sp_frame){ .width = width,
                                  .height = height,
                                  .format = format,
                                  .stride_bytes = stride,
                                  .pixels = (unsigned char *)b + header,
                                  .depth_stride_bytes = depth_stride };
    if (has_depth) {
        b->frame.depth = (float *)((char *)b->frame.pixels + pixels);
        b->frame.spread = (float *)((char *)b->frame.depth + plane);
    }
    return &b->frame;
}

struct sp_frame *sp_frame_create(struct sp_frame_pool *pool, uint32_t width, uint32_t height,
                                 enum sp_pixel_format format, struct sp_error *err) {
    return create(pool, width, height, format, false, err);
}

struct sp_frame *sp_frame_create_with_depth(struct sp_frame_pool *pool, uint32_t width,
                                            uint32_t height, enum sp_pixel_format format,
                                            struct sp_error *err) {
    return create(pool, width, height, format, true, err);
}

struct sp_frame *sp_frame_ref(struct sp_frame *frame) {
    atomic_fetch_add_explicit(&((struct block *)frame)->refs, 1, memory_order_relaxed);
    return frame;
}

void sp_frame_unref(struct sp_frame **frame) {
    struct block *b = (struct block *)*frame;
    *frame = NULL;
    if (!b || atomic_fetch_sub_explicit(&b->refs, 1, memory_order_acq_rel) != 1)
        return;
    struct sp_frame_pool *pool = b->pool;
    struct block *gone;
    pthread_mutex_lock(&pool->lock);
    pool->live--;
    bool last = pool->closed && pool->live == 0;
    if (pool->closed || b->capacity > pool->cap_bytes) {
        gone = b;
        b->next = NULL;
    } else {
        gone = evict(pool, b->capacity);
        b->next = pool->idle;
        pool->idle = b;
        pool->idle_bytes += b->capacity;
    }
    pthread_mutex_unlock(&pool->lock);
    free_blocks(gone);
    if (last)
        free_pool(pool);
}

uint64_t sp_frame_pool_allocations(struct sp_frame_pool *pool) {
    pthread_mutex_lock(&pool->lock);
    uint64_t n = pool->allocations;
    pthread_mutex_unlock(&pool->lock);
    return n;
}

size_t sp_frame_pool_idle(struct sp_frame_pool *pool) {
    pthread_mutex_lock(&pool->lock);
    size_t n = pool->idle_bytes;
    pthread_mutex_unlock(&pool->lock);
    return n;
}
