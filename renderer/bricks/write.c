/* SPDX-License-Identifier: Apache-2.0 */
#include "bricks/write.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zstd.h>

#include "base/parallel_for.h"
#include "bricks/samples.h"
#include "bricks/transfer.h"
#include "volume/grid.h"
#include "volume/volume.h"

enum { ZSTD_LEVEL = 1, THREADS_MAX = 16, PROJECTED_SIDE = 256 };
/* Shares of the time, for the progress: level 0, then the histogram. */
static const double level_share = 0.7, histogram_share = 0.2;

/* A row of bricks, with the rows and slices around it. */
struct strip {
    uint32_t first[2], size[2]; /* of its own samples: along axes 1 and 2 */
    uint32_t from[2], count[2]; /* in memory: with the margin */
    void *samples;
};

struct worker {
    ZSTD_CCtx *context;
    void *copy; /* samples of a brick */
    uint64_t histogram[SP_HISTOGRAM_BINS];
    uint64_t zeros; /* samples in holes, for the histogram */
    bool failed;    /* reading for it */
};

struct writer {
    const struct sp_bricks_write_job *job;
    struct sp_brick_header header;
    struct sp_pool *pool;
    struct worker workers[THREADS_MAX];
    unsigned l; /* the level that is written */
    size_t sample;
    int fine, coarse; /* descriptors: samples of the level, and of the next one; −1 = none */
    uint64_t at;      /* end of the file */
    struct strip strip;
    void *means;                    /* of the strip, for the next level */
    struct sp_brick_entry *entries; /* of the level */
    struct packed {
        void *bytes; /* [packed_max] */
        size_t size; /* 0 = constant */
        bool failed;
        uint64_t nonfinite;
    } * packed; /* by brick of the strip */
    uint64_t first_brick;
    size_t packed_max;
    size_t first_chunk; /* of those that are counted now */
};

static bool fail_memory(const struct writer *w, struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, w->job->shown, "out of memory for a strip of bricks");
}

static bool write_at(const struct writer *w, int fd, const void *bytes, size_t size, uint64_t at,
                     struct sp_error *err) {
    return sp_write_at(fd, bytes, size, at) ||
           sp_fail(err, SP_ERR_IO, w->job->shown, "cannot write: %s", strerror(errno));
}

static bool report(const struct writer *w, double fraction, struct sp_error *err) {
    return !w->job->progress || w->job->progress(w->job->user, fraction) ||
           sp_fail(err, SP_ERR_CANCELLED, w->job->shown, "cancelled");
}

/* The samples [*from, *from + *count) that `size` samples from `first` on need around them. */
static void widen(uint32_t first, uint32_t size, uint32_t dim, uint32_t *from, uint32_t *count) {
    uint32_t end = first + size + BRICK_MARGIN < dim ? first + size + BRICK_MARGIN : dim;
    *from = first > BRICK_MARGIN ? first - BRICK_MARGIN : 0;
    *count = end - *from;
}

static bool read_strip(struct writer *w, struct sp_error *err) {
    const uint32_t *dims = w->header.level[w->l].dims;
    struct strip *s = &w->strip;
    const size_t row = dims[0] * w->sample, part = s->count[0] * row;
    for (uint32_t z = 0; z < s->count[1]; z++) {
        uint64_t at = ((uint64_t)(s->from[1] + z) * dims[1] + s->from[0]) * row;
        if (!sp_read_sparse(w->fine, (char *)s->samples + z * part, part, at))
            return sp_fail(err, SP_ERR_IO, w->job->shown, "cannot read the samples: %s",
                           strerror(errno));
    }
    return true;
}

/* True if all samples of the strip, with the margin, lie in holes of the file: they are 0. */
static bool is_empty(const struct writer *w) {
    const uint32_t *dims = w->header.level[w->l].dims;
    const struct strip *s = &w->strip;
    const size_t row = dims[0] * w->sample;
    for (uint32_t z = 0; z < s->count[1]; z++)
        if (!sp_is_hole(w->fine, s->count[0] * row,
                        ((uint64_t)(s->from[1] + z) * dims[1] + s->from[0]) * row))
            return false;
    return true;
}

static struct sp_brick_view view_of(const struct writer *w) {
    const struct strip *s = &w->strip;
    const uint32_t *dims = w->header.level[w->l].dims;
    return (struct sp_brick_view){
        .samples = s->samples,
        .type = w->header.info.type,
        .width = dims[0],
        .height = s->count[0],
        .first = { 0, s->first[0] - s->from[0], s->first[1] - s->from[1] },
        .size = { dims[0], s->size[0], s->size[1] },
    };
}

