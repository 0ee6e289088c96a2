/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/shade.h"

#include "splat/exp2.h"

static inline sp_wide dot(const sp_wide a[3], const sp_wide b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* sp_gradient_unpack(), SP_WIDE at a time. */
static inline void unpack(sp_wide_int packed, sp_wide direction[3]) {
    const float step = 1.0f / SP_GRADIENT_STEPS;
    const sp_wide zero = sp_wide_all(0);
    sp_wide u = sp_wide_from_int((packed & 2047) - SP_GRADIENT_STEPS) * step;
    sp_wide v = sp_wide_from_int((packed >> 11 & 2047) - SP_GRADIENT_STEPS) * step;
    sp_wide w = 1 - sp_wide_abs(u) - sp_wide_abs(v), fold = sp_wide_max(-w, zero);
    u += sp_wide_select(sp_wide_lt(u, zero), fold, -fold);
    v += sp_wide_select(sp_wide_lt(v, zero), fold, -fold);
    sp_wide_int magnitude = (sp_wide_int)((sp_wide_bits)packed >> 22);
    sp_wide scale = sp_wide_keep(sp_wide_int_lt(sp_wide_int_all(0), magnitude),
                                 1 / sp_wide_sqrt(u * u + v * v + w * w));
    direction[0] = u * scale;
    direction[1] = v * scale;
    direction[2] = w * scale;
}

/* (n·h/|h|)^exponent; 0 where the half vector is no direction or lies across the normal. */
static inline sp_wide highlight(float exponent, const sp_wide n[3], const sp_wide h[3]) {
    sp_wide length2 = dot(h, h), along = sp_wide_abs(dot(n, h));
    sp_wide_mask shines =
        sp_wide_lt(sp_wide_all(1e-12f), length2) & sp_wide_lt(sp_wide_all(1e-6f), along);
    sp_wide square = sp_wide_select(shines, along * along / length2, sp_wide_all(1));
    return sp_wide_keep(shines, sp_wide_exp2(exponent * sp_wide_log2(square) * 0.5f));
}

void sp_shade_direction(const struct sp_shade *shade, const sp_wide world[3],
                        const sp_wide to_eye[3], sp_wide color[3]) {
    const sp_wide one = sp_wide_all(1), zero = sp_wide_all(0);
    sp_wide n[3], lit[3], shine[3] = { zero, zero, zero };
    for (int r = 0; r < 3; r++) {
        const float *w = shade->to_camera[r];
        n[r] = w[0] * world[0] + w[1] * world[1] + w[2] * world[2];
        lit[r] = sp_wide_all(shade->ambient);
    }
    sp_wide_mask has_side =
        sp_wide_lt(zero, sp_wide_max(sp_wide_abs(world[0]),
                                     sp_wide_max(sp_wide_abs(world[1]), sp_wide_abs(world[2]))));
    for (int i = 0; i < shade->light_count; i++) {
        const float *strength = shade->lights[i].color;
        sp_wide l[3], h[3];
        for (int c = 0; c < 3; c++) {
            l[c] = sp_wide_all(shade->lights[i].direction[c]);
            h[c] = l[c] + to_eye[c];
        }
        sp_wide facing = sp_wide_select(has_side, sp_wide_abs(dot(n, l)), one);
        sp_wide glint = sp_wide_keep(has_side, highlight(shade->exponent, n, h));
        for (int c = 0; c < 3; c++) {
            lit[c] += shade->diffuse * facing * strength[c];
            shine[c] += shade->specular * glint * strength[c];
        }
    }
    for (int c = 0; c < 3; c++)
        color[c] = color[c] * lit[c] + shine[c];
}

void sp_shade_apply(const struct sp_shade *shade, sp_wide_int packed_gradient,
                    const sp_wide to_eye[3], sp_wide color[3]) {
    sp_wide world[3];
    unpack(packed_gradient, world);
    sp_shade_direction(shade, world, to_eye, color);
}
