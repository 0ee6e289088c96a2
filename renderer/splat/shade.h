/* SPDX-License-Identifier: Apache-2.0
 *
 * Shading of a splat: Phong's model with Blinn's half vector, two-sided, from quantised gradients.
 *
 *   c' = c·(ambient + diffuse·Σ L·|n·l|) + specular·Σ L·|n·h|^exponent        h = (l + v)/|l + v|
 *
 * l and v point from the voxel to the light and to the eye. A voxel with a zero gradient has no
 * normal: it is lit as if it faced every light, without a highlight. Shading does not clamp
 * colours; they are clamped when the frame is resolved to 8 bits.
 *
 * A coarse cell is lit by means over its microflakes (classify/microflakes.h). With T = S/trace S
 * and the exponent p:
 *
 *   |n·l|   ─► √(lᵀ S l)
 *   |n·h|^p ─► (1 − w)·D(h)/(p + 1) + w·N·(hᵀ T h)^{p/2}        w = 1 − p·(1 − |T|²)/4, 0 at least
 *
 * D is the angular central Gaussian of variance T + I/p. The mean of D over all directions is 1,
 * and the mean of the highlight is 1/(p + 1), so that the energy of a highlight does not depend on
 * the distribution of the microflakes. Where microflakes spread less than the highlight, the second
 * term is more accurate; N makes it exact for evenly spread microflakes.
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
    float glint_width, glint_gain; /* microflakes: 1/p, and log2 of N for T = I/3 */
    int light_count;
    struct {
        float direction[3]; /* unit, in camera space (right, down, forward) */
        float world[3];     /* the same in world space */
        float color[3];
    } lights[SP_LIGHTS_MAX];
};

void sp_shade_init(struct sp_shade *shade, const struct sp_camera_transform *camera,
                   const struct sp_shading *shading);

/* sp_gradient_unpack(), SP_WIDE at a time. */
static inline void sp_shade_unpack(sp_wide_int packed, sp_wide direction[3]) {
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

/* Turns a unit vector from camera space into world space. */
static inline void sp_shade_eye(const struct sp_shade *shade, const sp_wide camera[3],
                                sp_wide world[3]) {
    for (int a = 0; a < 3; a++) /* the camera's axes are the rows of W */
        world[a] = camera[0] * shade->to_camera[0][a] + camera[1] * shade->to_camera[1][a] +
                   camera[2] * shade->to_camera[2][a];
}

/* Shades SP_WIDE voxels or pixels. color: the colour of the class in, the shaded colour out.
 * `normal`: unit direction of the gradient; zero = no normal. `to_eye`: unit vector towards the
 * eye. Both in world space. */
void sp_shade_direction(const struct sp_shade *shade, const sp_wide normal[3],
                        const sp_wide to_eye[3], sp_wide color[3]);

/* Computes the light of sp_shade_direction(): the shaded colour is colour · lit + shine. `share`:
 * the part of the ambient and the diffuse light, and of the first light, that arrives, in [0, 1];
 * NULL = all of it. */
void sp_shade_terms(const struct sp_shade *shade, const sp_wide normal[3], const sp_wide to_eye[3],
                    const sp_wide *share, sp_wide lit[3], sp_wide shine[3]);

/* Like sp_shade_direction(), for packed gradients (classify/gradient.h). `to_eye` is in camera
 * space. */
void sp_shade_apply(const struct sp_shade *shade, sp_wide_int packed_gradient,
                    const sp_wide to_eye[3], sp_wide color[3]);

/* Computes the light of coarse cells from their packed microflakes: the shaded colour is colour ·
 * lit + shine. */
void sp_shade_microflakes(const struct sp_shade *shade, const sp_wide_int word[2],
                          const sp_wide to_eye[3], sp_wide lit[3], sp_wide shine[3]);

#endif
