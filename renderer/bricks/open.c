/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bricks/store_private.h"
#include "volume/volume.h"

#define BASE_BYTES_MAX ((uint64_t)16 << 20)
#define BUDGET_MIN ((uint64_t)1 << 16)

static void release(struct sp_brick_store *store) {
    for (int i = 0; i < BRICK_WINDOWS_MAX; i++)
        sp_brick_window_clear(&store->windows[i]);
    for (int i = 0; i < BRICK_QUEUE_MAX; i++)
        sp_brick_request_clear(&store->queue[i]);
    pthread_cond_destroy(&store->asked);
    pthread_cond_destroy(&store->done);
    pthread_mutex_destroy(&store->mutex);
    sp_brick_file_close(&store->file);
    sp_pool_destroy(&store->pool);
    free(store->base_need.wanted);
    free(store->base_lost);
    free(store->damaged);
    free(store);
}

static void destroy(void *source) {
    struct sp_brick_store *store = source;
    pthread_mutex_lock(&store->mutex);
    atomic_store(&store->stop, true);
    pthread_cond_signal(&store->asked);
    pthread_mutex_unlock(&store->mutex);
    pthread_join(store->thread, NULL);
    release(store);
}

/* The finest level of at most BASE_BYTES_MAX and a quarter of the budget, or the last one. */
static bool choose_base(struct sp_brick_store *store) {
    const struct sp_brick_header *header = sp_brick_file_header(store->file);
    struct sp_brick_need *need = &store->base_need;
    const uint64_t bytes_max =
        store->budget / 4 < BASE_BYTES_MAX ? store->budget / 4 : BASE_BYTES_MAX;
    for (need->level = 0;; need->level++) {
        memcpy(need->count, header->level[need->level].bricks, sizeof need->count);
        if (need->level + 1 == header->levels ||
            sp_brick_need_bytes(store->file, need) <= bytes_max)
            break;
    }
    store->base_level = need->level;
    const uint64_t count = sp_brick_need_count(need);
    need->wanted = malloc(count);
    store->base_lost = calloc(1, count);
    if (need->wanted)
        memset(need->wanted, 1, count);
    return need->wanted && store->base_lost;
}

static void choose_budget(struct sp_brick_store *store, const struct sp_load_options *options) {
    const long pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
    const uint64_t memory =
        pages > 0 && page > 0 ? (uint64_t)pages * (uint64_t)page : (uint64_t)4 << 30;
    const uint64_t all = 4 * sp_brick_file_header(store->file)->info.voxel_bytes;
    store->budget = options && options->window_bytes ? options->window_bytes : memory / 4;
    store->budget = store->budget < all ? store->budget : all;
}

/* Chooses the base, and halves the budget until it is granted. */
static bool reserve(struct sp_brick_store *store, const char *source,
                    const struct sp_load_options *options, struct sp_error *err) {
    for (;; store->budget /= 2) {
        struct sp_error why;
        if (!choose_base(store))
            return sp_fail(err, SP_ERR_MEMORY, source, "out of memory for a brick file");
        const uint64_t needed = store->budget +
                                sp_brick_need_bytes(store->file, &store->base_need) +
                                sp_brick_file_bytes(store->file);
        if (!options || !options->reserve || options->reserve(options->user, needed, &why))
            return true;
        if (why.code != SP_ERR_BUDGET || store->budget / 2 < BUDGET_MIN)
            return sp_fail(err, why.code, why.place, "%s", why.text);
        free(store->base_need.wanted);
        free(store->base_lost);
    }
}

static struct sp_volume *make_base(struct sp_brick_store *store, const char *name,
                                   const char *source, struct sp_error *err) {
    struct sp_volume_info info = sp_brick_file_header(store->file)->info;
    const uint64_t bytes = sp_brick_need_bytes(store->file, &store->base_need);
    struct sp_error why;
    snprintf(info.name, sizeof info.name, "%s", name);
    snprintf(info.source, sizeof info.source, "%s", source);
    memcpy(info.whole.dims, info.grid.dims, sizeof info.whole.dims);
    memcpy(info.whole.spacing, info.grid.spacing, sizeof info.whole.spacing);
    info.whole.content = sp_brick_file_header(store->file)->level[0].checksum;
    info.whole.levels = sp_brick_file_header(store->file)->levels;
    info.grid = sp_brick_store_grid(store, &store->base_need);
    void *samples = sp_brick_store_map(bytes, err);
    const struct sp_brick_fill_job job = { .file = store->file,
                                           .need = &store->base_need,
                                           .pool = store->pool,
                                           .samples = samples,
                                           .lost = store->base_lost };
    if (!samples)
        return NULL;
    if (!sp_brick_fill(&job, &why, err)) {
        sp_brick_store_unmap(samples, bytes);
        return NULL;
    }
    if (why.code != SP_OK)
        sp_brick_store_note(store, &store->base_need, store->base_lost, &why);
    return sp_volume_adopt_measured(&info, samples, bytes, sp_brick_store_unmap, err);
}

static struct sp_volume *start(struct sp_brick_store *store, const char *name, const char *source,
                               const struct sp_load_options *options, struct sp_error *err) {
    uint64_t bricks = 0;
    for (unsigned l = 0; l < sp_brick_file_header(store->file)->levels; l++)
        bricks += sp_brick_count(&sp_brick_file_header(store->file)->level[l]);
    if (!(store->damaged = calloc(1, bricks))) {
        sp_fail(err, SP_ERR_MEMORY, source, "out of memory for a brick file");
        return NULL;
    }
    choose_budget(store, options);
    if (!reserve(store, source, options, err) ||
        !(store->pool = sp_pool_create(sp_volume_threads(), err)))
        return NULL;
    struct sp_volume *base = make_base(store, name, source, err);
    store->base = base;
    if (base && pthread_create(&store->thread, NULL, sp_brick_store_read, store) != 0) {
        sp_fail(err, SP_ERR_MEMORY, source, "cannot start a thread for reading bricks");
        sp_volume_unref(&base);
    }
    if (base)
        sp_volume_set_source(base, store, destroy);
    return base;
}

struct sp_volume *sp_brick_store_open(int fd, const char *name, const char *source,
                                      const struct sp_load_options *options, struct sp_error *err) {
    struct sp_brick_store *store = calloc(1, sizeof *store);
    struct sp_volume *base = NULL;
    if (!store) {
        close(fd);
        sp_fail(err, SP_ERR_MEMORY, source, "out of memory for a brick file");
        return NULL;
    }
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_mutex_init(&store->mutex, NULL);
    pthread_cond_init(&store->asked, NULL);
    pthread_cond_init(&store->done, &monotonic);
    pthread_condattr_destroy(&monotonic);
    store->file = sp_brick_file_open(fd, source, err);
    if (store->file)
        base = start(store, name, source, options, err);
    if (base)
        return base;
    release(store);
    return NULL;
}
