/* SPDX-License-Identifier: Apache-2.0
 *
 * A shell on the GPU. The processor keeps its voxels and sorts those that are not hidden front to
 * back (shell/order.h); shaders/24_shell.glsl does the work of shell/set_up.c and shell/tile.c.
 *
 *   voxels    uploaded for each frame, in order: 24 bytes each, and 8 per tile that they touch
 */
#ifndef GL_SHELLS_H
#define GL_SHELLS_H

#include "backend/gl/band.h"

/* The shell of a frame. */
struct gl_shell {
    bool is_drawn;    /* it has voxels */
    bool is_alone;    /* nothing else is in the frame: it is composited, and makes no fragments */
    uint32_t most;    /* voxels of a tile of SP_FRAGMENT_TILE px */
    uint32_t at_once; /* of these per dispatch */
    uint32_t passes;  /* dispatches per band */
    uint32_t words;   /* words of four that a pixel needs between them */
    unsigned program;
};

/* Uploads what the frame needs, after the volume's data. SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED, SP_ERR_UNSUPPORTED. A context must be current, here and below. */
bool gl_shell_begin(struct gl_shell *shell, const struct gl_band *band, struct sp_error *err);

/* Adds the shell to a band that was started. SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_shell_draw(const struct gl_shell *shell, struct gl_band *band, struct sp_error *err);

void gl_shell_finish(struct gl_state *state);

#endif
