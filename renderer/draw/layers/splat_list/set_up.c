/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/splat_list/closed.h"
#include "draw/layers/splat_list/kernels.h"
#include "draw/layers/splat_list/record.h"
#include "draw/layers/splat_list/streak.h"
#include "splat/outline.h"

enum { AHEAD = 64 }; /* voxels that are read in advance: they lie apart in memory */

/* Some voxels side by side. */
struct lanes {
    int32_t at[3][SP_WIDE];
    int32_t normal[SP_WIDE], is_opaque[SP_WIDE];
    uint16_t phase[SP_WIDE];
    float color[3][SP_WIDE], depth[SP_WIDE];
};

static inline void read_voxels(const struct sp_voxel_list *list, const uint32_t *voxels, int count,
                               struct lanes *to) {
    for (int i = 0; i < SP_WIDE; i++) {
        if (i + AHEAD < count)
            __builtin_prefetch(&list->voxels[voxels[i + AHEAD]]);
        const struct sp_voxel *v = &list->voxels[voxels[i < count ? i : 0]];
        for (int k = 0; k < 3; k++) {
            to->at[k][i] = v->at[k];
            to->color[k][i] = v->color[k] * (1.0f / 65535);
        }
        to->normal[i] = (int32_t)v->normal;
        to->phase[i] = v->phase;
        to->depth[i] = v->depth;
        to->is_opaque[i] = v->code & SP_VOXEL_OPAQUE ? 1 : 0;
    }
}

/* Computes positions and kernels; returns the volumes of the cells, divided by the mean volume. */
static inline sp_wide locate(const struct sp_voxel_frame *frame, const struct lanes *lanes,
                             struct sp_places *p) {
    const struct sp_ewa_frame *f = &frame->ewa;
    sp_wide at[3], volume = sp_wide_all(1);
    for (int a = 0; a < 3; a++) {
        sp_wide_int i = sp_wide_int_load(lanes->at[a]);
        at[a] = frame->is_rectilinear ? sp_wide_gather(frame->place[a], i) : sp_wide_from_int(i);
    }
    for (int r = 0; r < 3; r++) {
        p->u[r] = (float)f->base[r] + f->step[r][0] * at[0] + f->step[r][1] * at[1] +
                  f->step[r][2] * at[2];
        for (int a = 0; a < 3; a++)
            p->kernel[r][a] = sp_wide_all(f->kernel[r][a]);
    }
    for (int a = 0; frame->is_rectilinear && a < 3; a++) {
        sp_wide size = sp_wide_gather(frame->size[a], sp_wide_int_load(lanes->at[a]));
        for (int r = 0; r < 3; r++)
            p->kernel[r][a] *= size;
        volume *= size;
    }
    return volume;
}

/* Optical depths at the centres of the footprints. */
static inline sp_wide compute_depths(const struct sp_voxel_frame *frame, const struct lanes *lanes,
                                     sp_wide gain) {
    const struct sp_ewa_frame *f = &frame->ewa;
    const bool is_flat = frame->mode == SP_FILTER_NONE;
    sp_wide over_cell = sp_wide_load(lanes->depth) * f->gain;
    sp_wide_mask is_opaque = sp_wide_int_lt(sp_wide_int_all(0), sp_wide_int_load(lanes->is_opaque));
    sp_wide least = sp_wide_all(frame->opaque), depth = over_cell * gain;
    if (is_flat)
        depth = sp_wide_select(is_opaque, sp_wide_max(depth, least), depth);
    else
        depth = sp_wide_select(is_opaque, sp_wide_max(over_cell, least), over_cell) * gain;
    return sp_wide_min(depth, sp_wide_all(SP_DEPTH_MAX));
}

/* The splats of some voxels; close[]: of the lanes in the bits `is_close`. */
struct splats {
    struct sp_outlines outline;
    struct sp_streak_places streaks;
    struct sp_close close[SP_WIDE];
    unsigned is_close;
};

static inline void write_records(const struct splats *s, const struct lanes *lanes, sp_wide u2,
                                 sp_wide depth, unsigned bits, struct sp_voxel_record *out) {
    for (; bits; bits &= bits - 1) {
        int i = __builtin_ctz(bits);
        struct sp_voxel_record *r = out++;
        sp_voxel_record_write(&s->outline, i, depth[i], u2[i],
                              s->is_close >> i & 1 ? &s->close[i] : NULL, r);
        for (int k = 0; k < 3; k++)
            r->color[k] = lanes->color[k][i];
    }
}