/* Finds the range of a brick of the strip and packs it. */
static void pack_brick(struct writer *w, uint32_t b, struct worker *worker) {
    const struct strip *s = &w->strip;
    const struct sp_brick_level *level = &w->header.level[w->l];
    struct sp_brick_entry *entry = &w->entries[w->first_brick + b];
    struct packed *packed = &w->packed[b];
    struct sp_brick_view own = view_of(w), around = own;
    own.first[0] = b * BRICK_SIDE;
    own.size[0] =
        level->dims[0] - own.first[0] < BRICK_SIDE ? level->dims[0] - own.first[0] : BRICK_SIDE;
    widen(own.first[0], own.size[0], level->dims[0], &around.first[0], &around.size[0]);
    around.first[1] = around.first[2] = 0;
    around.size[1] = s->count[0];
    around.size[2] = s->count[1];
    const struct sp_brick_range all = sp_brick_find_range(&around), in = sp_brick_find_range(&own);
    *entry = (struct sp_brick_entry){ .range = { all.least, all.most } };
    packed->nonfinite = in.nonfinite;
    packed->size = 0;
    packed->failed = false;
    sp_brick_copy(&own, worker->copy);
    if (in.is_constant) {
        memcpy(&entry->at, worker->copy, w->sample);
        return;
    }
    const size_t count = (size_t)own.size[0] * own.size[1] * own.size[2];
    packed->size = ZSTD_compress2(worker->context, packed->bytes, w->packed_max, worker->copy,
                                  count * w->sample);
    packed->failed = ZSTD_isError(packed->size);
}

static void pack_bricks(void *user, size_t begin, size_t end, unsigned worker) {
    struct writer *w = user;
    for (size_t b = begin; b < end; b++)
        pack_brick(w, (uint32_t)b, &w->workers[worker]);
}

static bool write_packed(struct writer *w, struct sp_error *err) {
    for (uint32_t b = 0; b < w->header.level[w->l].bricks[0]; b++) {
        struct sp_brick_entry *entry = &w->entries[w->first_brick + b];
        const struct packed *packed = &w->packed[b];
        if (packed->failed)
            return fail_memory(w, err);
        if (w->l == 0)
            w->header.info.nonfinite += packed->nonfinite;
        if (!packed->size)
            continue;
        entry->at = w->at;
        entry->bytes = (uint32_t)packed->size;
        memcpy(&entry->check, (char *)packed->bytes + packed->size - sizeof entry->check,
               sizeof entry->check);
        if (!write_at(w, w->job->out, packed->bytes, packed->size, w->at, err))
            return false;
        w->at += packed->size;
    }
    return true;
}

/* Bytes of a slice of the strip's means. */
static size_t means_bytes(const struct writer *w) {
    return (size_t)w->header.level[w->l + 1].dims[0] * w->sample * ((w->strip.size[0] + 1) / 2);
}

/* Averages the slices [begin, end) of the means. */
static void average(void *user, size_t begin, size_t end, unsigned worker) {
    struct writer *w = user;
    const uint32_t slices = w->strip.size[1] - 2 * (uint32_t)begin;
    struct sp_brick_view view = view_of(w);
    (void)worker;
    view.first[2] += 2 * (uint32_t)begin;
    view.size[2] = slices < 2 * (end - begin) ? slices : 2 * (uint32_t)(end - begin);
    sp_brick_average(&view, (char *)w->means + begin * means_bytes(w));
}

/* Writes the means of the strip to the next level. */
static bool write_means(struct writer *w, struct sp_error *err) {
    const uint32_t *dims = w->header.level[w->l + 1].dims;
    const struct strip *s = &w->strip;
    const size_t row = dims[0] * w->sample, part = means_bytes(w);
    sp_parallel_for(w->pool, (s->size[1] + 1) / 2, 1, average, w);
    for (uint32_t z = 0; 2 * z < s->size[1]; z++) {
        uint64_t at = ((uint64_t)(s->first[1] / 2 + z) * dims[1] + s->first[0] / 2) * row;
        if (!sp_write_sparse(w->coarse, (char *)w->means + z * part, part, at))
            return sp_fail(err, SP_ERR_IO, w->job->shown, "cannot write: %s", strerror(errno));
    }
    return true;
}

