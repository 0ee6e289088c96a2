/* SPDX-License-Identifier: Apache-2.0 */
#include <endian.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/transfer.h"
#include "data/bricks/places.h"
#include "data/bricks/write_private.h"
#include "data/volume/grid.h"
#include "data/volume/volume.h"

enum { ZSTD_LEVEL = 1 };
/* Shares of the progress of the samples: level 0, then the histogram. */
static const double level_share = 0.7, histogram_share = 0.2;

bool sp_bricks_write_fail_memory(const struct sp_brick_writer *w, struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, w->job->title, "out of memory for a strip of bricks");
}

static bool write_at(const struct sp_brick_writer *w, int fd, const void *bytes, size_t size,
                     uint64_t at, struct sp_error *err) {
    return sp_write_at(fd, bytes, size, at) ||
           sp_fail(err, SP_ERR_IO, w->job->title, "cannot write: %s", strerror(errno));
}

bool sp_bricks_write_report(const struct sp_brick_writer *w, double fraction,
                            struct sp_error *err) {
    const double done = w->array.from + w->array.share * fraction;
    return !w->job->progress || w->job->progress(w->job->user, done) ||
           sp_fail(err, SP_ERR_CANCELLED, w->job->title, "cancelled");
}

/* The samples [*from, *from + *count) that `size` samples from `first` on need around them. */
static void widen(uint32_t first, uint32_t size, uint32_t dim, uint32_t *from, uint32_t *count) {
    uint32_t end = first + size + BRICK_MARGIN < dim ? first + size + BRICK_MARGIN : dim;
    *from = first > BRICK_MARGIN ? first - BRICK_MARGIN : 0;
    *count = end - *from;
}

/* Where the array begins in the file that it is read from. */
static uint64_t start_of(const struct sp_brick_writer *w) {
    return w->fine == w->job->samples ? w->array.at : 0;
}

static bool read_strip(struct sp_brick_writer *w, struct sp_error *err) {
    const uint32_t *dims = w->header.level[w->l].dims;
    struct sp_brick_strip *s = &w->strip;
    const size_t row = dims[0] * w->array.item, part = s->count[0] * row;
    for (uint32_t z = 0; z < s->count[1]; z++) {
        uint64_t at = start_of(w) + ((uint64_t)(s->from[1] + z) * dims[1] + s->from[0]) * row;
        if (!sp_read_sparse(w->fine, (char *)s->samples + z * part, part, at))
            return sp_fail(err, SP_ERR_IO, w->job->title, "cannot read the samples: %s",
                           strerror(errno));
    }
    return true;
}

/* True if all samples of the strip, with the margin, lie in holes of the file: they are 0. */
static bool is_empty(const struct sp_brick_writer *w) {
    const uint32_t *dims = w->header.level[w->l].dims;
    const struct sp_brick_strip *s = &w->strip;
    const size_t row = dims[0] * w->array.item;
    for (uint32_t z = 0; z < s->count[1]; z++)
        if (!sp_is_hole(w->fine, s->count[0] * row,
                        start_of(w) + ((uint64_t)(s->from[1] + z) * dims[1] + s->from[0]) * row))
            return false;
    return true;
}

/* The strip as an array of numbers. A row of vectors has three numbers per sample. */
static struct sp_brick_view strip_view(const struct sp_brick_writer *w) {
    const struct sp_brick_strip *s = &w->strip;
    const uint32_t numbers = w->header.level[w->l].dims[0] * w->array.components;
    return (struct sp_brick_view){
        .samples = s->samples,
        .type = w->array.type,
        .are_labels = w->header.info.meaning == SP_MEANING_LABELS,
        .width = numbers,
        .height = s->count[0],
        .first = { 0, s->first[0] - s->from[0], s->first[1] - s->from[1] },
        .size = { numbers, s->size[0], s->size[1] },
    };
}

static void pack(struct sp_brick_writer *w, struct sp_brick_packed *packed,
                 struct sp_brick_worker *worker, size_t size) {
    packed->size =
        ZSTD_compress2(worker->context, packed->bytes, w->packed_max, worker->copy, size);
    packed->failed = ZSTD_isError(packed->size);
}

