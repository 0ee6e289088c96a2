/* SPDX-License-Identifier: Apache-2.0 */
#include "schedule/motion.h"

#include <complex.h>
#include <math.h>

#include "common/vectors.h"

#define LEAST_MS 4.0   /* updates that are closer together count as one */
#define PAUSE_MS 300.0 /* the time of an update after such a pause tells no speed */
#define SMOOTH_MS 80.0 /* time constant of the mean */
#define MOVES_MS 200.0 /* the camera moves for so long after an update */
#define CUBE 0.33      /* half its side, in half heights: moves like the mean of what fills it */
#define DEEPEST 0.5    /* of half its side: part of the distance of the target */
#define NEAREST 0.05   /* depth of a projected point, at least: part of that distance */
enum { CORNERS = 8 };

struct basis { /* of a camera */
    double position[3], right[3], up[3], forward[3];
    double distance; /* of the target */
    double height;   /* of the image: world units, or in perspective per unit of depth */
    bool is_perspective;
};

static void normalize(double a[3]) {
    const double length = sqrt(srv_dot(a, a));
    for (int i = 0; i < 3 && length > 0; i++)
        a[i] /= length;
}

static struct basis basis_of(const struct sp_camera *c) {
    struct basis b = { .is_perspective = c->projection == SP_PERSPECTIVE };
    for (int i = 0; i < 3; i++) {
        b.position[i] = c->position[i];
        b.forward[i] = c->target[i] - c->position[i];
    }
    b.distance = sqrt(srv_dot(b.forward, b.forward));
    normalize(b.forward);
    srv_cross(b.forward, c->up, b.right);
    normalize(b.right);
    srv_cross(b.right, b.forward, b.up);
    b.height = b.is_perspective ? 2 * tan(c->fov_y * (M_PI / 360)) : c->height;
    return b;
}

/* Returns the place of a point in the image, in image heights from its centre. */
static double complex project(const struct basis *b, const double point[3]) {
    double to[3];
    for (int i = 0; i < 3; i++)
        to[i] = point[i] - b->position[i];
    const double depth = fmax(srv_dot(to, b->forward), NEAREST * b->distance);
    const double scale = b->height * (b->is_perspective ? depth : 1);
    return srv_dot(to, b->right) / scale + srv_dot(to, b->up) / scale * I;
}

static void corner_of(const struct basis *b, int corner, double point[3]) {
    const double half_height = b->height / 2 * (b->is_perspective ? b->distance : 1);
    double half = CUBE * half_height;
    if (b->is_perspective)
        half = fmin(half, DEEPEST * b->distance);
    for (int i = 0; i < 3; i++)
        point[i] = b->position[i] + b->forward[i] * b->distance +
                   half * ((corner & 1 ? 1 : -1) * b->right[i] + (corner & 2 ? 1 : -1) * b->up[i] +
                           (corner & 4 ? 1 : -1) * b->forward[i]);
}

/* Returns the mean displacement of the corners, and what is left of it after the similarity
 * transform z' = a·z + b that fits best. In image heights. */
static struct srv_speed displacement(const struct sp_camera *from, const struct sp_camera *to) {
    const struct basis before = basis_of(from), after = basis_of(to);
    double complex place[CORNERS], move[CORNERS], mean_place = 0, mean_move = 0, product = 0;
    double squares = 0;
    struct srv_speed d = { 0, 0 };
    for (int i = 0; i < CORNERS; i++) {
        double point[3];
        corner_of(&before, i, point);
        place[i] = project(&before, point);
        move[i] = project(&after, point) - place[i];
        mean_place += place[i] / CORNERS;
        mean_move += move[i] / CORNERS;
        d.motion += cabs(move[i]) / CORNERS;
    }
    for (int i = 0; i < CORNERS; i++) {
        const double complex z = place[i] - mean_place;
        product += conj(z) * (move[i] - mean_move);
        squares += creal(z) * creal(z) + cimag(z) * cimag(z);
    }
    const double complex slope = squares > 0 ? product / squares : 0;
    for (int i = 0; i < CORNERS; i++)
        d.parallax += cabs(move[i] - mean_move - slope * (place[i] - mean_place)) / CORNERS;
    return d;
}

double srv_motion_between(const struct sp_camera *from, const struct sp_camera *to) {
    return displacement(from, to).motion;
}

double srv_motion_height(const struct sp_camera *camera) {
    const struct basis b = basis_of(camera);
    return b.height * (b.is_perspective ? b.distance : 1);
}

static bool is_same(const struct sp_camera *a, const struct sp_camera *b) {
    bool is_same = a->projection == b->projection && a->fov_y == b->fov_y && a->height == b->height;
    for (int i = 0; i < 3; i++)
        is_same = is_same && a->position[i] == b->position[i] && a->target[i] == b->target[i] &&
                  a->up[i] == b->up[i];
    return is_same;
}

void srv_motion_update(struct srv_motion *motion, const struct sp_camera *camera, double now_ms) {
    const bool is_first = motion->at_ms == 0;
    const double since_ms = now_ms - motion->at_ms;
    if (!is_first && is_same(&motion->camera, camera))
        return;
    if (!is_first)
        motion->moved_ms = now_ms;
    if (!is_first && since_ms < LEAST_MS)
        return;
    if (!is_first && since_ms < PAUSE_MS) {
        const struct srv_speed moved = displacement(&motion->camera, camera);
        struct srv_speed *mean = &motion->speed;
        const double weight = mean->motion > 0 ? 1 - exp(-since_ms / SMOOTH_MS) : 1;
        mean->motion += (moved.motion * 1000 / since_ms - mean->motion) * weight;
        mean->parallax += (moved.parallax * 1000 / since_ms - mean->parallax) * weight;
    }
    motion->camera = *camera;
    motion->at_ms = now_ms;
}

bool srv_motion_speed(const struct srv_motion *motion, double now_ms, struct srv_speed *speed) {
    *speed = motion->speed.motion > 0 ? motion->speed : SRV_MOTION_NOMINAL;
    return motion->moved_ms > 0 && now_ms - motion->moved_ms < MOVES_MS;
}
