/* SPDX-License-Identifier: Apache-2.0
 *
 * The programs of shaders/passes/composite.glsl. A program is compiled when a view first needs it.
 */
#ifndef GL_COMPOSITOR_H
#define GL_COMPOSITOR_H

#include "backend/gl/state.h"

/* The settings for which a compositor is compiled. */
struct gl_compositor_choices {
    enum sp_compositing mode;
    bool is_flat, is_cubic, is_clipped, is_linear, is_post, has_layers;
};

/* Uploads the table of the cubic kernel. SP_ERR_MEMORY. A context must be current, here and below.
 */
bool gl_compositor_init(struct gl_state *state, struct sp_error *err);

/* Return the program, which is compiled at the first use; 0 with *err set (SP_ERR_UNSUPPORTED). */
unsigned gl_compositor_open(struct gl_state *state, const struct gl_compositor_choices *choices,
                            struct sp_error *err);
unsigned gl_compositor_choose(struct gl_state *state, const struct gl_frame *frame,
                              const struct sp_view *view, bool has_layers, struct sp_error *err);

/* Deletes all programs. */
void gl_compositor_finish(struct gl_state *state);

#endif