static void place_strip(struct writer *w, uint32_t row, uint32_t slab) {
    const struct sp_brick_level *level = &w->header.level[w->l];
    struct strip *s = &w->strip;
    w->first_brick = ((uint64_t)slab * level->bricks[1] + row) * level->bricks[0];
    s->first[0] = row * BRICK_SIDE;
    s->first[1] = slab * BRICK_SIDE;
    for (int i = 0; i < 2; i++) {
        const uint32_t left = level->dims[i + 1] - s->first[i];
        s->size[i] = left < BRICK_SIDE ? left : BRICK_SIDE;
        widen(s->first[i], s->size[i], level->dims[i + 1], &s->from[i], &s->count[i]);
    }
}

static bool write_strip(struct writer *w, struct sp_error *err) {
    if (!read_strip(w, err))
        return false;
    sp_parallel_for(w->pool, w->header.level[w->l].bricks[0], 1, pack_bricks, w);
    return write_packed(w, err) && (w->coarse < 0 || write_means(w, err));
}

/* Entries of strips in holes stay as they are: 0, which is their sample and their range. */
static bool write_strips(struct writer *w, struct sp_error *err) {
    const struct sp_brick_level *level = &w->header.level[w->l];
    for (uint32_t slab = 0; slab < level->bricks[2]; slab++)
        for (uint32_t row = 0; row < level->bricks[1]; row++) {
            place_strip(w, row, slab);
            const double done = ((double)slab * level->bricks[1] + row) /
                                ((double)level->bricks[1] * level->bricks[2]);
            if (!report(w, w->l ? level_share + histogram_share : level_share * done, err) ||
                (!is_empty(w) && !write_strip(w, err)))
                return false;
        }
    return true;
}

static bool write_index(struct writer *w, struct sp_error *err) {
    struct sp_brick_level *level = &w->header.level[w->l];
    const uint64_t count = sp_brick_count(level);
    const size_t size = count * BRICK_ENTRY_BYTES;
    unsigned char *bytes = malloc(size);
    if (!bytes)
        return fail_memory(w, err);
    for (uint64_t i = 0; i < count; i++)
        sp_brick_entry_encode(&w->entries[i], bytes + i * BRICK_ENTRY_BYTES);
    level->index_at = w->at;
    level->checksum = sp_brick_checksum(bytes, size);
    bool ok = write_at(w, w->job->out, bytes, size, w->at, err);
    w->at += size;
    free(bytes);
    return ok;
}

/* Memory for the strips of level 0, the largest ones. */
static bool allocate(struct writer *w, struct sp_error *err) {
    const uint32_t *dims = w->header.info.grid.dims;
    const size_t side = BRICK_SIDE + 2 * BRICK_MARGIN, brick = BRICK_SIDE * BRICK_SIDE * BRICK_SIDE;
    const uint32_t bricks = w->header.level[0].bricks[0];
    w->packed_max = ZSTD_compressBound(brick * w->sample);
    w->strip.samples = malloc(dims[0] * side * side * w->sample);
    w->means = malloc(((size_t)dims[0] + 1) / 2 * BRICK_SIDE * BRICK_SIDE / 4 * w->sample);
    w->packed = calloc(bricks, sizeof *w->packed);
    bool ok = w->strip.samples && w->means && w->packed;
    for (uint32_t b = 0; ok && b < bricks; b++)
        ok = (w->packed[b].bytes = malloc(w->packed_max)) != NULL;
    for (unsigned t = 0; ok && t < sp_pool_threads(w->pool); t++) {
        struct worker *worker = &w->workers[t];
        ok = (worker->copy = malloc(brick * w->sample)) && (worker->context = ZSTD_createCCtx());
        if (!ok)
            break;
        ZSTD_CCtx_setParameter(worker->context, ZSTD_c_compressionLevel, ZSTD_LEVEL);
        ZSTD_CCtx_setParameter(worker->context, ZSTD_c_checksumFlag, 1);
    }
    return ok || fail_memory(w, err);
}

static void release(struct writer *w) {
    for (uint32_t b = 0; w->packed && b < w->header.level[0].bricks[0]; b++)
        free(w->packed[b].bytes);
    for (int t = 0; t < THREADS_MAX; t++) {
        ZSTD_freeCCtx(w->workers[t].context);
        free(w->workers[t].copy);
    }
    free(w->packed);
    free(w->strip.samples);
    free(w->means);
    free(w->entries);
    if (w->fine >= 0 && w->fine != w->job->samples)
        close(w->fine);
    if (w->coarse >= 0)
        close(w->coarse);
    sp_pool_destroy(&w->pool);
}