static inline void shade(const struct sp_voxel_frame *frame, const struct sp_places *p,
                         struct lanes *lanes) {
    sp_wide to_eye[3], color[3];
    sp_place_eye(&frame->ewa, p->u, to_eye);
    for (int k = 0; k < 3; k++)
        color[k] = sp_wide_load(lanes->color[k]);
    sp_shade_apply(frame->shade, sp_wide_int_load(lanes->normal), to_eye, color);
    for (int k = 0; k < 3; k++)
        sp_wide_store(lanes->color[k], color[k]);
}

/* The standard deviations that decide the length of streaks along unit vectors d of the world
 * [cells]: the deviation of the kernel of a mean cell, times how much longer the cell is along d.
 */
static inline sp_wide compute_deviations(const struct sp_voxel_frame *frame,
                                         const struct lanes *lanes, const sp_wide d[3]) {
    const float(*to_grid)[3] = frame->streaks.to_grid;
    sp_wide mean = sp_wide_all(0), local = sp_wide_all(1e-30f);
    if (!frame->is_rectilinear)
        return sp_wide_all(frame->ewa.sigma);
    for (int a = 0; a < 3; a++) {
        const sp_wide size = sp_wide_gather(frame->size[a], sp_wide_int_load(lanes->at[a]));
        const sp_wide along = to_grid[a][0] * d[0] + to_grid[a][1] * d[1] + to_grid[a][2] * d[2];
        mean += along * along;
        local += along / size * (along / size);
    }
    return frame->ewa.sigma * sp_wide_sqrt(mean / local);
}

/* Places the splats of a layer of vectors. */
static inline sp_wide_mask place_streaks(const struct sp_voxel_frame *frame,
                                         const struct lanes *lanes, struct sp_places *p,
                                         struct sp_outlines *o, struct sp_streak_places *s) {
    const struct sp_streaks *streaks = &frame->streaks;
    const sp_wide_int packed = sp_wide_int_load(lanes->normal);
    sp_wide world[3], direction[3];
    sp_shade_unpack(packed, world);
    for (int r = 0; r < 3; r++)
        direction[r] = streaks->to_camera[r][0] * world[0] + streaks->to_camera[r][1] * world[1] +
                       streaks->to_camera[r][2] * world[2];
    const sp_wide sigma = compute_deviations(frame, lanes, world);
    sp_wide_mask seen = sp_streak_place(&frame->ewa, streaks, p, direction, sigma, o, s);
    return sp_streak_keep_moving(streaks, seen,
                                 sp_wide_int_lt(sp_wide_int_all(0), packed >> 22 & 1023), s);
}

/* Places the splats of the first `left` lanes; returns the lanes that are drawn. */
static inline unsigned place_splats(const struct sp_voxel_frame *frame, const struct lanes *lanes,
                                    int left, struct sp_places *p, struct splats *s) {
    const struct sp_ewa_frame *f = &frame->ewa;
    const sp_wide_mask used = sp_wide_first(left);
    s->is_close = 0;
    if (frame->has_streaks)
        return sp_wide_mask_bits(used & place_streaks(frame, lanes, p, &s->outline, &s->streaks));
    unsigned bits = sp_wide_mask_bits(sp_place_splats(f, p, frame->mode, &s->outline));
    if (frame->mode != SP_FILTER_NONE)
        bits = sp_close_place_all(f, p, bits, &s->outline, &s->is_close, s->close);
    return bits & sp_wide_mask_bits(used);
}

uint32_t sp_voxel_set_up(const struct sp_voxel_frame *frame, const void *from,
                         const uint32_t *voxels, uint32_t count, struct sp_voxel_record *out) {
    const struct sp_voxel_list *list = from;
    uint32_t written = 0;
    for (uint32_t n = 0; n < count; n += SP_WIDE) {
        int left = count - n < SP_WIDE ? (int)(count - n) : SP_WIDE;
        struct lanes lanes;
        struct sp_places p;
        struct splats s;
        read_voxels(list, voxels + n, (int)(count - n), &lanes);
        sp_wide volume = locate(frame, &lanes, &p);
        unsigned bits = place_splats(frame, &lanes, left, &p, &s);
        if (frame->closed)
            bits = sp_voxel_drop_covered(frame, &s.outline, bits);
        if (!bits)
            continue;
        sp_wide depth = compute_depths(frame, &lanes, s.outline.gain * volume);
        if (frame->shade)
            shade(frame, &p, &lanes);
        write_records(&s, &lanes, p.u[2], depth, bits, out + written);
        if (frame->has_streaks)
            sp_streak_write(&frame->streaks, lanes.phase, &s.streaks, bits, out + written);
        written += (uint32_t)__builtin_popcount(bits);
    }
    return written;
}
