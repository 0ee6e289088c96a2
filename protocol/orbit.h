/* SPDX-License-Identifier: Apache-2.0
 *
 * The camera on a sphere around its target: an alternative to position and up in a patch.
 *
 *             up of the default camera          The front is the axis of the world, across that up,
 *                 │  eye                        from which the default camera looks most. Azimuth
 *                 │ ╱                           grows towards the right side of an object whose
 *                 │╱ elevation                  front faces the eye, and elevation towards up. Roll
 *          target ●───── azimuth                turns the image clockwise.
 *                front ╲
 *
 * Both axes come from the default camera of the volume, so that the same angles mean the same view
 * whatever the camera was before. Private to protocol/.
 */
#ifndef PROTO_ORBIT_H
#define PROTO_ORBIT_H

#include "sp/view.h"

enum proto_orbit_member {
    PROTO_ORBIT_AZIMUTH,   /* degrees */
    PROTO_ORBIT_ELEVATION, /* degrees, [-90, 90] */
    PROTO_ORBIT_DISTANCE,  /* world units, > 0 */
    PROTO_ORBIT_ROLL,      /* degrees */
    PROTO_ORBIT_MEMBERS
};

struct proto_orbit {
    double value[PROTO_ORBIT_MEMBERS];
};

/* Returns the orbit of a valid camera. */
struct proto_orbit proto_orbit_of(const struct sp_camera *camera, const struct sp_camera *defaults);

/* Sets position and up of *camera from the orbit around its target. Without roll, `up` comes from
 * the default camera unless the position is a pole. */
void proto_orbit_place(const struct proto_orbit *orbit, const struct sp_camera *defaults,
                       struct sp_camera *camera);

#endif