static void find_range(struct writer *w) {
    double range[2] = { INFINITY, -INFINITY };
    for (uint64_t i = 0; i < sp_brick_count(&w->header.level[0]); i++) {
        range[0] = fmin(range[0], w->entries[i].range[0]);
        range[1] = fmax(range[1], w->entries[i].range[1]);
    }
    for (int i = 0; i < 2; i++)
        w->header.info.range[i] = range[0] <= range[1] ? range[i] : 0;
}

/* Gives the samples of the next level their size. */
static bool set_size(const struct writer *w, struct sp_error *err) {
    const uint32_t *dims = w->header.level[w->l + 1].dims;
    const uint64_t bytes = (uint64_t)dims[0] * dims[1] * dims[2] * w->sample;
    return ftruncate(w->coarse, (off_t)bytes) == 0 ||
           sp_fail(err, SP_ERR_IO, w->job->shown, "cannot write: %s", strerror(errno));
}

static bool write_level(struct writer *w, struct sp_error *err) {
    const bool is_last = w->l + 1 == w->header.levels;
    free(w->entries);
    w->entries = calloc(sp_brick_count(&w->header.level[w->l]), sizeof *w->entries);
    if (!w->entries)
        return fail_memory(w, err);
    w->coarse = is_last ? -1 : sp_bricks_temporary(w->job->folder, err);
    if (!is_last && (w->coarse < 0 || !set_size(w, err)))
        return false;
    if (!write_strips(w, err) || !write_index(w, err))
        return false;
    if (w->l == 0)
        find_range(w);
    return true;
}

/* Counts the values of a chunk of samples, without reading holes. */
static bool count_data(const struct writer *w, struct worker *own, uint64_t at, uint64_t end) {
    uint64_t from, to;
    for (; at < end; at = to) {
        sp_find_data(w->job->samples, at, end, &from, &to);
        from -= from % w->sample; /* whole samples, wherever the holes begin and end */
        to = to < end ? to + (w->sample - to % w->sample) % w->sample : end;
        own->zeros += (from - at) / w->sample;
        if (from == end)
            break;
        if (!sp_read_at(w->job->samples, own->copy, (size_t)(to - from), from))
            return false;
        sp_brick_count_values(own->copy, w->header.info.type, (size_t)(to - from) / w->sample,
                              w->header.info.range, own->histogram);
    }
    return true;
}

static void count_chunk(void *user, size_t begin, size_t end, unsigned worker) {
    struct writer *w = user;
    struct worker *own = &w->workers[worker];
    const uint64_t bytes = w->header.info.voxel_bytes;
    const size_t chunk = BRICK_SIDE * BRICK_SIDE * BRICK_SIDE; /* samples: of the worker's copy */
    for (size_t i = w->first_chunk + begin; i < w->first_chunk + end; i++) {
        const uint64_t at = (uint64_t)i * chunk * w->sample;
        const uint64_t size = bytes - at < chunk * w->sample ? bytes - at : chunk * w->sample;
        own->failed = own->failed || !count_data(w, own, at, at + size);
    }
}

static bool count_values(struct writer *w, struct sp_error *err) {
    enum { STEP = 128 }; /* chunks between two reports */
    const size_t chunk = (size_t)BRICK_SIDE * BRICK_SIDE * BRICK_SIDE * w->sample;
    const size_t chunks = (size_t)((w->header.info.voxel_bytes + chunk - 1) / chunk);
    for (w->first_chunk = 0; w->first_chunk < chunks; w->first_chunk += STEP) {
        const size_t left = chunks - w->first_chunk;
        const double done = (double)w->first_chunk / (double)chunks;
        if (!report(w, level_share + histogram_share * done, err))
            return false;
        sp_parallel_for(w->pool, left < STEP ? left : STEP, 1, count_chunk, w);
    }
    for (unsigned t = 0; t < sp_pool_threads(w->pool); t++) {
        if (w->workers[t].failed)
            return sp_fail(err, SP_ERR_IO, w->job->shown, "cannot read the samples again");
        uint64_t zero[SP_HISTOGRAM_BINS] = { 0 };
        const double sample = 0; /* as many bytes of 0 as any type has */
        sp_brick_count_values(&sample, w->header.info.type, 1, w->header.info.range, zero);
        for (int b = 0; b < SP_HISTOGRAM_BINS; b++)
            w->header.info.histogram[b] +=
                w->workers[t].histogram[b] + w->workers[t].zeros * zero[b];
    }
    return report(w, level_share + histogram_share, err);
}

