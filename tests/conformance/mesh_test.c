/* SPDX-License-Identifier: Apache-2.0
 *
 * Meshes against rays that are intersected with their triangles (support/mesh.h), every backend and
 * instruction set against the reference, and any number of threads.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "support/compare.h"
#include "support/mesh.h"
#include "support/render.h"

struct scene {
    struct sp_elements mesh;
    struct sp_volume *volume;
    struct sp_view view;
};

/* Looks at the origin from azimuth 25° and elevation 30°, the z axis up. */
static void look(struct scene *s, double distance) {
    struct sp_camera *c = &s->view.camera;
    const double azimuth = 25 * M_PI / 180, elevation = 30 * M_PI / 180;
    c->position[0] = distance * cos(elevation) * cos(azimuth);
    c->position[1] = distance * cos(elevation) * sin(azimuth);
    c->position[2] = distance * sin(elevation);
    for (int a = 0; a < 3; a++) {
        c->target[a] = 0;
        c->up[a] = a == 2;
    }
    c->near = 0.1;
}

static void finish(struct scene *s) {
    test_mesh_finish(&s->mesh);
    sp_volume_unref(&s->volume);
}

static void open_scene(struct scene *s, bool is_made) {
    struct sp_error err = { 0 };
    assert_true(is_made);
    s->volume = sp_volume_create_elements(&s->mesh, "mesh", &err);
    if (!s->volume)
        fail_msg("%s", err.text);
    sp_view_init(&s->view, sp_volume_info(s->volume), "mesh");
    s->view.size[0] = s->view.size[1] = 72;
    s->view.background[3] = 0;
    look(s, 40);
}

static void torus(struct scene *s) {
    open_scene(s, test_mesh_torus(&s->mesh, 24, 5, 2.4));
}

static void ball_of_many(struct scene *s) {
    open_scene(s, test_mesh_ball(&s->mesh, 60, 8));
    s->view.layers[0].colors = SP_COLORS_OF_LAYER;
}

static void cube(struct scene *s) {
    open_scene(s, test_mesh_cube(&s->mesh, 9));
}

static void translucent(struct scene *s) {
    torus(s);
    s->view.layers[0].opacity = 0.45f;
}

/* Opacity by vertex: from 0 to 1 along the triangles. */
static void fading(struct scene *s) {
    assert_true(test_mesh_torus(&s->mesh, 24, 5, 2.4));
    for (uint32_t i = 0; i < s->mesh.shape.vertex_count; i++)
        s->mesh.colors[i][3] = s->mesh.colors[i][0];
    open_scene(s, true);
}

/* The mesh has no colours, so the layer's colour is drawn although `colors` is own. The vertices
 * keep their opacities. */
static void plain(struct scene *s) {
    static const double green[3] = { 0.1, 0.7, 0.2 };
    assert_true(test_mesh_torus(&s->mesh, 24, 5, 2.4));
    s->mesh.shape.lacks_colors = true;
    for (uint32_t i = 0; i < s->mesh.shape.vertex_count; i++)
        s->mesh.colors[i][3] = 0.8f;
    open_scene(s, true);
    for (int c = 0; c < 3; c++)
        s->view.layers[0].color[c] = (float)green[c];
}

static void near_by(struct scene *s) {
    torus(s);
    look(s, 9);
    s->view.camera.fov_y = 60;
}

/* The near plane cuts triangles, some of which reach behind the eye. */
static void inside(struct scene *s) {
    open_scene(s, test_mesh_cube(&s->mesh, 9));
    look(s, 2);
    s->view.camera.fov_y = 80;
    s->view.camera.near = 5.5;
}

static void parallel(struct scene *s) {
    torus(s);
    s->view.camera.projection = SP_ORTHOGRAPHIC;
    s->view.camera.height = 18;
    s->view.camera.near = 37;
}

static void cut(struct scene *s) {
    torus(s);
    s->view.clip.plane_count = 1;
    s->view.clip.planes[0] = (struct sp_clip_plane){ { 0.3, -1, 0.4 }, -1.5 };
    s->view.clip.box[0][2] = 0.3;
    s->view.clip.box[1][0] = 0.9;
}

static void turned(struct scene *s) {
    static const double transform[16] = { 0.9, 0.3,  0,   1,   -0.5, 0.7, 0.6, -2,
                                          0.2, -0.4, 1.3, 0.5, 0,    0,   0,   1 };
    torus(s);
    memcpy(s->view.layers[0].transform, transform, sizeof transform);
}

/* Most triangles are smaller than a pixel. */
static void far_away(struct scene *s) {
    open_scene(s, test_mesh_torus(&s->mesh, 60, 5, 2.4));
    look(s, 70);
    s->view.size[0] = s->view.size[1] = 40;
}

