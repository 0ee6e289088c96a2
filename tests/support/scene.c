/* SPDX-License-Identifier: Apache-2.0 */
#include "support/scene.h"

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/vec.h"
#include "data/volume/grid.h"

void test_view_init(struct sp_view *view) {
    *view = (struct sp_view){
        .size = { 64, 64 },
        .camera = { .projection = SP_PERSPECTIVE,
                    .position = { 0, 0, -100 },
                    .up = { 0, -1, 0 },
                    .fov_y = 30,
                    .height = 50,
                    .near = 0.1 },
        .transfer_function = { .reference_length = 1,
                               .order = SP_TF_PRE,
                               .point_count = 2,
                               .points = { { 0, { 1, 1, 1 }, 0 }, { 1, { 1, 1, 1 }, 0.1F } } },
        .filter = { .mode = SP_FILTER_EWA,
                    .kernel = SP_KERNEL_GAUSSIAN,
                    .sigma = 0.7,
                    .cutoff = 3,
                    .lowpass = 1,
                    .c_min = 0.07,
                    .c_max = NAN },
        .compositing = { .mode = SP_COMPOSITE_SHEET,
                         .attenuation = SP_ATTENUATION_EXPONENTIAL,
                         .center = NAN,
                         .width = NAN,
                         .zero = NAN,
                         .absorption = NAN,
                         .slab = 1 },
        .shading = { .mode = SP_SHADING_NONE,
                     .ambient = 0.3,
                     .diffuse = 0.7,
                     .specular = 0.2,
                     .exponent = 20,
                     .reach = 0.2,
                     .smoothing = NAN,
                     .light_count = 1,
                     .lights = { { .direction = { 0, 0, 1 }, .color = { 1, 1, 1 } } } },
        .layer_count = 1,
        .layers = { { .type = SP_LAYER_VOLUME, .visible = true } },
        .clip = { .box = { { 0, 0, 0 }, { 1, 1, 1 } } },
        .slices = { .normal = { 0, 0, 1 }, .width = 1 },
        .level_of_detail = SP_LOD_AUTO,
    };
}

static void store(void *voxels, enum sp_type type, size_t i, double v) {
    static const double low[SP_TYPE_COUNT] = { 0,         INT8_MIN, 0,       INT16_MIN,
                                               INT32_MIN, -FLT_MAX, -DBL_MAX };
    static const double high[SP_TYPE_COUNT] = { UINT8_MAX, INT8_MAX, UINT16_MAX, INT16_MAX,
                                                INT32_MAX, FLT_MAX,  DBL_MAX };
    v = fmin(fmax(v, low[type]), high[type]);
    switch (type) {
    case SP_UINT8:
        ((uint8_t *)voxels)[i] = (uint8_t)lround(v);
        break;
    case SP_INT8:
        ((int8_t *)voxels)[i] = (int8_t)lround(v);
        break;
    case SP_UINT16:
        ((uint16_t *)voxels)[i] = (uint16_t)lround(v);
        break;
    case SP_INT16:
        ((int16_t *)voxels)[i] = (int16_t)lround(v);
        break;
    case SP_INT32:
        ((int32_t *)voxels)[i] = (int32_t)lround(v);
        break;
    case SP_FLOAT32:
        ((float *)voxels)[i] = (float)v;
        break;
    case SP_FLOAT64:
        ((double *)voxels)[i] = v;
        break;
    case SP_TYPE_COUNT:
        break;
    }
}

static void centre(struct sp_grid *grid) {
    for (int r = 0; r < 3; r++) {
        grid->origin[r] = 0;
        for (int a = 0; a < 3; a++)
            grid->origin[r] -=
                0.5 * grid->direction[r][a] * grid->spacing[a] * (grid->dims[a] - 1.0);
    }
}

/* Sets everything except the values of the samples. */
static bool describe(struct test_scene *scene, const char *name, const uint32_t dims[3],
                     const double spacing[3], enum sp_type type) {
    struct sp_volume_info *info = &scene->info;
    *info = (struct sp_volume_info){ .type = type, .components = 1 };
    memset(scene->coordinates, 0, sizeof scene->coordinates);
    snprintf(info->name, sizeof info->name, "%s", name);
    for (int a = 0; a < 3; a++) {
        info->grid.dims[a] = dims[a];
        info->grid.spacing[a] = spacing[a];
        info->grid.direction[a][a] = 1;
    }
    centre(&info->grid);
    scene->voxels = calloc((size_t)dims[0] * dims[1] * dims[2], sizeof(double));
    return scene->voxels != NULL;
}

