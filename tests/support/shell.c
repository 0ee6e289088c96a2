/* SPDX-License-Identifier: Apache-2.0 */
#include "support/shell.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "data/volume/grid.h"
#include "data/volume/sample.h"

void test_shell_open(struct test_shell *rig, struct test_scene *scene, unsigned threads) {
    *rig = (struct test_shell){ .scene = *scene,
                                .kernels = { sp_voxel_set_up, sp_voxel_start, sp_voxel_add,
                                             sp_voxel_resolve, sp_voxel_merge },
                                .layer = sp_layer_default(SP_LAYER_SHELL) };
    struct sp_error err = { 0 };
    *scene = (struct test_scene){ 0 };
    for (int a = 0; a < 3; a++)
        if (rig->scene.coordinates[a])
            rig->scene.info.grid.coordinates[a] = rig->scene.coordinates[a];
    rig->volume = test_scene_volume(&rig->scene, &err);
    if (!rig->volume)
        fail_msg("%s", err.text);
    rig->pool = sp_pool_create(threads, NULL);
    assert_non_null(rig->pool);
    sp_arena_init(&rig->arena);
}

void test_shell_close(struct test_shell *rig) {
    sp_shell_evict(&rig->cache, NULL);
    sp_vectors_evict(&rig->vectors, NULL);
    sp_arena_finish(&rig->arena);
    sp_pool_destroy(&rig->pool);
    sp_volume_unref(&rig->volume);
    test_scene_finish(&rig->scene);
}

void test_shell_add_vectors(struct test_shell *rig,
                            void (*vector_at)(const void *user, const double at[3], float v[3]),
                            const void *user) {
    const struct sp_volume_info *info = &rig->scene.info;
    const uint32_t *dims = info->grid.dims;
    float(*vectors)[3] = calloc((size_t)dims[0] * dims[1] * dims[2], sizeof *vectors);
    assert_non_null(vectors);
    size_t n = 0;
    for (uint32_t z = 0; z < dims[2]; z++)
        for (uint32_t y = 0; y < dims[1]; y++)
            for (uint32_t x = 0; x < dims[0]; x++, n++)
                vector_at(user, (const double[3]){ x, y, z }, vectors[n]);
    sp_volume_unref(&rig->volume);
    rig->volume = sp_volume_create_vectors(&info->grid, info->type, rig->scene.voxels,
                                           (const float(*)[3])vectors, "vectors", NULL);
    assert_non_null(rig->volume);
    free(vectors);
}

static const struct sp_voxel_list *get_list(struct test_shell *rig, struct sp_interrupt interrupt) {
    const struct sp_vectors_job vectors = { .volume = rig->volume,
                                            .tf = &rig->scene.view.transfer_function,
                                            .clip = &rig->scene.view.clip,
                                            .density = rig->layer.density,
                                            .bytes_max = 1 << 28,
                                            .pool = rig->pool,
                                            .interrupt = interrupt };
    const struct sp_shell_job shell = test_shell_job(rig);
    struct sp_error err;
    const struct sp_voxel_list *list =
        rig->layer.type == SP_LAYER_VECTORS
            ? sp_vectors_cache_get(&rig->vectors, rig->volume, &vectors, &err)
            : sp_shell_cache_get(&rig->cache, &shell, &err);
    if (!list)
        fail_msg("%s", err.text);
    return list;
}

const struct sp_voxel_input *test_shell_start(struct test_shell *rig, struct sp_frame *frame) {
    const struct sp_view *view = &rig->scene.view;
    bool is_lit = view->shading.mode == SP_SHADING_PHONG;
    bool keeps_hidden = rig->input.keeps_hidden;
    struct sp_interrupt interrupt = rig->input.interrupt;
    sp_arena_reset(&rig->arena);
    sp_camera_transform_init(&rig->camera, &view->camera, view->size);
    if (is_lit)
        sp_shade_init(&rig->shade, &rig->camera, &view->shading);
    rig->input = (struct sp_voxel_input){ .view = view,
                                          .layer = &rig->layer,
                                          .grid = &sp_volume_info(rig->volume)->grid,
                                          .list = get_list(rig, interrupt),
                                          .frame = frame,
                                          .camera = &rig->camera,
                                          .shade = is_lit ? &rig->shade : NULL,
                                          .kernels = &rig->kernels,
                                          .interrupt = interrupt,
                                          .keeps_hidden = keeps_hidden,
                                          .pool = rig->pool,
                                          .arena = &rig->arena };
    return &rig->input;
}

