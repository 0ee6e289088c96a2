/* SPDX-License-Identifier: Apache-2.0 */
#include "support/postconv.h"

#include <stdlib.h>
#include <string.h>

#include "splat/slices.h"

static bool classify(struct test_postconv *t, const struct test_scene *scene,
                     struct sp_error *err) {
    const struct sp_view *view = &scene->view;
    t->axis = sp_slices_major_axis(&t->camera, &scene->info.grid);
    struct sp_classify_job job = { .tf = &view->transfer_function,
                                   .levels = 1,
                                   .axis = t->axis,
                                   .normals = view->shading.mode == SP_SHADING_PHONG ||
                                              view->transfer_function.gradient_count > 0,
                                   .pool = t->pool };
    sp_ewa_frame_init(&t->ewa, &t->camera, &scene->info.grid, view, &view->filter);
    sp_classification_init(&t->classification, t->volume);
    return sp_classification_update(&t->classification, &job, err);
}

static bool choose_modes(struct test_postconv *t, const struct test_scene *scene,
                         struct sp_error *err) {
    struct sp_adaptive adaptive;
    if (scene->view.filter.mode != SP_FILTER_ADAPTIVE)
        return true;
    sp_adaptive_init(&adaptive, &t->camera, &scene->info.grid, &scene->view, &scene->view.filter);
    t->modes = malloc(sp_adaptive_count(&scene->info.grid));
    if (!t->modes)
        return sp_fail(err, SP_ERR_MEMORY, "", "filter modes");
    sp_adaptive_fill(&adaptive, t->modes);
    return true;
}

static bool start(struct test_postconv *t, const struct test_scene *scene, unsigned threads,
                  struct sp_error *err) {
    const struct sp_view *view = &scene->view;
    sp_arena_init(&t->arena);
    sp_postconv_tables_init(&t->tables);
    sp_camera_transform_init(&t->camera, &view->camera, view->size);
    sp_shade_init(&t->shade, &t->camera, &view->shading);
    t->pool = sp_pool_create(threads, err);
    t->frames = t->pool ? sp_frame_pool_create(0, err) : NULL;
    if (t->frames)
        t->frame = sp_frame_create(t->frames, view->size[0], view->size[1], SP_RGBAF32, err);
    t->volume = t->frame ? test_scene_volume(scene, err) : NULL;
    t->view = view;
    t->target = t->frame;
    return t->volume && classify(t, scene, err) && choose_modes(t, scene, err);
}

struct test_postconv *test_postconv_open(const struct test_scene *scene, unsigned threads,
                                         struct sp_error *err) {
    struct test_postconv *t = aligned_alloc(64, (sizeof *t + 63) & ~(size_t)63);
    if (!t) {
        sp_fail(err, SP_ERR_MEMORY, "", "post-convolved sheets");
        return NULL;
    }
    memset(t, 0, sizeof *t);
    if (start(t, scene, threads, err))
        return t;
    test_postconv_close(t);
    return NULL;
}

void test_postconv_close(struct test_postconv *t) {
    free(t->modes);
    if (t->classification.volume)
        sp_classification_finish(&t->classification);
    sp_volume_unref(&t->volume);
    sp_frame_unref(&t->frame);
    if (t->frames)
        sp_frame_pool_destroy(&t->frames);
    if (t->pool)
        sp_pool_destroy(&t->pool);
    sp_arena_finish(&t->arena);
    free(t);
}

/* All bricks, of the finest level. */
static bool choose_bricks(struct test_postconv *t) {
    const struct sp_level *level = &t->classification.levels[0];
    uint32_t count = sp_visible_bricks(&level->visible);
    struct sp_detail_brick *bricks = sp_arena_alloc(&t->arena, "bricks", count, sizeof *bricks);
    for (uint32_t i = 0; bricks && i < count; i++)
        bricks[i] = (struct sp_detail_brick){ .brick = i };
    t->detail = (struct sp_detail){ .bricks = bricks, .count = count, .levels = 1 };
    t->parts[0] = (struct sp_level_frame){ .level = level, .ewa[0] = t->ewa, .modes[0] = t->modes };
    return bricks;
}

/* Fills *input for a new frame. */
static bool start_frame(struct test_postconv *t, const atomic_bool *cancel,
                        struct sp_postconv_input *input, struct sp_error *err) {
    bool is_lit = t->view->shading.mode == SP_SHADING_PHONG;
    sp_arena_reset(&t->arena);
    if (!choose_bricks(t))
        return sp_fail(err, SP_ERR_MEMORY, "", "post-convolved sheets");
    memset(&t->target->stats, 0, sizeof t->target->stats);
    *input = (struct sp_postconv_input){ .view = t->view,
                                         .frame = t->target,
                                         .interrupt.cancel = cancel,
                                         .tables = &t->tables,
                                         .camera = &t->camera,
                                         .shade = is_lit ? &t->shade : NULL,
                                         .grid = &t->classification.levels[0].grid,
                                         .parts = t->parts,
                                         .detail = &t->detail,
                                         .axis = t->axis,
                                         .pool = t->pool,
                                         .arena = &t->arena };
    return true;
}

bool test_postconv_draw(struct test_postconv *t, sp_postconv_tile_fn *tile,
                        const atomic_bool *cancel, struct sp_error *err) {
    struct sp_postconv_input input;
    struct sp_postconv postconv;
    if (!start_frame(t, cancel, &input, err))
        return false;
    input.draw_tile = tile;
    return sp_postconv_prepare(&input, &postconv, err) && sp_postconv_draw(&input, &postconv, err);
}
