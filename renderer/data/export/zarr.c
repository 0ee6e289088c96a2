/* SPDX-License-Identifier: Apache-2.0
 *
 * Chunks of an OME-Zarr image, written strip by strip. A strip has all columns of one row of
 * chunks, so that memory grows with the width of the volume alone.
 */
#include "data/export/zarr.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zstd.h>

#include "base/parallel_for.h"
#include "base/transfer.h"
#include "data/bricks/samples.h"
#include "data/volume/volume.h"

enum { THREADS_MAX = 16, SAMPLES_MAX = ZARR_CHUNK * ZARR_CHUNK * ZARR_CHUNK };

struct worker {
    ZSTD_CCtx *context;
    char *chunk; /* samples */
    void *packed;
    double range[2];
    int error; /* errno of the first failure; 0 = none */
};

struct writer {
    struct sp_zarr_image image;
    struct sp_pool *pool;
    struct worker workers[THREADS_MAX];
    unsigned l; /* the level that is written */
    size_t sample, packed_max;
    int fine, coarse;        /* descriptors: samples of the level, and of the next; −1 = none */
    uint32_t at[2], size[2]; /* of the strip along y and z: chunks before it, its samples */
    void *strip, *means;     /* samples of the strip, and for the next level */
    double done, total;      /* samples of all levels */
};

static bool fail_write(const struct writer *w, int why, struct sp_error *err) {
    return sp_fail(err, SP_ERR_IO, w->image.job->title, "cannot write: %s", strerror(why));
}

static bool fail_memory(const struct writer *w, struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, w->image.job->title, "out of memory for a row of chunks");
}

