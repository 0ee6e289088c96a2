/* SPDX-License-Identifier: Apache-2.0
 *
 * Surfaces and shells of a frame (draw/layers/layers.h). With a volume in the frame its compositor
 * gets their fragments, band after band; else they are composited here.
 */
#ifndef SP_BACKEND_CPU_LAYERS_H
#define SP_BACKEND_CPU_LAYERS_H

#include "backend/cpu/frame.h"
#include "draw/layers/layers.h"

/* The layers of a frame beside the volume. It is not moved or copied. */
struct cpu_layers {
    struct cpu_state *state;
    const struct sp_backend_job *job;
    struct sp_camera_transform camera;
    struct sp_shade shade;
    struct sp_layers_input input;
    struct sp_layers layers;
    struct sp_fragments fragments;
};

/* Draws the layers other than the volume. With a volume in the view, prepares own->fragments, valid
 * until the state's arena is reset; else fills every pixel and the stats. SP_ERR_MEMORY,
 * SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool cpu_layers_draw(struct cpu_state *state, const struct sp_backend_job *job,
                     struct cpu_layers *own, struct sp_error *err);

#endif
