/* SPDX-License-Identifier: Apache-2.0 */
#include "support/sample.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "data/volume/grid.h"

double test_sample(const void *voxels, enum sp_type type, size_t index) {
    switch (type) {
    case SP_UINT8:
        return ((const uint8_t *)voxels)[index];
    case SP_INT8:
        return ((const int8_t *)voxels)[index];
    case SP_UINT16:
        return ((const uint16_t *)voxels)[index];
    case SP_INT16:
        return ((const int16_t *)voxels)[index];
    case SP_INT32:
        return ((const int32_t *)voxels)[index];
    case SP_FLOAT32:
        return (double)((const float *)voxels)[index];
    case SP_FLOAT64:
        return ((const double *)voxels)[index];
    case SP_TYPE_COUNT:
        break;
    }
    assert(!"unknown sample type");
    return 0;
}

size_t test_sample_index(const struct sp_grid *grid, const uint32_t i[3]) {
    return i[0] + grid->dims[0] * (i[1] + (size_t)grid->dims[1] * i[2]);
}

void test_sample_place(const struct sp_grid *grid, const uint32_t i[3], double world[3]) {
    for (int r = 0; r < 3; r++) {
        world[r] = grid->origin[r];
        for (unsigned a = 0; a < 3; a++)
            world[r] += grid->direction[r][a] * sp_grid_distance(grid, a, i[a]);
    }
}

static double slope(const struct sp_volume_info *info, const void *voxels, const uint32_t i[3],
                    unsigned axis) {
    const struct sp_grid *grid = &info->grid;
    double f[2], at[2];
    for (int side = 0; side < 2; side++) {
        uint32_t j[3] = { i[0], i[1], i[2] };
        if (side && i[axis] + 1 < grid->dims[axis])
            j[axis]++;
        if (!side && i[axis] > 0)
            j[axis]--;
        f[side] = test_sample(voxels, info->type, test_sample_index(grid, j));
        if (!isfinite(f[side])) {
            j[axis] = i[axis];
            f[side] = test_sample(voxels, info->type, test_sample_index(grid, j));
        }
        at[side] = sp_grid_distance(grid, axis, j[axis]);
    }
    return at[1] > at[0] ? (f[1] - f[0]) / (at[1] - at[0]) : 0;
}

void test_gradient(const struct sp_volume_info *info, const void *voxels, const uint32_t i[3],
                   double gradient[3]) {
    struct sp_mat3 direction;
    struct sp_vec3 along;
    double det;
    memcpy(direction.m, info->grid.direction, sizeof direction.m);
    for (unsigned a = 0; a < 3; a++)
        along.v[a] = slope(info, voxels, i, a);
    /* A gradient is covariant: it transforms with the transpose of the inverse. */
    direction = sp_mat3_inverse(&direction, &det);
    direction = sp_mat3_transpose(&direction);
    along = sp_mat3_apply(&direction, along);
    memcpy(gradient, along.v, sizeof along.v);
}

static double gradient_scale(const struct sp_transfer_function *tf, double magnitude) {
    const struct sp_gradient_point *p = tf->gradient, *last = p + tf->gradient_count - 1;
    if (!tf->gradient_count)
        return 1;
    if (magnitude <= p->magnitude)
        return (double)p->scale;
    while (p < last && p[1].magnitude < magnitude)
        p++;
    if (p == last)
        return (double)p->scale;
    double f = (magnitude - p->magnitude) / (p[1].magnitude - p->magnitude);
    return (1 - f) * (double)p->scale + f * (double)p[1].scale;
}

void test_classify(const struct sp_transfer_function *tf, double value, double magnitude,
                   double color[3], double *opacity) {
    const struct sp_tf_point *p = tf->points, *q = p;
    double f = 0;
    uint32_t last = tf->point_count - 1;
    if (value >= p[last].value) {
        p = q = p + last;
    } else if (value > p->value) {
        while (q->value <= value)
            q++;
        p = q - 1;
        f = (value - p->value) / (q->value - p->value);
    }
    for (int c = 0; c < 3; c++)
        color[c] = (1 - f) * (double)p->color[c] + f * (double)q->color[c];
    *opacity = (1 - f) * (double)p->opacity + f * (double)q->opacity;
    *opacity *= gradient_scale(tf, magnitude);
}

bool test_needs_gradient(const struct sp_view *view) {
    return view->shading.mode == SP_SHADING_PHONG || view->transfer_function.gradient_count > 0;
}

void test_camera_axes(const struct sp_camera *camera, double w[3][3]) {
    struct sp_vec3 forward = sp_vec3_normalize(
        sp_vec3_sub(sp_vec3_from(camera->target), sp_vec3_from(camera->position)));
    struct sp_vec3 right = sp_vec3_normalize(sp_vec3_cross(forward, sp_vec3_from(camera->up)));
    struct sp_vec3 down = sp_vec3_cross(forward, right);
    memcpy(w[0], right.v, sizeof right.v);
    memcpy(w[1], down.v, sizeof down.v);
    memcpy(w[2], forward.v, sizeof forward.v);
}

double test_camera_scale(const struct sp_view *view) {
    const struct sp_camera *camera = &view->camera;
    return camera->projection == SP_PERSPECTIVE
               ? 0.5 * view->size[1] / tan(camera->fov_y * M_PI / 360)
               : view->size[1] / camera->height;
}

void test_light_direction(const struct sp_view *view, uint32_t l, double world[3]) {
    const struct sp_light *light = &view->shading.lights[l];
    const double *d = light->direction;
    struct sp_vec3 towards = sp_vec3_from(d);
    double w[3][3];
    test_camera_axes(&view->camera, w);
    if (light->space == SP_LIGHT_CAMERA)
        for (int c = 0; c < 3; c++)
            towards.v[c] = d[0] * w[0][c] - d[1] * w[1][c] - d[2] * w[2][c];
    towards = sp_vec3_normalize(towards);
    memcpy(world, towards.v, sizeof towards.v);
}

void test_shade_shares(const struct sp_view *view, const double ahead[3], const double gradient[3],
                       const double share[2], double color[3]) {
    const struct sp_shading *s = &view->shading;
    double diffuse[3] = { 0 }, specular[3] = { 0 };
    if (s->mode != SP_SHADING_PHONG)
        return;
    struct sp_vec3 normal = sp_vec3_normalize(sp_vec3_from(gradient));
    bool sided = sp_vec3_length(normal) > 0;
    for (uint32_t l = 0; l < s->light_count; l++) {
        struct sp_vec3 light;
        test_light_direction(view, l, light.v);
        struct sp_vec3 half = sp_vec3_normalize(sp_vec3_sub(light, sp_vec3_from(ahead)));
        double arrives = l == 0 ? share[1] : 1;
        double nl = sided ? fabs(sp_vec3_dot(normal, light)) : 1;
        double nh = sided ? pow(fabs(sp_vec3_dot(normal, half)), s->exponent) : 0;
        for (int c = 0; c < 3; c++) {
            diffuse[c] += arrives * nl * (double)s->lights[l].color[c];
            specular[c] += arrives * nh * (double)s->lights[l].color[c];
        }
    }
    for (int c = 0; c < 3; c++)
        color[c] = color[c] * share[0] * (s->ambient + s->diffuse * diffuse[c]) +
                   s->specular * specular[c];
}

void test_shade(const struct sp_view *view, const double ahead[3], const double gradient[3],
                double color[3]) {
    test_shade_shares(view, ahead, gradient, (const double[]){ 1, 1 }, color);
}
