/* SPDX-License-Identifier: Apache-2.0
 *
 * The transfer function for pixels (tile/post.h) on the GPU, as shaders/post.glsl reads it.
 */
#ifndef GL_CURVE_H
#define GL_CURVE_H

#include "backend/gl/buffer.h"
#include "classify/transfer.h"

struct gl_curve {
    struct gl_buffer buffer;
    struct sp_transfer_function tf; /* what it was made for, and with … */
    double made_for[4]; /* of the volume: its range, base, and the unit of its gradients */
    float half;
};

/* Makes and uploads it, unless it is there: for pixels of slabs `thickness` thick [world units],
 * with values counted from `base`. A context must be current. SP_ERR_MEMORY. */
bool gl_curve_update(struct gl_curve *curve, const struct sp_volume *volume, double base,
                     const struct sp_transfer_function *tf, double thickness, struct sp_error *err);

#endif
