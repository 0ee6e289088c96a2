/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/batch.h"

#include <math.h>
#include <string.h>

#include "base/wide.h"
#include "data/volume/grid.h"

void sp_surface_batch_frame_init(struct sp_surface_batch_frame *frame,
                                 const struct sp_surface_points *points,
                                 const struct sp_grid *grid) {
    double det;
    struct sp_mat3 direction = sp_grid_directions(grid);
    direction = sp_mat3_inverse(&direction, &det);
    frame->points = points;
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            frame->to_world[r][a] = (float)direction.m[a][r];
    frame->unit = (float)cbrt(fabs(det) * grid->spacing[0] * grid->spacing[1] * grid->spacing[2]);
    for (int a = 0; a < 3; a++) {
        frame->share[a] = 1.0f / points->split[a];
        frame->face[a] = 1.0f / (float)(points->split[(a + 1) % 3] * points->split[(a + 2) % 3]);
    }
}

void sp_surface_batch_begin(struct sp_surface_batch *batch, struct sp_surface_block *block) {
    batch->block = block;
    batch->to = block->first;
    for (int a = 0; a < 3; a++) {
        block->low[a] = UINT16_MAX;
        block->high[a] = 0;
    }
}

/* The gradient at places in cells, and how it changes, along the axes [relative to the largest]. */
struct derivatives {
    sp_wide slope[3], bend[3][3];
    sp_wide_mask are_known; /* not 0 */
};

static inline sp_wide mix(sp_wide a, sp_wide b, sp_wide t) {
    return a + t * (b - a);
}

/* Interpolates the slopes along axis b at the corners of the cells. */
static inline void compute_slope(const float *slopes, sp_wide_int sample, const sp_wide at[3],
                                 sp_wide *slope, sp_wide change[3]) {
    enum { Y = SURFACE_SLOPES_ROW, Z = SURFACE_SLOPES_ROW * SURFACE_SLOPES };
    sp_wide s[4], d[4];
    for (int i = 0; i < 4; i++) {
        const float *row = slopes + (i & 1) * Y + (i >> 1) * Z;
        s[i] = sp_wide_gather(row, sample);
        d[i] = sp_wide_gather(row + 1, sample) - s[i];
        s[i] += at[0] * d[i];
    }
    sp_wide low = mix(s[0], s[1], at[1]), high = mix(s[2], s[3], at[1]);
    *slope = mix(low, high, at[2]);
    change[0] = mix(mix(d[0], d[1], at[1]), mix(d[2], d[3], at[1]), at[2]);
    change[1] = mix(s[1] - s[0], s[3] - s[2], at[2]);
    change[2] = high - low;
}

static inline void compute_derivatives(const struct sp_surface_batch *batch, int first,
                                       const sp_wide at[3], const sp_wide gap[3],
                                       struct derivatives *out) {
    const sp_wide zero = sp_wide_all(0), infinity = sp_wide_all(INFINITY);
    sp_wide_int cell[3];
    for (int a = 0; a < 3; a++)
        cell[a] = sp_wide_int_load(batch->cell[a] + first);
    sp_wide_int sample = (cell[2] * SURFACE_SLOPES + cell[1]) * SURFACE_SLOPES_ROW + cell[0];
    sp_wide change[3][3], largest = zero;
    for (int b = 0; b < 3; b++) {
        compute_slope(batch->slopes.along[b], sample, at, &out->slope[b], change[b]);
        largest = sp_wide_max(sp_wide_abs(out->slope[b]), largest);
    }
    out->are_known = sp_wide_lt(zero, largest) & sp_wide_lt(largest, infinity);
    for (int b = 0; b < 3; b++) {
        out->slope[b] /= largest;
        for (int a = 0; a < 3; a++)
            out->bend[a][b] = change[b][a] / (gap[a] * largest);
    }
}

/* Unit gradient in world space. Returns the length of the gradient. */
static inline sp_wide compute_normal(const struct sp_surface_batch_frame *f,
                                     const struct derivatives *d, sp_wide normal[3]) {
    sp_wide square = sp_wide_all(0);
    for (int r = 0; r < 3; r++) {
        const float *w = f->to_world[r];
        normal[r] = w[0] * d->slope[0] + w[1] * d->slope[1] + w[2] * d->slope[2];
        square += normal[r] * normal[r];
    }
    sp_wide length = sp_wide_sqrt(square);
    for (int r = 0; r < 3; r++)
        normal[r] /= length;
    return length;
}

/* The mean distance of a disc from the surface, for a kernel of one voxel: ½·Σ kᵀ H k/|∇f| over the
 * columns k of the flat kernel, which are those of D·(I − q·qᵀ/q²) with D the cell's size and q the
 * gradient in cells. Along the normal [cells]. */
