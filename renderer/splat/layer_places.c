/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/layer_places.h"

#include <math.h>

#include "data/volume/grid.h"

/* A ray within this sine of the plane of the sheets counts as if it were not nearer. */
static const float flat = 0.02f;

void sp_layer_places_init_sheets(struct sp_layer_places *places,
                                 const struct sp_camera_transform *camera,
                                 const struct sp_grid *grid, unsigned axis, float *d) {
    const unsigned u = (axis + 1) % 3, v = (axis + 2) % 3;
    struct sp_vec3 column[3];
    for (unsigned a = 0; a < 3; a++)
        column[a] = (struct sp_vec3){ { grid->direction[0][a], grid->direction[1][a],
                                        grid->direction[2][a] } };
    const struct sp_vec3 normal = sp_vec3_normalize(sp_vec3_cross(column[u], column[v]));
    const struct sp_vec3 to_origin = sp_vec3_sub(sp_vec3_from(grid->origin), camera->eye);
    for (uint32_t i = 0; i < grid->dims[axis]; i++)
        d[i] = (float)(sp_vec3_dot(normal, to_origin) +
                       sp_grid_distance(grid, axis, i) * sp_vec3_dot(normal, column[axis]));
    *places = (struct sp_layer_places){ .camera = camera, .are_sheets = true };
    for (int r = 0; r < 3; r++)
        places->normal[r] = sp_vec3_dot(sp_vec3_from(camera->w.m[r]), normal);
}

static inline float away_from_zero(float x) {
    return fabsf(x) < flat ? copysignf(flat, x) : x;
}

static void places_of_sheets(const struct sp_layer_places *places, float right, float down,
                             int count, float *base, float *factor) {
    const struct sp_camera_transform *camera = places->camera;
    const float scale = 1 / (float)camera->scale, step = (float)places->normal[0] * scale;
    const float aside = (float)places->normal[1] * scale * down + step * right;
    const float ahead = (float)places->normal[2];
    const bool is_flat = camera->projection == SP_ORTHOGRAPHIC;
    for (int i = 0; i < count; i++) {
        const float across = aside + step * (float)i;
        factor[i] = 1 / away_from_zero(is_flat ? ahead : ahead + across);
        base[i] = is_flat ? -across * factor[i] : 0;
    }
}

void sp_layer_places_row(const struct sp_layer_places *places, int x, int y, int count, float *base,
                         float *factor) {
    const struct sp_camera_transform *camera = places->camera;
    const float right = (float)(x + 0.5 - camera->centre[0]);
    const float down = (float)(y + 0.5 - camera->centre[1]);
    const float scale = camera->projection == SP_PERSPECTIVE ? 1 / (float)camera->scale : 0;
    if (places->are_sheets) {
        places_of_sheets(places, right, down, count, base, factor);
        return;
    }
    for (int i = 0; i < count; i++) {
        const float u = (right + (float)i) * scale, v = down * scale;
        base[i] = 0;
        factor[i] = 1 / sqrtf(1 + u * u + v * v);
    }
}