/* Finds what projections show, from the first level that is small enough, which `fd` holds. */
static bool find_projected(struct writer *w, int fd, struct sp_error *err) {
    const struct sp_brick_level *level = &w->header.level[w->l];
    struct sp_volume_info coarse = w->header.info;
    size_t bytes = w->sample;
    for (int a = 0; a < 3; a++) {
        coarse.grid.dims[a] = level->dims[a];
        coarse.grid.spacing[a] = ldexp(w->header.info.grid.spacing[a], (int)w->l);
        bytes *= level->dims[a];
    }
    void *samples = malloc(bytes);
    bool ok = samples != NULL;
    if (!ok)
        fail_memory(w, err);
    else if (!sp_read_at(fd, samples, bytes, 0))
        ok = sp_fail(err, SP_ERR_IO, w->job->shown, "cannot read the samples again");
    ok = ok && sp_volume_project(&coarse, samples, err);
    w->header.info.projected = coarse.projected;
    free(samples);
    return ok;
}

static bool is_small(const struct sp_brick_level *level) {
    return level->dims[0] <= PROJECTED_SIDE && level->dims[1] <= PROJECTED_SIDE &&
           level->dims[2] <= PROJECTED_SIDE;
}

static bool write_levels(struct writer *w, struct sp_error *err) {
    bool is_projected = false;
    w->fine = w->job->samples;
    for (w->l = 0; w->l < w->header.levels; w->l++) {
        if (!write_level(w, err) || (w->l == 0 && !count_values(w, err)))
            return false;
        if (!is_projected && (w->coarse < 0 || is_small(&w->header.level[w->l]))) {
            if (!find_projected(w, w->fine, err))
                return false;
            is_projected = true;
        }
        if (w->fine != w->job->samples)
            close(w->fine);
        w->fine = w->coarse;
        w->coarse = -1;
    }
    return true;
}

static bool write_notes(struct writer *w, struct sp_error *err) {
    const size_t size = sp_brick_notes_bytes(w->job->info);
    unsigned char *bytes = calloc(1, size);
    if (!bytes)
        return fail_memory(w, err);
    sp_brick_notes_encode(w->job->info, bytes);
    w->header.notes_at = w->at;
    w->header.notes_bytes = size;
    w->header.notes_checksum = sp_brick_checksum(bytes, size);
    bool ok = write_at(w, w->job->out, bytes, size, w->at, err);
    w->at += size;
    free(bytes);
    return ok;
}

/* The header comes last: a file that is not complete has none. */
static bool write_header(struct writer *w, struct sp_error *err) {
    unsigned char bytes[BRICK_HEADER_BYTES];
    sp_brick_header_encode(&w->header, bytes);
    if (!write_at(w, w->job->out, bytes, sizeof bytes, 0, err))
        return false;
    return fsync(w->job->out) == 0 ||
           sp_fail(err, SP_ERR_IO, w->job->shown, "cannot write: %s", strerror(errno));
}

/* What the file has of the description. */
static void describe(const struct sp_volume_info *from, struct sp_volume_info *to) {
    to->grid = from->grid;
    to->type = from->type;
    to->voxel_bytes = (uint64_t)from->grid.dims[0] * from->grid.dims[1] * from->grid.dims[2] *
                      sp_type_size(from->type);
    memcpy(to->unit, from->unit, sizeof to->unit);
    memcpy(to->anatomy, from->anatomy, sizeof to->anatomy);
    memcpy(to->value_name, from->value_name, sizeof to->value_name);
    memcpy(to->value_unit, from->value_unit, sizeof to->value_unit);
}

bool sp_bricks_write(const struct sp_bricks_write_job *job, struct sp_error *err) {
    if (sp_grid_is_rectilinear(&job->info->grid))
        return sp_fail(err, SP_ERR_UNSUPPORTED, job->shown,
                       "brick files have evenly spaced axes, and this grid is rectilinear");
    struct writer *w = calloc(1, sizeof *w);
    if (!w)
        return sp_fail(err, SP_ERR_MEMORY, job->shown, "out of memory for a brick file");
    w->job = job;
    w->fine = w->coarse = -1;
    w->at = BRICK_HEADER_BYTES;
    w->sample = sp_type_size(job->info->type);
    describe(job->info, &w->header.info);
    sp_brick_header_init(&w->header);
    bool ok = (w->pool = sp_pool_create(sp_volume_threads(), err)) && allocate(w, err) &&
              write_levels(w, err) && write_notes(w, err) && write_header(w, err) &&
              report(w, 1, err);
    release(w);
    free(w);
    return ok;
}
