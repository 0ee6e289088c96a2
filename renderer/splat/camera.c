/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/camera.h"

/* Returns the unit vector of a finite, non-zero vector of any length. */
static struct sp_vec3 unit(struct sp_vec3 a) {
    double largest = fmax(fabs(a.v[0]), fmax(fabs(a.v[1]), fabs(a.v[2])));
    return sp_vec3_normalize(sp_vec3_scale(a, 1 / largest));
}

void sp_camera_transform_init(struct sp_camera_transform *frame, const struct sp_camera *camera,
                              const uint32_t size[2]) {
    struct sp_vec3 to;
    for (int i = 0; i < 3; i++) /* Quartered, so that the difference of two huge values of opposite
                                   sign does not overflow. */
        to.v[i] = camera->target[i] / 4 - camera->position[i] / 4;
    struct sp_vec3 forward = unit(to);
    struct sp_vec3 right = unit(sp_vec3_cross(forward, unit(sp_vec3_from(camera->up))));
    struct sp_vec3 down = sp_vec3_cross(forward, right);
    *frame = (struct sp_camera_transform){ .projection = camera->projection,
                                           .eye = sp_vec3_from(camera->position),
                                           .centre = { 0.5 * size[0], 0.5 * size[1] },
                                           .near = camera->near };
    for (int i = 0; i < 3; i++) {
        frame->w.m[0][i] = right.v[i];
        frame->w.m[1][i] = down.v[i];
        frame->w.m[2][i] = forward.v[i];
    }
    if (camera->projection == SP_ORTHOGRAPHIC) {
        frame->scale = size[1] / camera->height;
        return;
    }
    frame->scale = 0.5 * size[1] / tan(camera->fov_y * (M_PI / 360));
    frame->tan_half[0] = frame->centre[0] / frame->scale;
    frame->tan_half[1] = frame->centre[1] / frame->scale;
}
