/* SPDX-License-Identifier: Apache-2.0
 *
 * Draws the layers of a frame other than the volume (draw/layers/layers.h). If the frame has a
 * volume, the volume's compositor gets their fragments, band after band; otherwise the layers are
 * composited here.
 */
#ifndef SP_BACKEND_CPU_LAYERS_H
#define SP_BACKEND_CPU_LAYERS_H

#include "backend/cpu/frame.h"
#include "draw/layers/layers.h"

/* The layers of a frame other than the volume. Do not move or copy the struct: its fields point to
 * each other. */
struct cpu_layers {
    struct cpu_state *state;
    const struct sp_backend_job *job;
    struct sp_camera_transform camera;
    struct sp_shade shade;
    struct sp_layers_input input;
    struct sp_layers layers;
    struct sp_fragments fragments;
};

/* Draws the layers other than the volume. If the view has a volume, prepares own->fragments, which
 * are valid until the state's arena is reset. Otherwise fills every pixel and the stats.
 * SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool cpu_layers_draw(struct cpu_state *state, const struct sp_backend_job *job,
                     struct cpu_layers *own, struct sp_error *err);

#endif
