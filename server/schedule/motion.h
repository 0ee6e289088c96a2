/* SPDX-License-Identifier: Apache-2.0
 *
 * How fast the image moves on the screen: from the change of the camera between updates of the
 * view. Pure: no clock, no lock.
 *
 * The corners of a cube round the target, which fills most of the image, are projected by both
 * cameras. Their mean displacement is the motion. The part of it that a shift, a rotation and a
 * change of size of the whole image do not explain is the parallax: a turn has little else, a pan,
 * a roll and a zoom have next to none.
 */
#ifndef SRV_SCHEDULE_MOTION_H
#define SRV_SCHEDULE_MOTION_H

#include <stdbool.h>

#include "sp/view.h"

struct srv_speed {           /* image heights per second */
    double motion, parallax; /* parallax <= motion, up to rounding */
};
/* Until it is measured, motion counts as a turn by 34 degrees per second. */
#define SRV_MOTION_NOMINAL ((struct srv_speed){ 0.13, 0.13 })

struct srv_motion {
    struct sp_camera camera; /* of the last update that counted */
    double at_ms;            /* its time; 0 = none yet */
    double moved_ms;         /* when the camera changed last; 0 = never */
    struct srv_speed speed;  /* mean of the last updates; 0 = never measured */
};

/* The view has this camera now. A zeroed struct is a view that has not moved. */
void srv_motion_update(struct srv_motion *motion, const struct sp_camera *camera, double now_ms);

/* Returns how far the image moves from one camera to the other in the mean, image heights. */
double srv_motion_between(const struct sp_camera *from, const struct sp_camera *to);

/* Returns the height of what the image shows at the target, world units. */
double srv_motion_height(const struct sp_camera *camera);

/* Gets the speed. False: the camera does not move, so that changes of the view are of another
 * kind. */
bool srv_motion_speed(const struct srv_motion *motion, double now_ms, struct srv_speed *speed);

#endif