static inline sp_wide compute_bend(const struct sp_surface_batch_frame *f,
                                   const struct derivatives *d, const sp_wide gap[3],
                                   sp_wide length) {
    const sp_wide most = sp_wide_all(0.5f); /* noise and edges bend more than a parabola does */
    sp_wide size[3], q[3], square = sp_wide_all(0), sum = sp_wide_all(0);
    for (int a = 0; a < 3; a++) {
        size[a] = gap[a] * f->share[a];
        q[a] = size[a] * d->slope[a];
        square += q[a] * q[a];
    }
    for (int b = 0; b < 3; b++)
        for (int c = 0; c < 3; c++) {
            sp_wide flat = (b == c ? 1.0f : 0.0f) - q[b] * q[c] / square;
            sum += size[b] * size[c] * flat * d->bend[b][c];
        }
    sp_wide bend = -0.5f * sum / (length * f->unit);
    return sp_wide_max(sp_wide_min(bend, most), -most);
}

/* Rounded, and within ±32767. */
static inline void store_steps(int16_t *to, sp_wide x, float steps) {
    const sp_wide most = sp_wide_all(32767);
    x = sp_wide_max(sp_wide_min(x * steps, most), -most);
    sp_wide_int_store_short((uint16_t *)to,
                            sp_wide_to_int(x + sp_wide_copysign(sp_wide_all(0.5f), x)));
}

/* Points as they are stored. */
struct stored {
    uint16_t at[3][SURFACE_BATCH];
    int16_t area[3][SURFACE_BATCH], normal[3][SURFACE_BATCH], bend[SURFACE_BATCH];
};

static void make_points(const struct sp_surface_batch *batch, int first, struct stored *out) {
    const struct sp_surface_batch_frame *f = batch->frame;
    const struct sp_surface_patches *p = &batch->patches;
    const sp_wide highest = sp_wide_all(UINT16_MAX);
    struct derivatives d;
    sp_wide at[3], gap[3], normal[3], size = sp_wide_load(batch->size + first);
    for (int a = 0; a < 3; a++) {
        sp_wide_int cell = sp_wide_int_load(batch->cell[a] + first);
        sp_wide start = sp_wide_load(batch->start[a] + first);
        at[a] = (start + sp_wide_load(p->at[a] + first) * size) * f->share[a];
        gap[a] = sp_wide_gather(batch->gap[a] + 1, cell);
        sp_wide place = (sp_wide_from_int(cell) + at[a]) * SURFACE_PLACE_STEPS + 0.5f;
        sp_wide_int_store_short(out->at[a] + first, sp_wide_to_int(sp_wide_min(place, highest)));
        store_steps(out->area[a] + first,
                    sp_wide_load(p->area[a] + first) * (size * size * f->face[a]),
                    SURFACE_AREA_STEPS);
    }
    compute_derivatives(batch, first, at, gap, &d);
    sp_wide length = compute_normal(f, &d, normal);
    for (int a = 0; a < 3; a++)
        store_steps(out->normal[a] + first, sp_wide_keep(d.are_known, normal[a]),
                    SURFACE_NORMAL_STEPS);
    store_steps(out->bend + first, sp_wide_keep(d.are_known, compute_bend(f, &d, gap, length)),
                SURFACE_BEND_STEPS);
}

static void flush(struct sp_surface_batch *batch) {
    const struct sp_surface_points *points = batch->frame->points;
    const size_t count = (size_t)batch->patches.count, bytes = count * sizeof(uint16_t);
    struct sp_surface_block *block = batch->block;
    struct stored stored;
    sp_surface_patches_compute(&batch->patches);
    for (size_t i = 0; i < count; i += SP_WIDE)
        make_points(batch, (int)i, &stored);
    for (int a = 0; a < 3; a++) {
        memcpy(points->at[a] + batch->to, stored.at[a], bytes);
        memcpy(points->area[a] + batch->to, stored.area[a], bytes);
        memcpy(points->normal[a] + batch->to, stored.normal[a], bytes);
        for (size_t i = 0; i < count; i++) {
            uint16_t place = stored.at[a][i];
            block->low[a] = place < block->low[a] ? place : block->low[a];
            block->high[a] = place > block->high[a] ? place : block->high[a];
        }
    }
    memcpy(points->bend + batch->to, stored.bend, bytes);
    batch->to += count;
    batch->patches.count = 0;
}

void sp_surface_batch_add(struct sp_surface_batch *batch, const float f[8],
                          const struct sp_surface_parts *parts, const int cell[3],
                          const float start[3], float size) {
    struct sp_surface_patches *p = &batch->patches;
    if (p->count + parts->count > SURFACE_BATCH)
        flush(batch);
    for (int k = 0; k < parts->count; k++) {
        const int to = p->count++;
        for (int c = 0; c < 8; c++)
            p->f[c][to] = f[c];
        p->corners[to] = parts->corners[k];
        p->sign[to] = parts->are_outside ? -1 : 1;
        for (int a = 0; a < 3; a++) {
            batch->cell[a][to] = cell[a];
            batch->start[a][to] = start[a];
        }
        batch->size[to] = size;
    }
}

void sp_surface_batch_end(struct sp_surface_batch *batch) {
    flush(batch);
}
