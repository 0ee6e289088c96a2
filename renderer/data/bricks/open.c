/* SPDX-License-Identifier: Apache-2.0 */
#include <float.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "base/clock.h"
#include "data/bricks/samples.h"
#include "data/bricks/store_private.h"
#include "data/volume/volume.h"

#define BASE_BYTES_MAX ((uint64_t)16 << 20)
#define REMOTE_BASE_BYTES_MAX ((uint64_t)2 << 20)
#define BUDGET_MIN ((uint64_t)1 << 16)

static void release(struct sp_brick_store *store) {
    if (store->memory)
        sp_brick_memory_remove(store->memory, store);
    for (int i = 0; i < BRICK_SUBVOLUMES_MAX; i++)
        sp_brick_subvolume_clear(&store->subvolumes[i]);
    for (int i = 0; i < BRICK_QUEUE_MAX; i++)
        sp_brick_request_clear(&store->queue[i]);
    pthread_cond_destroy(&store->asked);
    pthread_cond_destroy(&store->done);
    sp_brick_file_close(&store->file);
    sp_pool_destroy(&store->pool);
    free(store->base_need.wanted);
    free(store->base_lost);
    free(store->damaged);
    sp_brick_memory_unref(&store->memory);
    free(store);
}

static void destroy(void *source) {
    struct sp_brick_store *store = source;
    pthread_mutex_lock(&store->memory->mutex);
    atomic_store(&store->stop, true);
    pthread_cond_signal(&store->asked);
    pthread_mutex_unlock(&store->memory->mutex);
    pthread_join(store->thread, NULL);
    release(store);
}

/* The finest level of at most BASE_BYTES_MAX and a quarter of the budget, or the last one. */
static bool choose_base(struct sp_brick_store *store) {
    const struct sp_brick_header *header = sp_brick_file_header(store->file);
    struct sp_brick_need *need = &store->base_need;
    need->has_vectors = header->info.vector_bytes > 0;
    const struct sp_chunk_source *chunks = sp_brick_file_chunks(store->file);
    const uint64_t most = chunks && chunks->is_remote ? REMOTE_BASE_BYTES_MAX : BASE_BYTES_MAX;
    const uint64_t bytes_max = store->budget / 4 < most ? store->budget / 4 : most;
    for (need->level = 0;; need->level++) {
        memcpy(need->count, header->level[need->level].bricks, sizeof need->count);
        if (need->level + 1 == header->levels ||
            sp_brick_need_bytes(store->file, need) <= bytes_max)
            break;
    }
    store->base_level = need->level;
    const uint64_t count = sp_brick_need_count(need);
    sp_brick_need_allocate(need, BRICK_WANTED);
    store->base_lost = calloc(1, count);
    return need->wanted && store->base_lost;
}

static void choose_budget(struct sp_brick_store *store, const struct sp_load_options *options) {
    struct sp_brick_usage usage;
    const long pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
    const uint64_t memory =
        pages > 0 && page > 0 ? (uint64_t)pages * (uint64_t)page : (uint64_t)4 << 30;
    const uint64_t all = 4 * sp_volume_bytes(&sp_brick_file_header(store->file)->info);
    store->budget = options && options->subvolume_bytes ? options->subvolume_bytes : memory / 4;
    if (options && options->subvolumes) {
        sp_brick_memory_usage(options->subvolumes, &usage);
        store->budget = usage.bytes_max > BUDGET_MIN ? usage.bytes_max : BUDGET_MIN;
    }
    store->budget = store->budget < all ? store->budget : all;
}

/* Without a small level nothing can be shown before most is read. */
static bool check_base(const struct sp_brick_store *store, const char *source,
                       struct sp_error *err) {
    const uint64_t bytes = sp_brick_need_bytes(store->file, &store->base_need);
    const uint64_t most = store->budget / 2 < BASE_BYTES_MAX ? store->budget / 2 : BASE_BYTES_MAX;
    return !sp_brick_file_chunks(store->file) || bytes <= most ||
           sp_fail(err, SP_ERR_BUDGET, source,
                   "its coarsest level of detail has %" PRIu64
                   " bytes; to be shown from its chunks "
                   "it needs a level of at most %" PRIu64 ". Write coarser levels, or convert it: "
                   "splatctl convert",
                   bytes, most);
}

/* Chooses the base level, and halves the budget until it is granted. The budget is for the base
 * and, unless subvolumes share memory, for subvolumes. */
