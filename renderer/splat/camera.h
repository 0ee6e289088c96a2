/* SPDX-License-Identifier: Apache-2.0
 *
 * The camera of a frame: world → camera → ray space (renderer/README.md).
 *
 *   u = W t + d      rows of W: right, down, forward in world space, orthonormal
 *   x0 = cx + f·u0/u2, x1 = cy + f·u1/u2 [px], row 0 on top; orthographic: x0 = cx + s·u0, …
 */
#ifndef SP_SPLAT_CAMERA_H
#define SP_SPLAT_CAMERA_H

#include "base/vec.h"
#include "sp/view.h"

struct sp_camera_transform {
    enum sp_projection projection;
    struct sp_mat3 w;
    struct sp_vec3 eye; /* world; d = −W·eye */
    double scale;       /* f [px] or s [px per world unit] */
    double centre[2];   /* cx, cy [px] */
    double tan_half[2]; /* tangent of half the field of view, per axis; perspective only */
    double near;        /* world units */
};

/* Computes the transform for an image of `size` px. The camera must be valid. */
void sp_camera_transform_init(struct sp_camera_transform *frame, const struct sp_camera *camera,
                              const uint32_t size[2]);

#endif
