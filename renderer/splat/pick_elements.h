/* SPDX-License-Identifier: Apache-2.0
 *
 * Picking in layers of points, Gaussians and triangles: finds the elements that a ray meets. Each
 * element has one depth, as in the image.
 */
#ifndef SP_SPLAT_PICK_ELEMENTS_H
#define SP_SPLAT_PICK_ELEMENTS_H

#include <stddef.h>

#include "sp/pick.h"
#include "splat/ray.h"

struct sp_pick_event {
    double t;     /* along the ray, world units */
    double depth; /* optical depth; infinity = opaque */
    double value; /* of a point; NaN = the element is not a point */
};

struct sp_pick_events {
    struct sp_pick_event *at; /* [count], front to back */
    size_t count;
    uint64_t tested; /* number of elements that were tested against the ray */
};

/* Finds the events of all visible layers on a ray that sp_ray_init_open() has made. SP_ERR_MEMORY.
 * Call sp_pick_events_finish() also after a failure. */
bool sp_pick_elements(const struct sp_pick_input *input, const struct sp_ray *ray,
                      struct sp_pick_events *events, struct sp_error *err);
void sp_pick_events_finish(struct sp_pick_events *events);

#endif
