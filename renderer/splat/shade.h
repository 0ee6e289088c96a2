/* SPDX-License-Identifier: Apache-2.0
 *
 * Shading of a splat: Phong's model with Blinn's half vector, two-sided, from quantised gradients.
 *
 *   c' = c·(ambient + diffuse·Σ L·|n·l|) + specular·Σ L·|n·h|^exponent        h = (l + v)/|l + v|
 *
 * l and v point from the voxel to the light and to the eye. A voxel whose gradient is zero has no
 * side: it is lit as if it faced every light, without a highlight. Colours are not bounded here;
 * they are when the frame is resolved to 8 bits.
 */
#ifndef SP_SPLAT_SHADE_H
#define SP_SPLAT_SHADE_H

#include "base/isa.h"
#include "base/wide.h"
#include "classify/gradient.h"
#include "splat/camera.h"

struct sp_shade {
    float to_camera[3][3]; /* W */
    float ambient, diffuse, specular, exponent;
    int light_count;
    struct {
        float direction[3]; /* unit, in camera space (right, down, forward) */
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

#endif
