/* SPDX-License-Identifier: Apache-2.0
 *
 * Where the camera will be: the motion of the last updates of the view, continued. A frame of a
 * moving view is displayed some time after its camera was asked for. A client that warps frames by
 * depth gets the frame of the camera that it will probably show then, and only has to warp away
 * the error of the prediction. Pure: no clock, no lock.
 */
#ifndef SRV_SCHEDULE_PREDICT_H
#define SRV_SCHEDULE_PREDICT_H

#include <stdbool.h>

#include "sp/view.h"

enum { SRV_PAST_CAMERAS = 16 };

struct srv_past { /* the cameras of the last updates; zeroed = none */
    struct {
        struct sp_camera camera;
        double at_ms;
    } ring[SRV_PAST_CAMERAS];
    unsigned count, newest;
};

/* The view has this camera now. Cameras that are equal to the one before count too: they show that
 * the camera rests. */
void srv_past_add(struct srv_past *past, const struct sp_camera *camera, double now_ms);

/* Forgets all cameras: the camera jumped. */
void srv_past_clear(struct srv_past *past);

/* Gets the camera that is expected ahead_ms after the newest update. The target and the logarithms
 * of its distance and of the height go on as in the last 40 ms, and the camera turns on about one
 * axis. If the motion was faster before, it gets slower by the same factor in each 40 ms.
 * False, and *camera is the newest one: the camera rests or has just begun to move, or it changes
 * in another way, for example its projection. */
bool srv_predict(const struct srv_past *past, double now_ms, double ahead_ms,
                 struct sp_camera *camera);

#endif
