/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "base/vec.h"
#include "support/truth.h"

/* Central difference along a grid axis, one-sided at the border [data unit a voxel]. */
static double slope(const struct test_phong *p, const uint32_t i[3], int axis) {
    const uint32_t *dims = p->info->grid.dims;
    size_t stride = axis == 0 ? 1 : axis == 1 ? dims[0] : (size_t)dims[0] * dims[1];
    size_t at = i[0] + dims[0] * (i[1] + (size_t)dims[1] * i[2]), low = at, high = at;
    int gaps = 0;
    if (i[axis] > 0) {
        low -= stride;
        gaps++;
    }
    if (i[axis] + 1 < dims[axis]) {
        high += stride;
        gaps++;
    }
    double rise =
        test_sample(p->voxels, p->info->type, high) - test_sample(p->voxels, p->info->type, low);
    return gaps ? rise / gaps : 0;
}

void test_phong_emission(void *user, const uint32_t i[3], double color[3]) {
    const struct test_phong *p = user;
    const struct sp_grid *grid = &p->info->grid;
    const struct sp_shading *s = &p->view->shading;
    const struct sp_camera *camera = &p->view->camera;
    struct sp_mat3 m, inverse;
    struct sp_vec3 position = sp_vec3_from(grid->origin), g, ahead;
    double w[3][3], det;
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++) {
            m.m[r][a] = grid->direction[r][a] * grid->spacing[a];
            position.v[r] += m.m[r][a] * i[a];
        }
    /* The gradient is covariant: ∇_world = M⁻ᵀ ∇_index. */
    inverse = sp_mat3_inverse(&m, &det);
    inverse = sp_mat3_transpose(&inverse);
    for (int a = 0; a < 3; a++)
        g.v[a] = slope(p, i, a);
    struct sp_vec3 normal = sp_vec3_normalize(sp_mat3_apply(&inverse, g));
    bool sided = sp_vec3_length(normal) > 0;
    test_camera_axes(camera, w);
    ahead = sp_vec3_from(w[2]);
    if (camera->projection == SP_PERSPECTIVE)
        ahead = sp_vec3_normalize(sp_vec3_sub(position, sp_vec3_from(camera->position)));
    double diffuse[3] = { 0 }, specular[3] = { 0 };
    for (uint32_t l = 0; l < s->light_count; l++) {
        const double *d = s->lights[l].direction;
        struct sp_vec3 light = sp_vec3_from(d);
        if (s->lights[l].space == SP_LIGHT_CAMERA)
            for (int c = 0; c < 3; c++)
                light.v[c] = d[0] * w[0][c] - d[1] * w[1][c] - d[2] * w[2][c];
        light = sp_vec3_normalize(light);
        struct sp_vec3 half = sp_vec3_normalize(sp_vec3_sub(light, ahead));
        double nl = sided ? fabs(sp_vec3_dot(normal, light)) : 1;
        double nh = fabs(sp_vec3_dot(normal, half));
        for (int c = 0; c < 3; c++) {
            diffuse[c] += nl * (double)s->lights[l].color[c];
            specular[c] += (sided ? pow(nh, s->exponent) : 0) * (double)s->lights[l].color[c];
        }
    }
    for (int c = 0; c < 3; c++)
        color[c] =
            fmin(color[c] * (s->ambient + s->diffuse * diffuse[c]) + s->specular * specular[c], 1);
}
