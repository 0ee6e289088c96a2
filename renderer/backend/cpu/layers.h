/* SPDX-License-Identifier: Apache-2.0
 *
 * Surfaces and shells of a frame: per tile, the fragments of all of them. With a volume in the
 * frame they are stored for its compositor; else they are composited here.
 */
#ifndef SP_BACKEND_CPU_LAYERS_H
#define SP_BACKEND_CPU_LAYERS_H

#include "backend/cpu/frame.h"

/* True if the view has layers other than the volume, or none at all. */
bool cpu_layers_are_wanted(const struct sp_view *view);

/* The view's volume layer; NULL = none. */
const struct sp_layer *cpu_layers_volume(const struct sp_view *view);

/* Draws the layers other than the volume. With a volume in the view, fills *fragments, valid until
 * the arenas are reset; else fills every pixel and the stats. SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED. */
bool cpu_layers_draw(struct cpu_state *state, const struct sp_backend_job *job,
                     struct sp_fragments *fragments, struct sp_error *err);

#endif