/* Packs the vectors of brick b of a row. */
static void pack_vectors(struct sp_brick_writer *w, uint32_t b, struct sp_brick_worker *worker) {
    struct sp_brick_packed *packed = &w->packed[b];
    const uint32_t first = b * BRICK_SIDE, left = w->header.level[w->l].dims[0] - first;
    struct sp_brick_view own = strip_view(w);
    own.first[0] = first * 3;
    own.size[0] = (left < BRICK_SIDE ? left : BRICK_SIDE) * 3;
    const size_t count = (size_t)own.size[0] / 3 * own.size[1] * own.size[2];
    w->entries[w->first_brick + b] = (struct sp_brick_entry){ .bytes = 0 };
    *packed = (struct sp_brick_packed){ .bytes = packed->bytes };
    sp_brick_copy(&own, worker->copy);
    packed->longest = sp_brick_longest(worker->copy, count);
    if (!sp_is_zero(worker->copy, count * w->array.item))
        pack(w, packed, worker, count * w->array.item);
}

/* Finds the range of a brick of the strip and packs it. */
static void pack_samples(struct sp_brick_writer *w, uint32_t b, struct sp_brick_worker *worker) {
    const struct sp_brick_strip *s = &w->strip;
    const struct sp_brick_level *level = &w->header.level[w->l];
    struct sp_brick_entry *entry = &w->entries[w->first_brick + b];
    struct sp_brick_packed *packed = &w->packed[b];
    struct sp_brick_view own = strip_view(w), around = own;
    own.first[0] = b * BRICK_SIDE;
    own.size[0] =
        level->dims[0] - own.first[0] < BRICK_SIDE ? level->dims[0] - own.first[0] : BRICK_SIDE;
    widen(own.first[0], own.size[0], level->dims[0], &around.first[0], &around.size[0]);
    around.first[1] = around.first[2] = 0;
    around.size[1] = s->count[0];
    around.size[2] = s->count[1];
    const struct sp_brick_range all = sp_brick_measure_range(&around),
                                in = sp_brick_measure_range(&own);
    *entry = (struct sp_brick_entry){ .range = { all.least, all.most } };
    *packed = (struct sp_brick_packed){ .bytes = packed->bytes, .nonfinite = in.nonfinite };
    sp_brick_copy(&own, worker->copy);
    if (in.is_constant) {
        memcpy(&entry->at, worker->copy, w->array.item);
        return;
    }
    pack(w, packed, worker, (size_t)own.size[0] * own.size[1] * own.size[2] * w->array.item);
}

static void pack_bricks(void *user, size_t begin, size_t end, unsigned worker) {
    struct sp_brick_writer *w = user;
    for (size_t b = begin; b < end; b++)
        if (w->array.is_vectors)
            pack_vectors(w, (uint32_t)b, &w->workers[worker]);
        else
            pack_samples(w, (uint32_t)b, &w->workers[worker]);
}

