/* SPDX-License-Identifier: Apache-2.0
 *
 * Surfaces and shells of a frame (layers/layers.h). With a volume in the frame their fragments are
 * stored for its compositor; else they are composited here.
 */
#ifndef SP_BACKEND_CPU_LAYERS_H
#define SP_BACKEND_CPU_LAYERS_H

#include "backend/cpu/frame.h"
#include "layers/layers.h"

/* Draws the layers other than the volume. With a volume in the view, fills *fragments, valid until
 * the arenas are reset; else fills every pixel and the stats. SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED. */
bool cpu_layers_draw(struct cpu_state *state, const struct sp_backend_job *job,
                     struct sp_fragments *fragments, struct sp_error *err);

#endif