struct sp_shell_job test_shell_job(const struct test_shell *rig) {
    return (struct sp_shell_job){ .volume = rig->volume,
                                  .tf = &rig->scene.view.transfer_function,
                                  .low = rig->layer.low,
                                  .high = rig->layer.high,
                                  .clip = &rig->scene.view.clip,
                                  .bytes_max = 1 << 28,
                                  .pool = rig->pool,
                                  .interrupt = rig->input.interrupt };
}

bool test_shell_draw(struct test_shell *rig, struct test_image *image, struct sp_error *err) {
    const uint32_t *size = rig->scene.view.size;
    struct sp_frame_pool *frames = sp_frame_pool_create(0, NULL);
    assert_non_null(frames);
    struct sp_frame *frame = sp_frame_create(frames, size[0], size[1], SP_RGBAF32, NULL);
    assert_non_null(frame);
    bool ok = sp_voxel_draw(test_shell_start(rig, frame), err);
    if (ok)
        assert_true(test_image_from_frame(image, frame));
    sp_frame_unref(&frame);
    sp_frame_pool_destroy(&frames);
    return ok;
}

static void resolve_tile(const struct test_shell *rig, const struct sp_fragment_tile *tile,
                         struct test_image *image) {
    const float *background = rig->scene.view.background;
    for (int p = 0; p < SP_FRAGMENT_PIXELS; p++) {
        unsigned x = (unsigned)(tile->x + p % SP_FRAGMENT_TILE);
        unsigned y = (unsigned)(tile->y + p / SP_FRAGMENT_TILE);
        float rgbt[4] = { 0, 0, 0, 1 };
        if (x >= image->width || y >= image->height)
            continue;
        for (int i = 0; i < tile->count[p]; i++)
            sp_fragment_over(&tile->list[p][i], rgbt);
        double *out = test_image_at(image, x, y);
        for (int c = 0; c < 3; c++)
            out[c] = (double)(rgbt[c] + rgbt[3] * background[c] * background[3]);
        out[3] = (double)(1 - rgbt[3] + rgbt[3] * background[3]);
    }
}

bool test_shell_draw_fragments(struct test_shell *rig, struct test_image *image,
                               struct sp_error *err) {
    const uint32_t *size = rig->scene.view.size;
    struct sp_fragment_tile *tile = malloc(sizeof *tile);
    struct sp_voxel_layer shell;
    assert_non_null(tile);
    assert_true(test_image_init(image, size[0], size[1]));
    bool ok = sp_voxel_prepare(test_shell_start(rig, NULL), &shell, err);
    for (int t = 0; ok && t < shell.columns * shell.rows; t++) {
        int column = t % shell.columns, row = t / shell.columns;
        sp_fragment_tile_clear(tile, column * SP_FRAGMENT_TILE, row * SP_FRAGMENT_TILE);
        sp_voxel_tile(&shell, column, row, tile);
        resolve_tile(rig, tile, image);
    }
    free(tile);
    return ok;
}

static double distance(const struct test_shell *rig, unsigned a, uint32_t i) {
    return sp_grid_distance(&rig->scene.info.grid, a, i);
}