static bool reserve(struct sp_brick_store *store, const char *source,
                    const struct sp_load_options *options, struct sp_error *err) {
    for (;; store->budget /= 2) {
        struct sp_error why;
        if (!choose_base(store))
            return sp_fail(err, SP_ERR_MEMORY, source, "out of memory for a brick file");
        if (!check_base(store, source, err))
            return false;
        const uint64_t needed = (options && options->subvolumes ? 0 : store->budget) +
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

/* The load that may be cancelled, and that has a time limit: progress() belongs to the thread that
 * loads. */
struct loading {
    const struct sp_load_options *options;
    pthread_t thread;
    double deadline_ms;
    atomic_bool is_cancelled, is_late;
};

static bool is_cancelled(void *user) {
    struct loading *l = user;
    if (l->options && l->options->progress && pthread_equal(pthread_self(), l->thread) &&
        !l->options->progress(l->options->user, 0.5))
        atomic_store(&l->is_cancelled, true);
    if (sp_clock_ms() >= l->deadline_ms)
        atomic_store(&l->is_late, true);
    return atomic_load(&l->is_cancelled) || atomic_load(&l->is_late);
}

/* True if there are no samples. Vectors that are lost are 0. */
static bool has_lost_all(const struct sp_brick_store *store) {
    const uint64_t count = sp_brick_need_count(&store->base_need);
    uint64_t lost = 0;
    for (uint64_t i = 0; i < count; i++)
        lost += (store->base_lost[i] & BRICK_SAMPLES) != 0;
    return lost == count;
}

/* Of chunks, finer levels may have any value of the type. Real numbers are expected to exceed the
 * coarse ones by a few spans at most; what is beyond looks like the ends. */
static void estimate_limits(struct sp_volume_info *info, const void *samples) {
    static const double ends[SP_TYPE_COUNT][2] = { { 0, UINT8_MAX },
                                                   { INT8_MIN, INT8_MAX },
                                                   { 0, UINT16_MAX },
                                                   { INT16_MIN, INT16_MAX },
                                                   { INT32_MIN, INT32_MAX } };
    const struct sp_brick_view view = { .samples = samples,
                                        .type = info->type,
                                        .width = info->grid.dims[0],
                                        .height = info->grid.dims[1],
                                        .size = { info->grid.dims[0], info->grid.dims[1],
                                                  info->grid.dims[2] } };
    const struct sp_brick_range range = sp_brick_measure_range(&view);
    const double beyond = 8 * (range.most / 2 - range.least / 2);
    memcpy(info->whole.limits, ends[info->type], sizeof ends[0]);
    if (info->type < SP_FLOAT32 || range.least > range.most)
        return;
    info->whole.limits[0] = fmax(range.least - beyond, -DBL_MAX);
    info->whole.limits[1] = fmin(range.most + beyond, DBL_MAX);
}

/* Makes the volume of the base. A brick file stores its limits and content; for chunks, both come
 * from the samples of the base. */
static struct sp_volume *adopt(const struct sp_brick_store *store, struct sp_volume_info *info,
                               void *samples, uint64_t bytes, struct sp_error *err) {
    const float(*vectors)[3] = sp_brick_store_vectors(store, &store->base_need, samples);
    if (!sp_brick_file_chunks(store->file)) {
        memcpy(info->whole.limits, info->range, sizeof info->range);
        return sp_volume_adopt_measured(info, samples, vectors, bytes, sp_brick_unmap, err);
    }
    estimate_limits(info, samples);
    info->whole.content = sp_brick_checksum(samples, bytes);
    return sp_volume_adopt(info, samples, NULL, bytes, sp_brick_unmap, err);
}

/* Describes the volume that is opened, but for its grid. */
static struct sp_volume_info describe(const struct sp_brick_store *store, const char *name,
                                      const char *source) {
    const struct sp_brick_header *header = sp_brick_file_header(store->file);
    struct sp_volume_info info = header->info;
    info.noise = NAN;
    snprintf(info.name, sizeof info.name, "%s", name);
    snprintf(info.source, sizeof info.source, "%s", source);
    memcpy(info.whole.dims, info.grid.dims, sizeof info.whole.dims);
    memcpy(info.whole.spacing, info.grid.spacing, sizeof info.whole.spacing);
    memcpy(info.whole.origin, info.grid.origin, sizeof info.whole.origin);
    info.whole.content = header->level[0].samples.checksum ^ header->level[0].vectors.checksum ^
                         header->axes_checksum;
    info.whole.levels = header->levels;
    info.whole.part = sp_brick_store_part(store, &store->base_need);
    return info;
}

static struct sp_volume *make_base(struct sp_brick_store *store, const char *name,
                                   const char *source, const struct sp_load_options *options,
                                   struct sp_error *err) {
    struct sp_volume_info info = describe(store, name, source);
    double *numbers = NULL;
    const uint64_t bytes = sp_brick_need_bytes(store->file, &store->base_need);
    const int timeout_ms = options ? options->timeout_ms : 0;
    struct loading loading = { .options = options,
                               .thread = pthread_self(),
                               .deadline_ms =
                                   timeout_ms ? sp_clock_ms() + timeout_ms : (double)INFINITY };
    struct sp_error why;
    atomic_init(&loading.is_cancelled, false);
    atomic_init(&loading.is_late, false);
    void *samples = sp_brick_map(bytes, err);
    const struct sp_brick_fill_job job = { .file = store->file,
                                           .need = &store->base_need,
                                           .pool = store->pool,
                                           .is_cancelled = is_cancelled,
                                           .user = &loading,
                                           .samples = samples,
                                           .vectors = (float(*)[3])sp_brick_store_vectors(
                                               store, &store->base_need, samples),
                                           .lost = store->base_lost };
    if (!samples)
        return NULL;
    bool ok = sp_brick_fill(&job, &why, err);
    if (!ok && atomic_load(&loading.is_late))
        sp_fail(err, SP_ERR_TIMEOUT, source, "reading it took longer than the limit of %.3g s",
                timeout_ms / 1000.0);
    if (ok && why.code != SP_OK && has_lost_all(store))
        ok = sp_fail(err, why.code, why.place, "%s", why.text);
    if (ok && !sp_brick_store_grid(store, &store->base_need, &info.grid, &numbers))
        ok = sp_fail(err, SP_ERR_MEMORY, source, "out of memory for a brick file");
    if (!ok) {
        sp_brick_unmap(samples, bytes);
        return NULL;
    }
    if (why.code != SP_OK)
        sp_brick_store_note(store, &store->base_need, store->base_lost, &why);
    struct sp_volume *base = adopt(store, &info, samples, bytes, err);
    free(numbers);
    return base;
}

static struct sp_volume *start(struct sp_brick_store *store, const char *name, const char *source,
                               const struct sp_load_options *options, struct sp_error *err) {
    const struct sp_chunk_source *chunks = sp_brick_file_chunks(store->file);
    uint64_t bricks = 0;
    for (unsigned l = 0; l < sp_brick_file_header(store->file)->levels; l++)
        bricks += sp_brick_count(&sp_brick_file_header(store->file)->level[l]);
    if (!(store->damaged = calloc(1, bricks))) {
        sp_fail(err, SP_ERR_MEMORY, source, "out of memory for a brick file");
        return NULL;
    }
    choose_budget(store, options);
    store->memory = options && options->subvolumes ? sp_brick_memory_ref(options->subvolumes)
                                                   : sp_brick_memory_create(store->budget, err);
    if (!store->memory)
        return NULL;
    sp_brick_memory_add(store->memory, store);
    if (!reserve(store, source, options, err) ||
        !(store->pool = sp_pool_create(chunks ? chunks->readers : sp_volume_threads(), err)))
        return NULL;
    if (!options || !options->subvolumes)
        sp_brick_memory_set(store->memory, store->budget);
    struct sp_volume *base = make_base(store, name, source, options, err);
    store->base = base;
    if (base && pthread_create(&store->thread, NULL, sp_brick_store_read, store) != 0) {
        sp_fail(err, SP_ERR_MEMORY, source, "cannot start a thread for reading bricks");
        sp_volume_unref(&base);
    }
    if (base)
        sp_volume_set_source(base, store, destroy);
    return base;
}

/* Takes over the file; NULL = it could not be opened, and *err says why. */
static struct sp_volume *open_store(struct sp_brick_file *file, const char *name,
                                    const char *source, const struct sp_load_options *options,
                                    struct sp_error *err) {
    struct sp_brick_store *store = file ? calloc(1, sizeof *store) : NULL;
    if (!file)
        return NULL;
    if (!store) {
        sp_brick_file_close(&file);
        sp_fail(err, SP_ERR_MEMORY, source, "out of memory for a brick file");
        return NULL;
    }
    store->retry_ms = 10000;
    store->publish_ms = 1000;
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&store->asked, NULL);
    pthread_cond_init(&store->done, &monotonic);
    pthread_condattr_destroy(&monotonic);
    store->file = file;
    struct sp_volume *base = start(store, name, source, options, err);
    if (!base)
        release(store);
    return base;
}

struct sp_volume *sp_brick_store_open(int fd, const char *name, const char *source,
                                      const struct sp_load_options *options, struct sp_error *err) {
    flock(fd, LOCK_SH | LOCK_NB); /* for store.h; goes with the descriptor */
    return open_store(sp_brick_file_open(fd, source, err), name, source, options, err);
}

struct sp_volume *sp_brick_store_open_chunks(const struct sp_chunk_source *chunks, const char *name,
                                             const char *source,
                                             const struct sp_load_options *options,
                                             struct sp_error *err) {
    return open_store(sp_brick_file_of_chunks(chunks, source, err), name, source, options, err);
}
