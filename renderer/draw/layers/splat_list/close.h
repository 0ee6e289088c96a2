/* SPDX-License-Identifier: Apache-2.0
 *
 * The weights of splats close to the eye (splat/close.h). For kernel sources only.
 */
#ifndef SP_SPLAT_LIST_CLOSE_H
#define SP_SPLAT_LIST_CLOSE_H

#include "draw/layers/splat_list/kernels.h"
#include "splat/close.h"
#include "splat/normal.h"

/* A splat close to the eye, ready for pixels. */
struct sp_voxel_close {
    const struct sp_voxel_frame *frame;
    const struct sp_voxel_record *record;
    bool is_ahead;
    float cut; /* the largest exponent */
    /* Ahead, at w·(dx, dy): */
    float slope[2]; /* of B [1/px] */
    float power;    /* D = B² + power·p */
    float e[3];     /* E = 1 + e[0]·dx + e[1]·dy + e[2]·(dx² + dy²) */
    /* Around: */
    float plane;  /* n·√S22 */
    float square; /* ½·log2 e·ρ², as stored */
    float behind; /* factor on rays that pass the centre behind the eye, [0, 1] */
};

static inline void sp_voxel_close_ready_ahead(struct sp_voxel_close *c) {
    const struct sp_voxel_record *r = c->record;
    const struct sp_ewa_frame *f = &c->frame->ewa;
    const float w = (float)(r->close.kind - SP_CLOSE_AHEAD) * (1 / 32767.0f);
    const float ratio[2] = { (r->x - f->centre[0]) / f->scale, (r->y - f->centre[1]) / f->scale };
    const float square = 1 + ratio[0] * ratio[0] + ratio[1] * ratio[1];
    for (int i = 0; i < 2; i++) {
        c->slope[i] = w * r->close.more[i];
        c->e[i] = 2 * w * ratio[i] / (f->scale * square);
    }
    c->e[2] = w * w / (f->scale * f->scale * square);
    c->power = w * w * (2 / SP_LOG2E) / sp_close_square(r->close.square);
}

/* While the eye is inside the kernel, rays that pass its centre behind the eye count in full. As
 * the eye leaves the kernel, their factor falls to 0. */
static inline void sp_voxel_close_ready_around(struct sp_voxel_close *c) {
    const struct sp_close *close = &c->record->close;
    const float square = sp_close_square(close->square), fade = 4;
    const float inside = fade * (c->frame->ewa.radius - sqrtf(square));
    c->plane = sp_close_plane(close->kind);
    c->square = 0.5f * SP_LOG2E * square;
    c->behind = c->frame->is_trained || inside > 1 ? 1 : inside > 0 ? inside : 0;
}

static inline struct sp_voxel_close sp_voxel_close_begin(const struct sp_voxel_frame *frame,
                                                         const struct sp_voxel_record *r) {
    struct sp_voxel_close c = { .frame = frame,
                                .record = r,
                                .is_ahead = sp_close_is_ahead(&r->close),
                                .cut = frame->is_trained ? 126 : frame->ewa.cut };
    if (c.is_ahead)
        sp_voxel_close_ready_ahead(&c);
    else
        sp_voxel_close_ready_around(&c);
    return c;
}

/* The weight of the pixels at (dx, dy) from the centre; *covered loses the pixels outside. */
static inline sp_wide sp_voxel_close_ahead(const struct sp_voxel_close *c, sp_wide dx, sp_wide dy,
                                           sp_wide_mask *covered) {
    const struct sp_voxel_record *r = c->record;
    const sp_wide power = (r->a * dx + r->b * dy) * dx + r->c * dy * dy;
    const sp_wide b = 1 + c->slope[0] * dx + c->slope[1] * dy, d = b * b + c->power * power;
    const sp_wide inverse = 1 / d;
    *covered &= sp_wide_le(power, c->cut * d) & sp_wide_lt(sp_wide_all(0), b);
    const sp_wide weight = sp_wide_exp2(-power * inverse);
    if (c->frame->is_trained)
        return weight;
    const sp_wide e = 1 + c->e[0] * dx + c->e[1] * dy + c->e[2] * (dx * dx + dy * dy);
    return weight * sp_wide_sqrt(sp_wide_max(e, sp_wide_all(0)) * inverse);
}

/* The same for a kernel around the eye, and pixels at (x, y). */
static inline sp_wide sp_voxel_close_around(const struct sp_voxel_close *c, sp_wide x, sp_wide y,
                                            sp_wide_mask *covered) {
    const struct sp_voxel_record *r = c->record;
    const struct sp_ewa_frame *f = &c->frame->ewa;
    const sp_wide right = (x - f->centre[0]) * (1 / f->scale);
    const sp_wide down = (y - f->centre[1]) * (1 / f->scale);
    const sp_wide d = (r->a * right + r->b * down + r->x) * right + (r->c * down + r->y) * down + 1;
    const sp_wide root = sp_wide_sqrt(d), inverse = 1 / root;
    const sp_wide t = (r->close.more[0] * right + r->close.more[1] * down + r->area) * inverse;
    const sp_wide power = (0.5f * SP_LOG2E) * t * t - c->square;
    const sp_wide_mask is_ahead = sp_wide_lt(sp_wide_all(0), t);
    sp_wide weight = sp_wide_exp2(power) * sp_wide_normal_share(t - c->plane * root);
    weight = sp_wide_select(is_ahead, weight, c->behind * weight);
    *covered &= sp_wide_le(sp_wide_all(-c->cut), power);
    if (c->frame->is_trained)
        return weight;
    return weight * inverse * sp_wide_sqrt(1 + right * right + down * down);
}

/* The weight of the pixels at (x, y): from the centre, if the kernel is ahead. */
static inline sp_wide sp_voxel_close_weigh(const struct sp_voxel_close *c, sp_wide x, sp_wide y,
                                           sp_wide_mask *covered) {
    return c->is_ahead ? sp_voxel_close_ahead(c, x, y, covered)
                       : sp_voxel_close_around(c, x, y, covered);
}

#endif
