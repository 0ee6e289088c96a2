/* SPDX-License-Identifier: Apache-2.0 */
#include "bench/limit_kernels.h"

#include "base/wide.h"
#include "splat/exp2.h"

/* Processes one column of vectors after another; `width` is constant where this is inlined. */
static inline __attribute__((always_inline)) void
add_footprint(struct limit_tile *tile, const struct limit_footprint *f, int width) {
    for (int first = 0; first < width; first += SP_WIDE) {
        sp_wide l = sp_wide_count() + (float)first;
        sp_wide row = sp_wide_exp2(l * (l * f->k2 + f->k1) + f->k0);
        sp_wide ratio = sp_wide_exp2(l * f->m1 + f->m0);
        row = sp_wide_keep(sp_wide_first(width - first), row);
        int at = f->offset + first;
        for (int y = 0; y < width; y++, at += LIMIT_ROW) {
            for (int p = 0; p < LIMIT_PLANES; p++) {
                float *to = &tile->plane[p][at];
                sp_wide_store(to, sp_wide_fma(row, sp_wide_all(f->weight[p]), sp_wide_load(to)));
            }
            row *= ratio;
            ratio *= f->fall;
        }
    }
}

static void add_footprints(struct limit_tile *tile, const struct limit_footprint *footprints,
                           int width) {
    const struct limit_footprint *end = footprints + LIMIT_FOOTPRINTS;
    switch (width) {
    case 3:
        for (const struct limit_footprint *f = footprints; f < end; f++)
            add_footprint(tile, f, 3);
        break;
    case 5:
        for (const struct limit_footprint *f = footprints; f < end; f++)
            add_footprint(tile, f, 5);
        break;
    case 7:
        for (const struct limit_footprint *f = footprints; f < end; f++)
            add_footprint(tile, f, 7);
        break;
    default:
        for (const struct limit_footprint *f = footprints; f < end; f++)
            add_footprint(tile, f, 11);
    }
}

/* Zwicker et al., eq. 21 and 22, without the third row: V̂ = J V Jᵀ + h², and its inverse. */
static void set_up(struct limit_voxels *v, const struct limit_camera *c) {
    const float *s = c->variance;
    for (int i = 0; i < LIMIT_VOXELS; i += SP_WIDE) {
        sp_wide over = 1.0f / sp_wide_load(&v->at[2][i]);
        sp_wide x = sp_wide_load(&v->at[0][i]) * over, y = sp_wide_load(&v->at[1][i]) * over;
        sp_wide scale = over * c->focal, square = scale * scale;
        sp_wide v00 = square * (s[0] - 2.0f * x * s[2] + x * x * s[5]) + c->lowpass;
        sp_wide v01 = square * (s[1] - y * s[2] - x * s[4] + x * y * s[5]);
        sp_wide v11 = square * (s[3] - 2.0f * y * s[4] + y * y * s[5]) + c->lowpass;
        sp_wide inverse = 1.0f / (v00 * v11 - v01 * v01);
        sp_wide_store(&v->centre[0][i], x * c->focal + c->centre[0]);
        sp_wide_store(&v->centre[1][i], y * c->focal + c->centre[1]);
        sp_wide_store(&v->conic[0][i], v11 * inverse);
        sp_wide_store(&v->conic[1][i], -v01 * inverse);
        sp_wide_store(&v->conic[2][i], v00 * inverse);
        sp_wide_store(&v->box[0][i], sp_wide_sqrt(v00) * c->radius);
        sp_wide_store(&v->box[1][i], sp_wide_sqrt(v11) * c->radius);
    }
}

const struct limit_table bench_limit_table = { SP_ISA_TEXT, add_footprints, set_up };
