/* SPDX-License-Identifier: Apache-2.0 */
#include "schedule/predict.h"

#include <math.h>

#include "common/vectors.h"

#define LEAST_MS 4.0   /* updates that are closer together count as one */
#define WINDOW_MS 60.0 /* the motion is measured over about this time */
#define SHORTEST_MS 24.0
#define PAUSE_MS 60.0 /* without an update for so long, the camera rests */
#define TURN_MAX 0.35 /* rad: no prediction turns further */
#define SCALE_MAX 1.5 /* or comes nearer by a larger factor */
#define SHIFT_MAX 0.3 /* or moves the target by more than this part of its distance */

void srv_past_clear(struct srv_past *past) {
    past->count = 0;
}

void srv_past_add(struct srv_past *past, const struct sp_camera *camera, double now_ms) {
    const bool is_close = past->count > 0 && now_ms - past->ring[past->newest].at_ms < LEAST_MS;
    if (!is_close) {
        past->newest = (past->newest + 1) % SRV_PAST_CAMERAS;
        past->count += past->count < SRV_PAST_CAMERAS;
        past->ring[past->newest].at_ms = now_ms;
    }
    past->ring[past->newest].camera = *camera;
}

/* The axes right, up and forward, and the distance of the target. */
struct pose {
    double axes[3][3], distance;
};

static bool normalize(double a[3]) {
    const double length = sqrt(srv_dot(a, a));
    for (int i = 0; i < 3 && length > 0; i++)
        a[i] /= length;
    return length > 0;
}

static bool pose_of(const struct sp_camera *c, struct pose *pose) {
    double *right = pose->axes[0], *up = pose->axes[1], *forward = pose->axes[2];
    for (int i = 0; i < 3; i++)
        forward[i] = c->target[i] - c->position[i];
    pose->distance = sqrt(srv_dot(forward, forward));
    if (!normalize(forward))
        return false;
    srv_cross(forward, c->up, right);
    if (!normalize(right))
        return false;
    srv_cross(right, forward, up);
    return true;
}

/* Returns the angle of the rotation that takes the axes of `from` to those of `to`, rad, and its
 * axis. */
static double rotation(const struct pose *from, const struct pose *to, double axis[3]) {
    double trace = 0;
    for (int i = 0; i < 3; i++)
        axis[i] = 0;
    for (int a = 0; a < 3; a++) { /* the axis is half the sum of from × to, over the sine */
        double cross[3];
        srv_cross(from->axes[a], to->axes[a], cross);
        trace += srv_dot(from->axes[a], to->axes[a]);
        for (int i = 0; i < 3; i++)
            axis[i] += cross[i] / 2;
    }
    const double sine = sqrt(srv_dot(axis, axis));
    return normalize(axis) ? atan2(sine, (trace - 1) / 2) : 0;
}

/* Rodrigues' formula. */
static void rotate(double v[3], const double axis[3], double angle) {
    const double along = srv_dot(axis, v) * (1 - cos(angle));
    double cross[3];
    srv_cross(axis, v, cross);
    for (int i = 0; i < 3; i++)
        v[i] = v[i] * cos(angle) + cross[i] * sin(angle) + axis[i] * along;
}

/* Continues the motion from one camera to another by `part` of it. */
static bool continue_motion(const struct sp_camera *from, double part, struct sp_camera *camera) {
    struct pose before, after;
    double axis[3], shift[3];
    if (from->projection != camera->projection || from->fov_y != camera->fov_y ||
        !pose_of(from, &before) || !pose_of(camera, &after))
        return false;
    const double angle = rotation(&before, &after, axis);
    double scale = after.distance / before.distance;
    if (camera->projection == SP_ORTHOGRAPHIC)
        scale = camera->height / from->height;
    for (int i = 0; i < 3; i++)
        shift[i] = camera->target[i] - from->target[i];
    const double largest = fmax(fmax(fabs(angle) / TURN_MAX, fabs(log(scale)) / log(SCALE_MAX)),
                                sqrt(srv_dot(shift, shift)) / (SHIFT_MAX * after.distance));
    if (!(largest > 0))
        return false;
    part = fmin(part, 1 / largest);
    rotate(after.axes[1], axis, angle * part);
    rotate(after.axes[2], axis, angle * part);
    const double zoom = pow(scale, part);
    const double distance = after.distance * (camera->projection == SP_ORTHOGRAPHIC ? 1 : zoom);
    camera->height *= camera->projection == SP_ORTHOGRAPHIC ? zoom : 1;
    for (int i = 0; i < 3; i++) {
        camera->target[i] += shift[i] * part;
        camera->position[i] = camera->target[i] - after.axes[2][i] * distance;
        camera->up[i] = after.axes[1][i];
    }
    return true;
}

bool srv_predict(const struct srv_past *past, double now_ms, double ahead_ms,
                 struct sp_camera *camera) {
    if (past->count == 0)
        return false;
    const double newest_ms = past->ring[past->newest].at_ms;
    *camera = past->ring[past->newest].camera;
    const struct sp_camera *from = NULL;
    double since_ms = 0;
    for (unsigned i = 1; i < past->count && since_ms < WINDOW_MS; i++) {
        const unsigned at = (past->newest + SRV_PAST_CAMERAS - i) % SRV_PAST_CAMERAS;
        const double ms = newest_ms - past->ring[at].at_ms;
        if (ms - since_ms > PAUSE_MS)
            break;
        since_ms = ms;
        from = &past->ring[at].camera;
    }
    if (!from || since_ms < SHORTEST_MS || now_ms - newest_ms > PAUSE_MS || !(ahead_ms > 0))
        return false;
    return continue_motion(from, ahead_ms / since_ms, camera);
}
