/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "data/volume/grid.h"
#include "draw/postconv/insert.h"
#include "splat/camera.h"

/* Fills how many slices lie in front of a point of camera space: offset + normal·u. */
static void compute_normal(const struct sp_camera_transform *camera, const struct sp_grid *grid,
                           unsigned axis, double normal[3], double *offset) {
    double det;
    struct sp_mat3 d = sp_grid_steps(grid, 1);
    struct sp_vec3 row = sp_vec3_from(sp_mat3_inverse(&d, &det).m[axis]);
    *offset = sp_vec3_dot(row, sp_vec3_sub(camera->eye, sp_vec3_from(grid->origin))) + 0.5;
    for (int r = 0; r < 3; r++)
        normal[r] = sp_vec3_dot(sp_vec3_from(camera->w.m[r]), row);
}

/* Fills where slices begin; several may share a layer. */
static void fill_begins(const struct sp_postconv *postconv, uint32_t count, float (*begin)[2]) {
    for (uint32_t first = 0, end; first < count; first = end) {
        const uint32_t last = count - 1;
        const uint32_t *layer = postconv->layer;
        const uint32_t own = layer[postconv->is_backwards ? last - first : first];
        for (end = first + 1; end < count; end++)
            if (layer[postconv->is_backwards ? last - end : end] != own)
                break;
        const float each = 1 / (float)(end - first);
        for (uint32_t k = first; k < end; k++) {
            begin[k][0] = (float)own + (float)(k - first) * each;
            begin[k][1] = each;
        }
    }
}

const struct sp_postconv_insert *sp_postconv_insert_create(const struct sp_postconv_input *input,
                                                           const struct sp_postconv *postconv) {
    const struct sp_camera_transform *camera = input->camera;
    const uint32_t count = input->grid->dims[postconv->axis];
    const double sign = postconv->is_backwards ? -1 : 1;
    double normal[3], offset;
    struct sp_postconv_insert *insert =
        sp_arena_alloc(input->arena, "fragments of sheets", 1, sizeof *insert);
    float(*begin)[2] = sp_arena_alloc(input->arena, "places of slices", count, sizeof *begin);
    if (input->arena->failed)
        return NULL;
    compute_normal(camera, input->grid, postconv->axis, normal, &offset);
    fill_begins(postconv, count, begin);
    *insert = (struct sp_postconv_insert){
        .fragments = input->fragments,
        .offset = postconv->is_backwards ? count - offset : offset,
        .depth = sign * normal[2],
        .right = sign * normal[0] / camera->scale,
        .down = sign * normal[1] / camera->scale,
        .centre = { camera->centre[0], camera->centre[1] },
        .is_perspective = camera->projection == SP_PERSPECTIVE,
        .slices = count,
        .begin = (const float(*)[2])begin,
    };
    return insert;
}

struct sp_postconv_inserted *sp_postconv_inserted_create(struct sp_arena *arena) {
    return sp_arena_alloc(arena, "fragments of a tile", 1, sizeof(struct sp_postconv_inserted));
}