bool test_scene_voxels(struct test_scene *scene, const char *name, const uint32_t dims[3],
                       const double spacing[3], enum sp_type type, test_value_fn *value,
                       const void *user) {
    if (!describe(scene, name, dims, spacing, type))
        return false;
    size_t i = 0;
    for (uint32_t z = 0; z < dims[2]; z++)
        for (uint32_t y = 0; y < dims[1]; y++)
            for (uint32_t x = 0; x < dims[0]; x++)
                store(scene->voxels, type, i++, value(user, x, y, z));
    return true;
}

bool test_scene_rectilinear(struct test_scene *scene, const char *name, const uint32_t dims[3],
                            const double *const coordinates[3], enum sp_type type,
                            test_value_fn *value, const void *user) {
    double spacing[3];
    for (int a = 0; a < 3; a++)
        spacing[a] = coordinates[a] ? coordinates[a][dims[a] - 1] / (dims[a] - 1) : 1;
    if (!describe(scene, name, dims, spacing, type))
        return false;
    struct sp_grid *grid = &scene->info.grid;
    for (int a = 0; a < 3; a++) {
        if (!coordinates[a])
            continue;
        scene->coordinates[a] = malloc(dims[a] * sizeof(double));
        if (!scene->coordinates[a])
            return false;
        memcpy(scene->coordinates[a], coordinates[a], dims[a] * sizeof(double));
        grid->coordinates[a] = scene->coordinates[a];
    }
    size_t n = 0;
    uint32_t i[3];
    for (i[2] = 0; i[2] < dims[2]; i[2]++)
        for (i[1] = 0; i[1] < dims[1]; i[1]++)
            for (i[0] = 0; i[0] < dims[0]; i[0]++) {
                double p[3];
                for (unsigned a = 0; a < 3; a++)
                    p[a] = sp_grid_distance(grid, a, i[a]) - 0.5 * spacing[a] * (dims[a] - 1);
                store(scene->voxels, type, n++, value(user, p[0], p[1], p[2]));
            }
    return true;
}

void test_scene_finish(struct test_scene *scene) {
    free(scene->voxels);
    scene->voxels = NULL;
    for (int a = 0; a < 3; a++) {
        free(scene->coordinates[a]);
        scene->coordinates[a] = NULL;
        scene->info.grid.coordinates[a] = NULL;
    }
}

void test_scene_direction(struct test_scene *scene, const double degrees[3], double mirror,
                          double shear) {
    struct sp_mat3 all = { { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, mirror } } };
    for (int a = 0; a < 3; a++) {
        double c = cos(degrees[a] * M_PI / 180), s = sin(degrees[a] * M_PI / 180);
        int p = (a + 1) % 3, q = (a + 2) % 3;
        struct sp_mat3 turn = { { { 0 } } };
        turn.m[a][a] = 1;
        turn.m[p][p] = turn.m[q][q] = c;
        turn.m[p][q] = -s;
        turn.m[q][p] = s;
        all = sp_mat3_multiply(&turn, &all);
    }
    double length = sqrt(1 + shear * shear);
    for (int r = 0; r < 3; r++)
        all.m[r][2] = (all.m[r][2] + shear * all.m[r][0]) / length;
    memcpy(scene->info.grid.direction, all.m, sizeof all.m);
    centre(&scene->info.grid);
}

void test_scene_orbit(struct test_scene *scene, const double *target, double azimuth,
                      double elevation, double distance) {
    struct sp_camera *camera = &scene->view.camera;
    double a = azimuth * M_PI / 180, e = elevation * M_PI / 180;
    double away[3] = { sin(a) * cos(e), sin(e), cos(a) * cos(e) };
    for (int c = 0; c < 3; c++) {
        camera->target[c] = target ? target[c] : 0;
        camera->position[c] = camera->target[c] + distance * away[c];
        camera->up[c] = c == 1;
    }
}

void test_scene_points(struct test_scene *scene, const double (*points)[5], unsigned count) {
    struct sp_transfer_function *tf = &scene->view.transfer_function;
    tf->point_count = count;
    for (unsigned i = 0; i < count; i++)
        tf->points[i] = (struct sp_tf_point){
            points[i][0],
            { (float)points[i][1], (float)points[i][2], (float)points[i][3] },
            (float)points[i][4],
        };
}

void test_scene_cut(struct test_scene *scene, const double normal[3], const double point[3]) {
    struct sp_clip_plane *plane = &scene->view.clip.planes[scene->view.clip.plane_count++];
    plane->offset = 0;
    for (int a = 0; a < 3; a++) {
        plane->normal[a] = normal[a];
        plane->offset += normal[a] * point[a];
    }
}

struct sp_volume *test_scene_volume(const struct test_scene *scene, struct sp_error *err) {
    return sp_volume_create(&scene->info.grid, scene->info.type, scene->voxels, scene->info.name,
                            err);
}
