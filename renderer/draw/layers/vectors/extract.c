/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/vectors/extract.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classify/gradient.h"
#include "classify/transfer.h"
#include "data/volume/sample.h"
#include "draw/layers/splat_list/clip.h"
#include "draw/layers/splat_list/phase.h"

struct work {
    const struct sp_vectors_job *job;
    struct sp_voxel_list *list;
    struct sp_transfer transfer;
    struct sp_gradient_grid gradient;     /* of the samples, for the gradient axis */
    struct sp_gradient_grid packing;      /* of the vectors */
    const struct sp_voxel_interval *clip; /* by row; NULL = nothing is clipped */
    const void *voxels;
    const float (*vectors)[3];
    enum sp_type type;
    struct sp_whole_part part; /* of all samples, which the volume has */
};

static struct sp_class class_at(const struct work *work, uint64_t at, const uint32_t i[3]) {
    const struct sp_transfer *transfer = &work->transfer;
    struct sp_class c = sp_transfer_value_class(transfer, sp_sample(work->voxels, work->type, at));
    if (transfer->scale && c.depth > 0) {
        double gradient[3];
        sp_gradient_at(&work->gradient, i, gradient);
        c = sp_transfer_scale_class(transfer, c, sp_gradient_pack(&work->gradient, gradient));
    }
    return c;
}

static void set_color(const struct work *work, uint64_t at, struct sp_class *c) {
    struct sp_class other;
    sp_transfer_function_eval(&work->transfer.tf, sp_coloring_value(&work->job->coloring, at),
                              &other);
    memcpy(c->color, other.color, sizeof c->color);
}

static uint32_t pack_vector(const struct work *work, uint64_t at) {
    double vector[3];
    for (int c = 0; c < 3; c++)
        vector[c] = (double)work->vectors[at][c];
    return sp_gradient_pack(&work->packing, vector);
}

/* The same for every part of the volume that has the sample. */
static uint32_t hash_of(const struct work *work, uint32_t x, uint32_t y, uint32_t z) {
    const struct sp_whole_part *part = &work->part;
    const uint64_t row =
        ((uint64_t)part->first[2] + z) * part->dims[1] + ((uint64_t)part->first[1] + y);
    return sp_streak_hash(row * part->dims[0] + part->first[0] + x);
}

/* Visits row (y, z); counts its voxels, or writes them if `to` is not NULL. */
static uint32_t visit_row(const struct work *work, uint32_t y, uint32_t z, struct sp_voxel *to) {
    const uint32_t *dims = work->list->dims;
    uint64_t row = (uint64_t)z * dims[1] + y;
    struct sp_voxel_interval all = { 0, dims[0] }, left = work->clip ? work->clip[row] : all;
    uint32_t count = 0;
    for (uint32_t x = left.begin; x < left.end; x++) {
        const uint64_t at = row * dims[0] + x;
        const uint32_t i[3] = { x, y, z }, hash = hash_of(work, x, y, z);
        if (!sp_streak_is_drawn(hash, work->job->density))
            continue;
        struct sp_class c = class_at(work, at, i);
        if (!(c.depth > 0))
            continue;
        if (to) {
            if (work->job->coloring.volume)
                set_color(work, at, &c);
            struct sp_voxel *v = &to[count];
            *v = (struct sp_voxel){ .at = { (uint16_t)x, (uint16_t)y, (uint16_t)z },
                                    .normal = pack_vector(work, at),
                                    .phase = (uint16_t)hash,
                                    .depth = c.depth };
            for (int k = 0; k < 3; k++)
                v->color[k] = (uint16_t)(c.color[k] * 65535 + 0.5f);
        }
        count++;
    }
    return count;
}

static void count_rows(void *user, size_t begin, size_t end, unsigned worker) {
    const struct work *work = user;
    const uint32_t rows = work->list->dims[1];
    (void)worker;
    for (size_t row = begin; row < end && !sp_interrupt_is_cancelled(&work->job->interrupt); row++)
        work->list->first[row + 1] =
            visit_row(work, (uint32_t)(row % rows), (uint32_t)(row / rows), NULL);
}

static void write_rows(void *user, size_t begin, size_t end, unsigned worker) {
    const struct work *work = user;
    const uint32_t rows = work->list->dims[1];
    (void)worker;
    for (size_t row = begin; row < end && !sp_interrupt_is_cancelled(&work->job->interrupt); row++)
        visit_row(work, (uint32_t)(row % rows), (uint32_t)(row / rows),
                  work->list->voxels + work->list->first[row]);
}

static bool fail_cancelled(struct sp_error *err) {
    return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
}

static bool extract(struct work *work, struct sp_error *err) {
    const struct sp_vectors_job *job = work->job;
    struct sp_voxel_list *list = work->list;
    if (!sp_voxel_list_start(list, err))
        return false;
    sp_parallel_for(job->pool, sp_voxel_list_rows(list), 16, count_rows, work);
    if (sp_interrupt_is_cancelled(&job->interrupt))
        return fail_cancelled(err);
    if (!sp_voxel_list_sum(list, job->bytes_max, "lower the density, or make fewer values visible",
                           err))
        return false;
    sp_parallel_for(job->pool, sp_voxel_list_rows(list), 16, write_rows, work);
    return !sp_interrupt_is_cancelled(&job->interrupt) || fail_cancelled(err);
}

bool sp_vectors_extract(const struct sp_vectors_job *job, struct sp_voxel_list *list,
                        struct sp_error *err) {
    const struct sp_volume_info *info = sp_volume_info(job->volume);
    const uint32_t *dims = info->grid.dims;
    struct work work = { .job = job,
                         .list = list,
                         .packing = { .bound = info->longest > 0 ? info->longest : 1 },
                         .voxels = sp_volume_voxels(job->volume),
                         .vectors = sp_volume_vectors(job->volume),
                         .type = info->type,
                         .part = info->whole.part };
    if (!info->whole.part.dims[0])
        memcpy(work.part.dims, dims, sizeof work.part.dims);
    struct sp_voxel_interval *rows = NULL;
    *list = (struct sp_voxel_list){ .dims = { dims[0], dims[1], dims[2] } };
    if (sp_voxel_clips(job->clip)) {
        work.clip = rows = malloc((size_t)sp_voxel_list_rows(list) * sizeof *rows);
        if (!rows)
            return sp_fail(err, SP_ERR_MEMORY, "/clip", "out of memory for the clipped vectors");
        sp_voxel_clip_rows(job->clip, &info->grid, rows);
    }
    sp_gradient_grid_init(&work.gradient, job->volume);
    bool ok = sp_transfer_init(&work.transfer, job->tf, info, NULL, err);
    if (ok) {
        ok = extract(&work, err);
        sp_transfer_finish(&work.transfer);
    }
    free(rows);
    if (!ok)
        sp_voxel_list_finish(list);
    return ok;
}
