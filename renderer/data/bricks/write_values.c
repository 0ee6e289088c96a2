/* SPDX-License-Identifier: Apache-2.0 */
#include <stdlib.h>
#include <string.h>

#include "base/transfer.h"
#include "data/bricks/write_private.h"
#include "data/volume/volume.h"

/* What projections show is found from at most so many samples. */
enum { PROJECTED_MAX = 256 * 256 * 256 };

/* Counts the values of a chunk of samples, without reading holes. */
static bool count_data(const struct sp_brick_writer *w, struct sp_brick_worker *own, uint64_t at,
                       uint64_t end) {
    uint64_t from, to;
    for (; at < end; at = to) {
        sp_skip_holes(w->job->samples, at, end, &from, &to);
        from -= from % w->array.item; /* whole samples, wherever the holes begin and end */
        to = to < end ? to + (w->array.item - to % w->array.item) % w->array.item : end;
        own->zeros += (from - at) / w->array.item;
        if (from == end)
            break;
        if (!sp_read_at(w->job->samples, own->copy, (size_t)(to - from), from))
            return false;
        sp_brick_count_values(own->copy, w->header.info.type, (size_t)(to - from) / w->array.item,
                              w->header.info.range, own->histogram);
    }
    return true;
}

static void count_chunk(void *user, size_t begin, size_t end, unsigned worker) {
    struct sp_brick_writer *w = user;
    struct sp_brick_worker *own = &w->workers[worker];
    const uint64_t bytes = w->header.info.voxel_bytes;
    const size_t chunk = BRICK_SIDE * BRICK_SIDE * BRICK_SIDE; /* samples: of the worker's copy */
    for (size_t i = w->first_chunk + begin; i < w->first_chunk + end; i++) {
        const uint64_t at = (uint64_t)i * chunk * w->array.item;
        const uint64_t size =
            bytes - at < chunk * w->array.item ? bytes - at : chunk * w->array.item;
        own->failed = own->failed || !count_data(w, own, at, at + size);
    }
}

bool sp_bricks_count_values(struct sp_brick_writer *w, double from, double to,
                            struct sp_error *err) {
    enum { STEP = 128 }; /* chunks between two reports */
    const size_t chunk = (size_t)BRICK_SIDE * BRICK_SIDE * BRICK_SIDE * w->array.item;
    const size_t chunks = (size_t)((w->header.info.voxel_bytes + chunk - 1) / chunk);
    for (w->first_chunk = 0; w->first_chunk < chunks; w->first_chunk += STEP) {
        const size_t left = chunks - w->first_chunk;
        const double done = (double)w->first_chunk / (double)chunks;
        if (!sp_bricks_write_report(w, from + (to - from) * done, err))
            return false;
        sp_parallel_for(w->pool, left < STEP ? left : STEP, 1, count_chunk, w);
    }
    for (unsigned t = 0; t < sp_pool_threads(w->pool); t++) {
        if (w->workers[t].failed)
            return sp_fail(err, SP_ERR_IO, w->job->title, "cannot read the samples again");
        uint64_t zero[SP_HISTOGRAM_BINS] = { 0 };
        const double sample = 0; /* as many bytes of 0 as any type has */
        sp_brick_count_values(&sample, w->header.info.type, 1, w->header.info.range, zero);
        for (int b = 0; b < SP_HISTOGRAM_BINS; b++)
            w->header.info.histogram[b] +=
                w->workers[t].histogram[b] + w->workers[t].zeros * zero[b];
    }
    return sp_bricks_write_report(w, to, err);
}

/* Samples count, not sides: a coarser level of a flat volume would mix its few slices. */
static bool is_small(const struct sp_brick_level *level) {
    return (uint64_t)level->dims[0] * level->dims[1] * level->dims[2] <= PROJECTED_MAX;
}

/* The grid of the level that is written. Coordinates may begin anywhere: only distances between
 * them count. */
static struct sp_grid grid_of(const struct sp_brick_writer *w) {
    const struct sp_brick_level *level = &w->header.level[w->l];
    struct sp_grid grid = w->header.info.grid;
    for (int a = 0; a < 3; a++) {
        grid.dims[a] = level->dims[a];
        grid.spacing[a] *= level->step[a];
        grid.coordinates[a] = level->places[a];
    }
    return grid;
}

bool sp_bricks_measure_projected(struct sp_brick_writer *w, bool *is_found, struct sp_error *err) {
    const struct sp_brick_level *level = &w->header.level[w->l];
    struct sp_volume_info coarse = w->header.info;
    size_t bytes = w->array.item;
    if (*is_found || (w->l + 1 < w->header.levels && !is_small(level)))
        return true;
    coarse.grid = grid_of(w);
    for (int a = 0; a < 3; a++)
        bytes *= level->dims[a];
    void *samples = malloc(bytes);
    bool ok = samples != NULL;
    if (!ok)
        sp_bricks_write_fail_memory(w, err);
    else if (!sp_read_at(w->fine, samples, bytes, 0))
        ok = sp_fail(err, SP_ERR_IO, w->job->title, "cannot read the samples again");
    ok = ok && sp_volume_project(&coarse, samples, err);
    w->header.info.projected = coarse.projected;
    *is_found = true;
    free(samples);
    return ok;
}
