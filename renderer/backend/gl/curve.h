/* SPDX-License-Identifier: Apache-2.0
 *
 * The transfer function that classifies pixels (draw/footprints/post.h), as shaders/post.glsl reads
 * it.
 */
#ifndef GL_CURVE_H
#define GL_CURVE_H

#include "backend/gl/buffer.h"
#include "classify/transfer.h"

struct gl_curve {
    struct gl_buffer buffer;
    struct sp_transfer_function tf; /* the curve was made for this function, */
    double made_for[4];             /* and for this range, base and gradient unit of the volume */
    float half;
};

/* Makes and uploads the curve, unless it is up to date. thickness: of slabs [world unit]; values
 * are relative to `base`. A context must be current. SP_ERR_MEMORY. */
bool gl_curve_update(struct gl_curve *curve, const struct sp_volume *volume, double base,
                     const struct sp_transfer_function *tf, double thickness, struct sp_error *err);

#endif