/* At silhouettes, pixels have more triangles than are shaded, some of them near others. */
static void fine(struct scene *s) {
    open_scene(s, test_mesh_torus(&s->mesh, 88, 5, 2.4));
    look(s, 14);
}

struct row {
    const char *name;
    void (*make)(struct scene *scene);
    double floor; /* dB, half a decibel below the measured value */
};

static const struct row rows[] = {
    { "torus", torus, 46.7 },       { "ball of many", ball_of_many, 45.7 },
    { "cube", cube, 45.5 },         { "translucent", translucent, 49.9 },
    { "fading", fading, 49.2 },     { "plain", plain, 48.5 },
    { "near", near_by, 47.2 },      { "inside", inside, 46.3 },
    { "parallel", parallel, 44.8 }, { "cut", cut, 46.1 },
    { "turned", turned, 46.4 },     { "far away", far_away, 44.0 },
    { "fine", fine, 48.6 },
};
enum { ROWS = sizeof rows / sizeof rows[0] };

static void open_renderer(struct test_renderer *renderer, const char *isa, unsigned threads) {
    struct sp_error err = { 0 };
    const struct test_target target = { "cpu", isa };
    if (!test_renderer_open(renderer, &target, threads, &err))
        fail_msg("%s", err.text);
}

static void render(const struct test_renderer *renderer, struct scene *s,
                   struct test_image *image) {
    struct sp_error err = { 0 };
    if (!test_render(renderer, s->volume, &s->view, image, &err))
        fail_msg("%s", err.text);
    sp_renderer_evict(renderer->renderer, s->volume);
}

static void images_match_rays(void **state) {
    (void)state;
    struct test_renderer renderer;
    open_renderer(&renderer, "auto", 2);
    for (int i = 0; i < ROWS; i++) {
        struct scene s = { 0 };
        struct test_image got, wanted;
        rows[i].make(&s);
        render(&renderer, &s, &got);
        assert_true(test_mesh_render(&s.mesh, &s.view.layers[0], &s.view,
                                     &sp_volume_info(s.volume)->grid, 8, &wanted));
        double psnr = test_image_psnr(&got, &wanted), mean, variance;
        test_image_statistics(&wanted, 3, &mean, &variance);
        printf("%-14s %6.2f dB\n", rows[i].name, psnr);
        if (!(psnr >= rows[i].floor))
            test_image_dump(rows[i].name, &got, &wanted, 4);
        assert_compare(mean, >, 0.05); /* something is seen */
        assert_compare(psnr, >=, rows[i].floor);
        test_image_finish(&got);
        test_image_finish(&wanted);
        finish(&s);
    }
    test_renderer_close(&renderer);
}

static void backends_match_the_reference(void **state) {
    (void)state;
    struct test_target target;
    struct test_image wanted[ROWS];
    for (unsigned t = 0; test_target_at(t, &target); t++) {
        struct test_renderer renderer;
        if (!test_renderer_open(&renderer, &target, 1, NULL))
            continue;
        for (int i = 0; i < ROWS; i++) {
            struct scene s = { 0 };
            struct test_image got;
            rows[i].make(&s);
            render(&renderer, &s, t ? &got : &wanted[i]);
            finish(&s);
            if (!t)
                continue;
            double psnr = test_image_psnr(&got, &wanted[i]);
            printf("%-14s %-11s %-8s %6.2f dB\n", rows[i].name, target.backend, target.isa, psnr);
            assert_compare(psnr, >=, strcmp(target.backend, "cpu") == 0 ? 70 : 69);
            test_image_finish(&got);
        }
        test_renderer_close(&renderer);
    }
    for (int i = 0; i < ROWS; i++)
        test_image_finish(&wanted[i]);
}

static void threads_do_not_change_a_bit(void **state) {
    (void)state;
    for (int i = 0; i < ROWS; i++) {
        struct test_image first, other;
        for (unsigned threads = 1; threads <= 3; threads++) {
            struct test_renderer renderer;
            struct scene s = { 0 };
            rows[i].make(&s);
            open_renderer(&renderer, "auto", threads);
            render(&renderer, &s, threads == 1 ? &first : &other);
            if (threads > 1) {
                size_t bytes = (size_t)first.width * first.height * 4 * sizeof *first.rgba;
                assert_memory_equal(first.rgba, other.rgba, bytes);
                test_image_finish(&other);
            }
            test_renderer_close(&renderer);
            finish(&s);
        }
        test_image_finish(&first);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(images_match_rays),
                                        cmocka_unit_test(backends_match_the_reference),
                                        cmocka_unit_test(threads_do_not_change_a_bit) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
