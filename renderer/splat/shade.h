/* SPDX-License-Identifier: Apache-2.0
 *
 * Shading of a splat: Phong's model with Blinn's half vector, two-sided, from quantised gradients.
 *
 *   c' = c·(ambient + diffuse·Σ L·|n·l|) + specular·Σ L·|n·h|^exponent        h = (l + v)/|l + v|
 *
 * l and v point from the voxel to the light and to the eye. A voxel whose gradient is zero has no
 * side: it is lit as if it faced every light, without a highlight. Colours are not bounded here;
 * they are when the frame is resolved to 8 bits.
 *
 * A coarse cell is lit by means over its flakes (classify/microflakes.h). With T = S/trace S and p
 * the exponent,
 *
 *   |n·l|   ─► √(lᵀ S l)
 *   |n·h|^p ─► (1 − w)·D(h)/(p + 1) + w·N·(hᵀ T h)^{p/2}        w = 1 − p·(1 − |T|²)/4, 0 at least
 *
 * D is the angular central Gaussian of variance T + I/p: its mean over all directions is 1, as
 * 1/(p + 1) is that of the highlight, so that a highlight's light is kept however the flakes lie.
 * Where they spread less than the highlight does the power itself is nearer; N makes it right for
 * flakes that face everywhere.
 */
#ifndef SP_SPLAT_SHADE_H
#define SP_SPLAT_SHADE_H

#include "base/isa.h"
#include "base/wide.h"
#include "classify/gradient.h"
#include "classify/microflakes.h"
#include "splat/camera.h"

struct sp_shade {
    float to_camera[3][3]; /* W */
    float ambient, diffuse, specular, exponent;
    float glint_width, glint_gain; /* flakes: 1/p, and log2 of N for T = I/3 */
    int light_count;
    struct {
        float direction[3]; /* unit, in camera space (right, down, forward) */
        float world[3];     /* the same in world space */
        float color[3];
    } lights[SP_LIGHTS_MAX];
};

void sp_shade_init(struct sp_shade *shade, const struct sp_camera_frame *camera,
                   const struct sp_shading *shading);

/* SP_WIDE voxels or pixels at a time. color in: the class's colour; out: shaded. `world` is the
 * gradient's unit direction in world space, or zero: no side. `to_eye` is the unit vector towards
 * the eye in camera space. */
void sp_shade_direction(const struct sp_shade *shade, const sp_wide world[3],
                        const sp_wide to_eye[3], sp_wide color[3]);

/* The same with packed gradients. */
void sp_shade_apply(const struct sp_shade *shade, sp_wide_int packed_gradient,
                    const sp_wide to_eye[3], sp_wide color[3]);

/* Coarse cells, by the words of their flakes: what their colours are multiplied by, and what is
 * added. */
void sp_shade_microflakes(const struct sp_shade *shade, const sp_wide_int word[2],
                          const sp_wide to_eye[3], sp_wide lit[3], sp_wide shine[3]);

#endif
