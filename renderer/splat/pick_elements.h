/* SPDX-License-Identifier: Apache-2.0
 *
 * What a ray meets of the layers of points, Gaussians and triangles: each element at one depth, as
 * in the image.
 */
#ifndef SP_SPLAT_PICK_ELEMENTS_H
#define SP_SPLAT_PICK_ELEMENTS_H

#include <stddef.h>

#include "sp/pick.h"
#include "splat/ray.h"

struct sp_pick_event {
    double t;     /* along the ray, world units */
    double depth; /* optical depth; infinity = opaque */
    double value; /* of a point; NaN = there is none */
};

struct sp_pick_events {
    struct sp_pick_event *at; /* [count], front to back */
    size_t count;
    uint64_t tested; /* elements */
};

/* Finds the events of all visible layers on the ray, which sp_ray_init_open() made. SP_ERR_MEMORY;
 * finish them in any case. */
bool sp_pick_elements(const struct sp_pick_input *input, const struct sp_ray *ray,
                      struct sp_pick_events *events, struct sp_error *err);
void sp_pick_events_finish(struct sp_pick_events *events);

#endif
