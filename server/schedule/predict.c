/* SPDX-License-Identifier: Apache-2.0 */
#include "schedule/predict.h"

#include <math.h>

#include "common/vectors.h"

#define LEAST_MS 4.0   /* updates that are closer together count as one */
#define WINDOW_MS 40.0 /* the motion is measured in the last two times of this length */
#define SHORTEST_MS 24.0
#define PAUSE_MS 60.0 /* without an update for so long, the camera rests */
#define TURN_MAX 0.35 /* rad: no prediction turns further */
#define ZOOM_MAX 0.4  /* the logarithm of the largest factor by which it zooms */
#define JUMP 1.0      /* rad in one window: this is no motion */
#define RATIO_MIN 0.05
#define SHIFT_MAX 0.3 /* the furthest shift of the target, of its distance */

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

struct motion {            /* from one camera to another */
    double axis[3], angle; /* rad */
    double zoom;           /* logarithm of the change of the distance or height */
    double shift[3];       /* of the target */
    double size;           /* of all of it, 1 = a radian, a factor of e, or the distance */
};

/* False: this is no motion, for example another projection. */
static bool motion_between(const struct sp_camera *from, const struct sp_camera *to,
                           struct motion *m) {
    struct pose before, after;
    if (from->projection != to->projection || from->fov_y != to->fov_y || !pose_of(from, &before) ||
        !pose_of(to, &after))
        return false;
    m->angle = rotation(&before, &after, m->axis);
    if (m->angle > JUMP) /* for example over a pole of a camera whose up does not change */
        return false;
    m->zoom = to->projection == SP_ORTHOGRAPHIC ? log(to->height / from->height)
                                                : log(after.distance / before.distance);
    for (int i = 0; i < 3; i++)
        m->shift[i] = to->target[i] - from->target[i];
    const double shift = sqrt(srv_dot(m->shift, m->shift)) / after.distance;
    m->size = sqrt(m->angle * m->angle + m->zoom * m->zoom + shift * shift);
    return true;
}

/* Moves the camera by `part` of the motion, but not further than the limits. */
static bool move(struct sp_camera *camera, const struct motion *m, double part) {
    struct pose pose;
    if (!pose_of(camera, &pose) || !(m->size * part > 0))
        return false;
    const double shift = sqrt(srv_dot(m->shift, m->shift)) / pose.distance;
    part = fmin(part,
                1 / fmax(fmax(m->angle / TURN_MAX, fabs(m->zoom) / ZOOM_MAX), shift / SHIFT_MAX));
    rotate(pose.axes[1], m->axis, m->angle * part);
    rotate(pose.axes[2], m->axis, m->angle * part);
    if (camera->projection == SP_ORTHOGRAPHIC)
        camera->height *= exp(m->zoom * part);
    else
        pose.distance *= exp(m->zoom * part);
    for (int i = 0; i < 3; i++) {
        camera->target[i] += m->shift[i] * part;
        camera->position[i] = camera->target[i] - pose.axes[2][i] * pose.distance;
        camera->up[i] = pose.axes[1][i];
    }
    return true;
}

/* Returns the newest update that is at least WINDOW_MS older than the update `at`, or the oldest
 * one without a pause in between. Returns `at` if there is no older one. */
static unsigned before(const struct srv_past *past, unsigned at) {
    const unsigned oldest = (past->newest + SRV_PAST_CAMERAS + 1 - past->count) % SRV_PAST_CAMERAS;
    unsigned found = at;
    while (found != oldest && past->ring[at].at_ms - past->ring[found].at_ms < WINDOW_MS) {
        const unsigned next = (found + SRV_PAST_CAMERAS - 1) % SRV_PAST_CAMERAS;
        if (past->ring[found].at_ms - past->ring[next].at_ms > PAUSE_MS)
            break;
        found = next;
    }
    return found;
}

/* Returns for how long the motion would go on at its present speed, if it gets slower as it did
 * between both windows: its speed falls by the same factor in each window. ratio: that factor. */
static double lasting_ms(double ahead_ms, double window_ms, double ratio) {
    if (ratio >= 0.999)
        return ahead_ms;
    const double decay = -log(fmax(ratio, RATIO_MIN)) / window_ms;
    return (1 - exp(-decay * ahead_ms)) / decay;
}

bool srv_predict(const struct srv_past *past, double now_ms, double ahead_ms,
                 struct sp_camera *camera) {
    if (past->count == 0)
        return false;
    const unsigned newest = past->newest, middle = before(past, newest),
                   oldest = before(past, middle);
    const double new_ms = past->ring[newest].at_ms - past->ring[middle].at_ms;
    const double old_ms = past->ring[middle].at_ms - past->ring[oldest].at_ms;
    struct motion now, then;
    *camera = past->ring[newest].camera;
    if (new_ms < SHORTEST_MS || now_ms - past->ring[newest].at_ms > PAUSE_MS || !(ahead_ms > 0) ||
        !motion_between(&past->ring[middle].camera, camera, &now))
        return false;
    double ratio = 1;
    if (old_ms >= SHORTEST_MS &&
        motion_between(&past->ring[oldest].camera, &past->ring[middle].camera, &then) &&
        then.size > 0)
        ratio = (now.size / new_ms) / (then.size / old_ms);
    return move(camera, &now, lasting_ms(ahead_ms, (new_ms + old_ms) / 2, ratio) / new_ms);
}