static bool write_packed(struct sp_brick_writer *w, struct sp_error *err) {
    for (uint32_t b = 0; b < w->header.level[w->l].bricks[0]; b++) {
        struct sp_brick_entry *entry = &w->entries[w->first_brick + b];
        const struct sp_brick_packed *packed = &w->packed[b];
        if (packed->failed)
            return sp_bricks_write_fail_memory(w, err);
        if (w->l == 0) {
            w->header.info.nonfinite += packed->nonfinite;
            w->header.info.longest = fmax(w->header.info.longest, packed->longest);
        }
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
static size_t means_bytes(const struct sp_brick_writer *w) {
    return (size_t)w->header.level[w->l + 1].dims[0] * w->array.item * ((w->strip.size[0] + 1) / 2);
}

/* Averages the slices [begin, end) of the means. */
static void average(void *user, size_t begin, size_t end, unsigned worker) {
    struct sp_brick_writer *w = user;
    const uint32_t slices = w->strip.size[1] - 2 * (uint32_t)begin;
    struct sp_brick_view view = strip_view(w);
    (void)worker;
    view.first[2] += 2 * (uint32_t)begin;
    view.size[2] = slices < 2 * (end - begin) ? slices : 2 * (uint32_t)(end - begin);
    void *means = (char *)w->means + begin * means_bytes(w);
    if (w->array.is_vectors)
        sp_brick_average_vectors(&view, means);
    else
        sp_brick_average(&view, means);
}

/* Writes the means of the strip to the next level. */
static bool write_means(struct sp_brick_writer *w, struct sp_error *err) {
    const uint32_t *dims = w->header.level[w->l + 1].dims;
    const struct sp_brick_strip *s = &w->strip;
    const size_t row = dims[0] * w->array.item, part = means_bytes(w);
    sp_parallel_for(w->pool, (s->size[1] + 1) / 2, 1, average, w);
    for (uint32_t z = 0; 2 * z < s->size[1]; z++) {
        uint64_t at = ((uint64_t)(s->first[1] / 2 + z) * dims[1] + s->first[0] / 2) * row;
        if (!sp_write_sparse(w->coarse, (char *)w->means + z * part, part, at))
            return sp_fail(err, SP_ERR_IO, w->job->title, "cannot write: %s", strerror(errno));
    }
    return true;
}

static void place_strip(struct sp_brick_writer *w, uint32_t row, uint32_t slab) {
    const struct sp_brick_level *level = &w->header.level[w->l];
    struct sp_brick_strip *s = &w->strip;
    w->first_brick = ((uint64_t)slab * level->bricks[1] + row) * level->bricks[0];
    s->first[0] = row * BRICK_SIDE;
    s->first[1] = slab * BRICK_SIDE;
    for (int i = 0; i < 2; i++) {
        const uint32_t left = level->dims[i + 1] - s->first[i];
        s->size[i] = left < BRICK_SIDE ? left : BRICK_SIDE;
        widen(s->first[i], s->size[i], level->dims[i + 1], &s->from[i], &s->count[i]);
    }
}

static bool write_strip(struct sp_brick_writer *w, struct sp_error *err) {
    if (!read_strip(w, err))
        return false;
    sp_parallel_for(w->pool, w->header.level[w->l].bricks[0], 1, pack_bricks, w);
    return write_packed(w, err) && (w->coarse < 0 || write_means(w, err));
}

/* Entries of strips in holes stay as they are: 0, which is their sample and their range. */
static bool write_strips(struct sp_brick_writer *w, struct sp_error *err) {
    const struct sp_brick_level *level = &w->header.level[w->l];
    for (uint32_t slab = 0; slab < level->bricks[2]; slab++)
        for (uint32_t row = 0; row < level->bricks[1]; row++) {
            place_strip(w, row, slab);
            const double done = ((double)slab * level->bricks[1] + row) /
                                ((double)level->bricks[1] * level->bricks[2]);
            const double level_0 = level_share * done, others = level_share + histogram_share;
            if (!sp_bricks_write_report(w, w->l ? others : level_0, err) ||
                (!is_empty(w) && !write_strip(w, err)))
                return false;
        }
    return true;
}

static bool write_index(struct sp_brick_writer *w, struct sp_error *err) {
    struct sp_brick_level *level = &w->header.level[w->l];
    struct sp_brick_index *index = w->array.is_vectors ? &level->vectors : &level->samples;
    const uint64_t count = sp_brick_count(level);
    const size_t size = count * BRICK_ENTRY_BYTES;
    unsigned char *bytes = malloc(size);
    if (!bytes)
        return sp_bricks_write_fail_memory(w, err);
    for (uint64_t i = 0; i < count; i++)
        sp_brick_entry_encode(&w->entries[i], bytes + i * BRICK_ENTRY_BYTES);
    *index = (struct sp_brick_index){ w->at, sp_brick_checksum(bytes, size) };
    bool ok = write_at(w, w->job->out, bytes, size, w->at, err);
    w->at += size;
    free(bytes);
    return ok;
}

/* Memory for the strips of level 0, the largest ones, of samples and vectors. */
static bool allocate(struct sp_brick_writer *w, struct sp_error *err) {
    const uint32_t *dims = w->header.info.grid.dims;
    const size_t item = sp_brick_item_max(&w->header.info);
    const size_t side = BRICK_SIDE + 2 * BRICK_MARGIN, brick = BRICK_SIDE * BRICK_SIDE * BRICK_SIDE;
    const uint32_t bricks = w->header.level[0].bricks[0];
    w->packed_max = ZSTD_compressBound(brick * item);
    w->strip.samples = malloc(dims[0] * side * side * item);
    w->means = malloc(((size_t)dims[0] + 1) / 2 * BRICK_SIDE * BRICK_SIDE / 4 * item);
    w->packed = calloc(bricks, sizeof *w->packed);
    bool ok = w->strip.samples && w->means && w->packed;
    for (uint32_t b = 0; ok && b < bricks; b++)
        ok = (w->packed[b].bytes = malloc(w->packed_max)) != NULL;
    for (unsigned t = 0; ok && t < sp_pool_threads(w->pool); t++) {
        struct sp_brick_worker *worker = &w->workers[t];
        ok = (worker->copy = malloc(brick * item)) && (worker->context = ZSTD_createCCtx());
        if (!ok)
            break;
        ZSTD_CCtx_setParameter(worker->context, ZSTD_c_compressionLevel, ZSTD_LEVEL);
        ZSTD_CCtx_setParameter(worker->context, ZSTD_c_checksumFlag, 1);
    }
    return ok || sp_bricks_write_fail_memory(w, err);
}

static void release(struct sp_brick_writer *w) {
    for (uint32_t b = 0; w->packed && b < w->header.level[0].bricks[0]; b++)
        free(w->packed[b].bytes);
    for (int t = 0; t < WRITE_THREADS_MAX; t++) {
        ZSTD_freeCCtx(w->workers[t].context);
        free(w->workers[t].copy);
    }
    free(w->packed);
    free(w->strip.samples);
    free(w->means);
    free(w->entries);
    free(w->places);
    if (w->fine >= 0 && w->fine != w->job->samples)
        close(w->fine);
    if (w->coarse >= 0)
        close(w->coarse);
    sp_pool_destroy(&w->pool);
}

static void combine_ranges(struct sp_brick_writer *w) {
    double range[2] = { INFINITY, -INFINITY };
    for (uint64_t i = 0; i < sp_brick_count(&w->header.level[0]); i++) {
        range[0] = fmin(range[0], w->entries[i].range[0]);
        range[1] = fmax(range[1], w->entries[i].range[1]);
    }
    for (int i = 0; i < 2; i++)
        w->header.info.range[i] = range[0] <= range[1] ? range[i] : 0;
}

/* Gives the samples of the next level their size. */
static bool set_size(const struct sp_brick_writer *w, struct sp_error *err) {
    const uint32_t *dims = w->header.level[w->l + 1].dims;
    const uint64_t bytes = (uint64_t)dims[0] * dims[1] * dims[2] * w->array.item;
    return ftruncate(w->coarse, (off_t)bytes) == 0 ||
           sp_fail(err, SP_ERR_IO, w->job->title, "cannot write: %s", strerror(errno));
}

static bool write_level(struct sp_brick_writer *w, struct sp_error *err) {
    const bool is_last = w->l + 1 == w->header.levels;
    free(w->entries);
    w->entries = calloc(sp_brick_count(&w->header.level[w->l]), sizeof *w->entries);
    if (!w->entries)
        return sp_bricks_write_fail_memory(w, err);
    w->coarse = is_last ? -1 : sp_temporary_file(w->job->folder, err);
    if (!is_last && (w->coarse < 0 || !set_size(w, err)))
        return false;
    if (!write_strips(w, err) || !write_index(w, err))
        return false;
    if (w->l == 0 && !w->array.is_vectors)
        combine_ranges(w);
    return true;
}

/* Measures what the header says of the values, from the samples of the level that was written. */
static bool measure_values(struct sp_brick_writer *w, bool *is_projected, struct sp_error *err) {
    return w->array.is_vectors ||
           ((w->l > 0 ||
             sp_bricks_count_values(w, level_share, level_share + histogram_share, err)) &&
            sp_bricks_measure_projected(w, is_projected, err));
}

static bool write_array(struct sp_brick_writer *w, struct sp_error *err) {
    bool is_projected = false;
    w->fine = w->job->samples;
    for (w->l = 0; w->l < w->header.levels; w->l++) {
        if (!write_level(w, err) || !measure_values(w, &is_projected, err))
            return false;
        if (w->fine != w->job->samples)
            close(w->fine);
        w->fine = w->coarse;
        w->coarse = -1;
    }
    return true;
}

/* Writes the levels of the samples, then the levels of the vectors. */
static bool write_arrays(struct sp_brick_writer *w, struct sp_error *err) {
    const struct sp_volume_info *info = &w->header.info;
    const size_t sample = sp_type_size(info->type);
    const uint64_t voxels = info->voxel_bytes / sample;
    const double all = (double)info->voxel_bytes + (double)info->vector_bytes;
    struct sp_brick_array vectors = { .is_vectors = true,
                                      .type = SP_FLOAT32,
                                      .components = 3,
                                      .item = BRICK_VECTOR_BYTES,
                                      .share = (double)info->vector_bytes / all };
    vectors.from = 1 - vectors.share;
    sp_volume_layout(info->voxel_bytes, voxels, true, &vectors.at);
    w->array = (struct sp_brick_array){
        .type = info->type, .components = 1, .item = sample, .share = 1 - vectors.share
    };
    if (!write_array(w, err))
        return false;
    w->array = vectors;
    return !info->vector_bytes || write_array(w, err);
}

/* Writes the places of the samples on rectilinear axes. */
static bool write_axes(struct sp_brick_writer *w, struct sp_error *err) {
    const size_t count = sp_brick_places_first(&w->header);
    if (!w->header.rectilinear)
        return true;
    uint64_t *stored = calloc(count, sizeof *stored);
    if (!stored)
        return sp_bricks_write_fail_memory(w, err);
    for (size_t i = 0; i < count; i++) {
        memcpy(&stored[i], &w->places[i], sizeof *stored);
        stored[i] = htole64(stored[i]);
    }
    w->header.axes_at = w->at;
    w->header.axes_checksum = sp_brick_checksum(stored, count * sizeof *stored);
    bool ok = write_at(w, w->job->out, stored, count * sizeof *stored, w->at, err);
    w->at += count * sizeof *stored;
    free(stored);
    return ok;
}

static bool write_notes(struct sp_brick_writer *w, struct sp_error *err) {
    const size_t size = sp_brick_notes_bytes(w->job->info);
    unsigned char *bytes = calloc(1, size);
    if (!bytes)
        return sp_bricks_write_fail_memory(w, err);
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
static bool write_header(struct sp_brick_writer *w, struct sp_error *err) {
    unsigned char bytes[BRICK_HEADER_BYTES];
    sp_brick_header_encode(&w->header, bytes);
    if (!write_at(w, w->job->out, bytes, sizeof bytes, 0, err))
        return false;
    return fsync(w->job->out) == 0 ||
           sp_fail(err, SP_ERR_IO, w->job->title, "cannot write: %s", strerror(errno));
}

/* What the file has of the description. */
static void describe(const struct sp_volume_info *from, struct sp_volume_info *to) {
    to->grid = from->grid;
    to->type = from->type;
    to->meaning = from->meaning;
    const uint64_t voxels = (uint64_t)from->grid.dims[0] * from->grid.dims[1] * from->grid.dims[2];
    to->voxel_bytes = voxels * sp_type_size(from->type);
    to->vector_bytes = from->vector_bytes ? voxels * BRICK_VECTOR_BYTES : 0;
    memcpy(to->unit, from->unit, sizeof to->unit);
    to->vertical = from->vertical;
    memcpy(to->anatomy, from->anatomy, sizeof to->anatomy);
    memcpy(to->value_name, from->value_name, sizeof to->value_name);
    memcpy(to->vector_name, from->vector_name, sizeof to->vector_name);
    memcpy(to->value_unit, from->value_unit, sizeof to->value_unit);
}

/* Fills the header but for what writing finds. */
static bool init_header(struct sp_brick_writer *w, struct sp_error *err) {
    const struct sp_grid *grid = &w->job->info->grid;
    describe(w->job->info, &w->header.info);
    for (int a = 0; a < 3; a++)
        w->header.rectilinear |= (uint32_t)(grid->coordinates[a] != NULL) << a;
    sp_brick_header_init(&w->header);
    w->places = malloc((sp_brick_places_count(&w->header) + 1) * sizeof *w->places);
    if (!w->places)
        return sp_bricks_write_fail_memory(w, err);
    sp_grid_copy_axes(&w->header.info.grid, w->places);
    sp_brick_places_fill(&w->header, w->places);
    return true;
}

bool sp_bricks_write(const struct sp_bricks_write_job *job, struct sp_error *err) {
    struct sp_brick_writer *w = calloc(1, sizeof *w);
    if (!w)
        return sp_fail(err, SP_ERR_MEMORY, job->title, "out of memory for a brick file");
    w->job = job;
    w->fine = w->coarse = -1;
    w->at = BRICK_HEADER_BYTES;
    bool ok = init_header(w, err) && (w->pool = sp_pool_create(sp_volume_threads(), err)) &&
              allocate(w, err) && write_arrays(w, err) && write_axes(w, err) &&
              write_notes(w, err) && write_header(w, err) && sp_bricks_write_report(w, 1, err);
    release(w);
    free(w);
    return ok;
}