/* True if clipping removes a voxel: its centre is outside. */
static bool is_clipped(const struct test_shell *rig, const uint32_t i[3]) {
    const struct sp_clip *clip = &rig->scene.view.clip;
    const struct sp_grid *grid = &rig->scene.info.grid;
    for (unsigned a = 0; a < 3; a++) {
        double extent[2];
        sp_grid_extent(grid, a, extent);
        double at = (distance(rig, a, i[a]) - extent[0]) / (extent[1] - extent[0]);
        if (at < clip->box[0][a] || at > clip->box[1][a])
            return true;
    }
    for (uint32_t p = 0; p < clip->plane_count; p++) {
        double sum = -clip->planes[p].offset;
        for (int r = 0; r < 3; r++) {
            double world = grid->origin[r];
            for (unsigned a = 0; a < 3; a++)
                world += grid->direction[r][a] * distance(rig, a, i[a]);
            sum += clip->planes[p].normal[r] * world;
        }
        if (sum < 0)
            return true;
    }
    return false;
}

/* The optical depth of voxel i over the reference length, 0 beyond the border. */
static float depth_at(const struct test_shell *rig, const int64_t i[3]) {
    const uint32_t *dims = rig->scene.info.grid.dims;
    for (int a = 0; a < 3; a++)
        if (i[a] < 0 || i[a] >= dims[a])
            return 0;
    const uint32_t at[3] = { (uint32_t)i[0], (uint32_t)i[1], (uint32_t)i[2] };
    const struct sp_transfer_function *tf = &rig->scene.view.transfer_function;
    struct sp_class class;
    if (is_clipped(rig, at))
        return 0;
    sp_transfer_function_eval(tf,
                              sp_sample(rig->scene.voxels, rig->scene.info.type,
                                        ((uint64_t)at[2] * dims[1] + at[1]) * dims[0] + at[0]),
                              &class);
    double gradient[3];
    if (tf->gradient_count && class.depth > 0) {
        struct sp_gradient_grid grid;
        sp_gradient_grid_init(&grid, rig->volume);
        sp_gradient_at(&grid, at, gradient);
        float scale = (float)sp_transfer_function_scale(
            tf, sp_gradient_magnitude(&grid, sp_gradient_pack(&grid, gradient)));
        if (scale < 1)
            return -log1pf(scale * expm1f(-class.depth));
    }
    return class.depth;
}

static bool reaches(float depth, double threshold) {
    return threshold < 1 && depth >= (float)-log1p(-threshold);
}

int *test_shell_codes(const struct test_shell *rig) {
    const uint32_t *dims = rig->scene.info.grid.dims;
    int *codes = malloc((size_t)dims[0] * dims[1] * dims[2] * sizeof *codes);
    assert_non_null(codes);
    size_t n = 0;
    for (int64_t z = 0; z < dims[2]; z++)
        for (int64_t y = 0; y < dims[1]; y++)
            for (int64_t x = 0; x < dims[0]; x++, n++) {
                const int64_t i[3] = { x, y, z };
                float own = depth_at(rig, i);
                int code = reaches(own, rig->layer.high) ? SP_VOXEL_OPAQUE : 0;
                for (int side = 0; side < 6; side++) {
                    int64_t j[3] = { x, y, z };
                    j[side / 2] += side % 2 ? 1 : -1;
                    if (reaches(depth_at(rig, j), rig->layer.high))
                        code |= 1 << side;
                }
                bool is_in = own > 0 && reaches(own, rig->layer.low) && (code & 63) != 63;
                codes[n] = is_in ? code : -1;
            }
    return codes;
}

struct test_ray test_shell_ray(const struct test_shell *rig, double x, double y) {
    const struct sp_camera_transform *c = &rig->camera;
    const struct sp_grid *grid = &rig->scene.info.grid;
    const double u = (x - c->centre[0]) / c->scale, v = (y - c->centre[1]) / c->scale;
    bool is_perspective = c->projection == SP_PERSPECTIVE;
    struct sp_mat3 d;
    double det;
    struct sp_vec3 origin, direction;
    for (int r = 0; r < 3; r++) {
        double aside = c->w.m[0][r] * u + c->w.m[1][r] * v;
        origin.v[r] = c->eye.v[r] + (is_perspective ? 0 : aside) - grid->origin[r];
        direction.v[r] = c->w.m[2][r] + (is_perspective ? aside : 0);
        for (int a = 0; a < 3; a++)
            d.m[r][a] = grid->direction[r][a];
    }
    struct sp_mat3 inverse = sp_mat3_inverse(&d, &det);
    origin = sp_mat3_apply(&inverse, origin);
    direction = sp_mat3_apply(&inverse, direction);
    return (struct test_ray){ { origin.v[0], origin.v[1], origin.v[2] },
                              { direction.v[0], direction.v[1], direction.v[2] } };
}