static bool write_chunk(const struct writer *w, uint32_t x, const void *bytes, size_t size) {
    char path[64];
    snprintf(path, sizeof path, "%u/%u/%u/%u", w->l, w->at[1], w->at[0], x);
    const int fd = openat(w->image.job->out, path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    bool ok = fd >= 0 && sp_write_at(fd, bytes, size, 0);
    const int why = errno;
    if (fd >= 0 && close(fd) != 0)
        return false;
    errno = why;
    return ok;
}

/* Copies the samples of a view into a whole chunk, whose other samples are 0. */
static void fill_chunk(const struct writer *w, const struct sp_brick_view *view, char *chunk) {
    const uint32_t *side = w->image.level[w->l].chunk;
    const size_t bytes = (size_t)side[0] * side[1] * side[2] * w->sample;
    if (view->size[0] < side[0] || view->size[1] < side[1] || view->size[2] < side[2])
        memset(chunk, 0, bytes);
    for (uint32_t z = 0; z < view->size[2]; z++)
        for (uint32_t y = 0; y < view->size[1]; y++)
            memcpy(chunk + ((size_t)z * side[1] + y) * side[0] * w->sample,
                   (const char *)view->samples +
                       ((z * view->height + y) * view->width + view->first[0]) * w->sample,
                   view->size[0] * w->sample);
}

static struct sp_brick_view view_of(const struct writer *w) {
    const uint32_t width = w->image.level[w->l].dims[0];
    return (struct sp_brick_view){ .samples = w->strip,
                                   .type = w->image.job->info->type,
                                   .are_labels = w->image.job->info->meaning == SP_MEANING_LABELS,
                                   .width = width,
                                   .height = w->size[0],
                                   .size = { width, w->size[0], w->size[1] } };
}

static bool is_zero(const struct writer *w, const struct sp_brick_view *view) {
    static const char zeros[8];
    return memcmp((const char *)view->samples + view->first[0] * w->sample, zeros, w->sample) == 0;
}

static void pack_chunk(const struct writer *w, uint32_t x, struct worker *worker) {
    const struct sp_zarr_level *level = &w->image.level[w->l];
    struct sp_brick_view view = view_of(w);
    view.first[0] = x * ZARR_CHUNK;
    const uint32_t left = level->dims[0] - view.first[0];
    view.size[0] = left < ZARR_CHUNK ? left : ZARR_CHUNK;
    const struct sp_brick_range range = sp_brick_measure_range(&view);
    if (w->l == 0) {
        worker->range[0] = fmin(worker->range[0], range.least);
        worker->range[1] = fmax(worker->range[1], range.most);
    }
    if (range.is_constant && is_zero(w, &view))
        return;
    fill_chunk(w, &view, worker->chunk);
    const size_t bytes = (size_t)level->chunk[0] * level->chunk[1] * level->chunk[2] * w->sample;
    const size_t size =
        ZSTD_compress2(worker->context, worker->packed, w->packed_max, worker->chunk, bytes);
    if (ZSTD_isError(size))
        worker->error = ENOMEM;
    else if (!write_chunk(w, x, worker->packed, size))
        worker->error = errno;
}

static void pack_chunks(void *user, size_t begin, size_t end, unsigned worker) {
    struct writer *w = user;
    for (size_t x = begin; x < end && !w->workers[worker].error; x++)
        pack_chunk(w, (uint32_t)x, &w->workers[worker]);
}

static bool read_strip(struct writer *w, struct sp_error *err) {
    const uint32_t *dims = w->image.level[w->l].dims;
    const size_t row = dims[0] * w->sample, part = w->size[0] * row;
    for (uint32_t z = 0; z < w->size[1]; z++) {
        const uint64_t at =
            ((uint64_t)(w->at[1] * ZARR_CHUNK + z) * dims[1] + w->at[0] * ZARR_CHUNK) * row;
        if (!sp_read_sparse(w->fine, (char *)w->strip + z * part, part, at))
            return sp_fail(err, SP_ERR_IO, w->image.job->title, "cannot read the samples: %s",
                           strerror(errno));
    }
    return true;
}

/* Writes the means of the strip to the samples of the next level. */
static bool write_means(struct writer *w, struct sp_error *err) {
    const uint32_t *dims = w->image.level[w->l + 1].dims;
    const size_t row = dims[0] * w->sample, part = (w->size[0] + 1) / 2 * row;
    const struct sp_brick_view view = view_of(w);
    sp_brick_average(&view, w->means);
    for (uint32_t z = 0; 2 * z < w->size[1]; z++) {
        const uint64_t at =
            ((uint64_t)(w->at[1] * (ZARR_CHUNK / 2) + z) * dims[1] + w->at[0] * (ZARR_CHUNK / 2)) *
            row;
        if (!sp_write_sparse(w->coarse, (char *)w->means + z * part, part, at))
            return fail_write(w, errno, err);
    }
    return true;
}

/* Makes the folder of the strip's slab, and in it the folder of the strip's chunks. */
static bool make_folders(const struct writer *w, struct sp_error *err) {
    char path[48];
    snprintf(path, sizeof path, "%u/%u", w->l, w->at[1]);
    bool ok = w->at[0] > 0 || mkdirat(w->image.job->out, path, 0777) == 0;
    snprintf(path, sizeof path, "%u/%u/%u", w->l, w->at[1], w->at[0]);
    ok = ok && mkdirat(w->image.job->out, path, 0777) == 0;
    return ok || fail_write(w, errno, err);
}

static bool write_strip(struct writer *w, struct sp_error *err) {
    const uint32_t *dims = w->image.level[w->l].dims;
    for (int i = 0; i < 2; i++) {
        const uint32_t left = dims[i + 1] - w->at[i] * ZARR_CHUNK;
        w->size[i] = left < ZARR_CHUNK ? left : ZARR_CHUNK;
    }
    if (!sp_export_report(w->image.job, w->done / w->total, err) || !make_folders(w, err) ||
        !read_strip(w, err))
        return false;
    sp_parallel_for(w->pool, (dims[0] + ZARR_CHUNK - 1) / ZARR_CHUNK, 1, pack_chunks, w);
    for (unsigned t = 0; t < sp_pool_threads(w->pool); t++)
        if (w->workers[t].error)
            return fail_write(w, w->workers[t].error, err);
    w->done += (double)dims[0] * w->size[0] * w->size[1];
    return w->coarse < 0 || write_means(w, err);
}

/* Opens the file for the samples of the next level. */
static bool open_coarse(struct writer *w, struct sp_error *err) {
    if (w->l + 1 == w->image.levels)
        return true;
    const uint32_t *dims = w->image.level[w->l + 1].dims;
    w->coarse = sp_temporary_file(w->image.job->folder, err);
    return w->coarse >= 0 &&
           (ftruncate(w->coarse, (off_t)((uint64_t)dims[0] * dims[1] * dims[2] * w->sample)) == 0 ||
            fail_write(w, errno, err));
}

static bool write_level(struct writer *w, struct sp_error *err) {
    const uint32_t *dims = w->image.level[w->l].dims;
    char name[16];
    snprintf(name, sizeof name, "%u", w->l);
    if (mkdirat(w->image.job->out, name, 0777) != 0)
        return fail_write(w, errno, err);
    if (!open_coarse(w, err))
        return false;
    for (w->at[1] = 0; w->at[1] * ZARR_CHUNK < dims[2]; w->at[1]++)
        for (w->at[0] = 0; w->at[0] * ZARR_CHUNK < dims[1]; w->at[0]++)
            if (!write_strip(w, err))
                return false;
    if (w->fine != w->image.job->samples)
        close(w->fine);
    w->fine = w->coarse;
    w->coarse = -1;
    return true;
}

/* Memory for the strips of level 0, the largest ones. */
static bool allocate(struct writer *w, struct sp_error *err) {
    const struct sp_zarr_level *level = &w->image.level[0];
    const size_t wide = level->dims[0], rows = (size_t)level->chunk[1] * level->chunk[2];
    w->packed_max = ZSTD_compressBound(SAMPLES_MAX * w->sample);
    w->strip = malloc(wide * rows * w->sample);
    w->means = malloc((wide + 1) / 2 * (ZARR_CHUNK / 2) * (ZARR_CHUNK / 2) * w->sample);
    bool ok = w->strip && w->means;
    for (unsigned t = 0; ok && t < sp_pool_threads(w->pool); t++) {
        struct worker *worker = &w->workers[t];
        *worker = (struct worker){ .range = { INFINITY, -INFINITY } };
        ok = (worker->chunk = malloc(SAMPLES_MAX * w->sample)) &&
             (worker->packed = malloc(w->packed_max)) && (worker->context = ZSTD_createCCtx());
        if (ok)
            ZSTD_CCtx_setParameter(worker->context, ZSTD_c_compressionLevel, ZARR_ZSTD_LEVEL);
    }
    return ok || fail_memory(w, err);
}

static void release(struct writer *w) {
    for (int t = 0; t < THREADS_MAX; t++) {
        ZSTD_freeCCtx(w->workers[t].context);
        free(w->workers[t].chunk);
        free(w->workers[t].packed);
    }
    free(w->strip);
    free(w->means);
    if (w->fine >= 0 && w->fine != w->image.job->samples)
        close(w->fine);
    if (w->coarse >= 0)
        close(w->coarse);
    sp_pool_destroy(&w->pool);
}

static bool write_levels(struct writer *w, struct sp_error *err) {
    for (unsigned l = 0; l < w->image.levels; l++) {
        const uint32_t *dims = w->image.level[l].dims;
        w->total += (double)dims[0] * dims[1] * dims[2];
    }
    for (w->l = 0; w->l < w->image.levels; w->l++)
        if (!write_level(w, err))
            return false;
    double *range = w->image.range;
    range[0] = INFINITY;
    range[1] = -INFINITY;
    for (unsigned t = 0; t < sp_pool_threads(w->pool); t++) {
        range[0] = fmin(range[0], w->workers[t].range[0]);
        range[1] = fmax(range[1], w->workers[t].range[1]);
    }
    return true;
}

bool sp_export_zarr(const struct sp_export_job *job, struct sp_error *err) {
    struct writer *w = calloc(1, sizeof *w);
    if (!w)
        return sp_fail(err, SP_ERR_MEMORY, job->title, "out of memory");
    w->sample = sp_type_size(job->info->type);
    w->fine = job->samples;
    w->coarse = -1;
    bool ok = sp_zarr_image_init(&w->image, job, err) &&
              (w->pool = sp_pool_create(sp_volume_threads(), err)) && allocate(w, err) &&
              write_levels(w, err) && sp_zarr_write_text(&w->image, err);
    if (ok && syncfs(job->out) != 0)
        ok = fail_write(w, errno, err);
    release(w);
    free(w);
    return ok && sp_export_report(job, 1, err);
}