/* The ends of a voxel's cell along an axis. */
static void compute_cell(const struct test_shell *rig, unsigned a, uint32_t i, double ends[2]) {
    const struct sp_grid *grid = &rig->scene.info.grid;
    double extent[2], own = distance(rig, a, i);
    sp_grid_extent(grid, a, extent);
    ends[0] = i > 0 ? 0.5 * (own + distance(rig, a, i - 1)) : extent[0];
    ends[1] = i + 1 < grid->dims[a] ? 0.5 * (own + distance(rig, a, i + 1)) : extent[1];
}

bool test_shell_hit(const struct test_shell *rig, const struct test_ray *ray, const uint32_t i[3],
                    double t[2]) {
    t[0] = rig->camera.projection == SP_PERSPECTIVE ? rig->camera.near : -INFINITY;
    t[1] = INFINITY;
    for (unsigned a = 0; a < 3; a++) {
        double ends[2];
        compute_cell(rig, a, i[a], ends);
        double s[2] = { (ends[0] - ray->origin[a]) / ray->direction[a],
                        (ends[1] - ray->origin[a]) / ray->direction[a] };
        t[0] = fmax(t[0], fmin(s[0], s[1]));
        t[1] = fmin(t[1], fmax(s[0], s[1]));
    }
    return t[0] < t[1];
}

/* The cell of an axis at a distance from sample 0; −1 beyond the volume. */
static int64_t cell_at(const struct test_shell *rig, unsigned a, double at) {
    for (uint32_t i = 0; i < rig->scene.info.grid.dims[a]; i++) {
        double ends[2];
        compute_cell(rig, a, i, ends);
        if (at >= ends[0] && at < ends[1])
            return i;
    }
    return -1;
}

static int64_t march(const struct test_shell *rig, const int *codes, const struct test_ray *ray) {
    const uint32_t *dims = rig->scene.info.grid.dims;
    double begin = rig->camera.near, end = INFINITY;
    for (unsigned a = 0; a < 3; a++) {
        double extent[2];
        sp_grid_extent(&rig->scene.info.grid, a, extent);
        double s[2] = { (extent[0] - ray->origin[a]) / ray->direction[a],
                        (extent[1] - ray->origin[a]) / ray->direction[a] };
        begin = fmax(begin, fmin(s[0], s[1]));
        end = fmin(end, fmax(s[0], s[1]));
    }
    for (double t = begin + 1e-9; t < end;) {
        uint32_t i[3];
        double inside[2];
        for (unsigned a = 0; a < 3; a++) {
            int64_t cell = cell_at(rig, a, ray->origin[a] + t * ray->direction[a]);
            if (cell < 0)
                return -1;
            i[a] = (uint32_t)cell;
        }
        int64_t n = ((int64_t)i[2] * dims[1] + i[1]) * dims[0] + i[0];
        if (codes[n] >= 0 && codes[n] & SP_VOXEL_OPAQUE)
            return n;
        t = test_shell_hit(rig, ray, i, inside) ? inside[1] + 1e-9 : t + 1e-6;
    }
    return -1;
}

int64_t *test_shell_march(const struct test_shell *rig, const int *codes) {
    const uint32_t *size = rig->scene.view.size;
    int64_t *voxels = malloc((size_t)size[0] * size[1] * sizeof *voxels);
    assert_non_null(voxels);
    for (uint32_t y = 0; y < size[1]; y++)
        for (uint32_t x = 0; x < size[0]; x++) {
            struct test_ray ray = test_shell_ray(rig, x + 0.5, y + 0.5);
            voxels[y * size[0] + x] = march(rig, codes, &ray);
        }
    return voxels;
}
