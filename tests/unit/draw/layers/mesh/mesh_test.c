/* SPDX-License-Identifier: Apache-2.0
 *
 * Degenerate meshes, and samples at the edges of triangles: each lies in exactly one of them.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "support/compare.h"
#include "support/mesh.h"
#include "support/render.h"

enum { SIZE = 64 };

/* Looks along −z from (0, 0, 10); the image shows about ±2.7 at z = 0. */
static void init_view(struct sp_view *view, const struct sp_volume *volume, float opacity) {
    sp_view_init(view, sp_volume_info(volume), "mesh");
    view->size[0] = view->size[1] = SIZE;
    view->background[3] = 0;
    view->shading.mode = SP_SHADING_NONE;
    view->layers[0].opacity = opacity;
    memcpy(view->camera.position, (double[]){ 0, 0, 10 }, 3 * sizeof(double));
    memcpy(view->camera.target, (double[]){ 0, 0, 0 }, 3 * sizeof(double));
    memcpy(view->camera.up, (double[]){ 0, 1, 0 }, 3 * sizeof(double));
    view->camera.projection = SP_PERSPECTIVE;
    view->camera.fov_y = 30;
    view->camera.near = 0.5;
}

static void render_view(const struct sp_view *view, struct sp_volume *volume,
                        struct test_image *image) {
    struct test_renderer renderer;
    struct sp_error err = { 0 };
    if (!test_renderer_open(&renderer, &(struct test_target){ "cpu", "auto" }, 2, &err) ||
        !test_render(&renderer, volume, view, image, &err))
        fail_msg("%s", err.text);
    test_renderer_close(&renderer);
}

static void render(const struct sp_elements *mesh, float opacity, struct test_image *image) {
    struct sp_error err = { 0 };
    struct sp_view view;
    struct sp_volume *volume = sp_volume_create_elements(mesh, "mesh", &err);
    if (!volume)
        fail_msg("%s", err.text);
    init_view(&view, volume, opacity);
    render_view(&view, volume, image);
    sp_volume_unref(&volume);
}

static void set(float to[3], double x, double y, double z) {
    to[0] = (float)x;
    to[1] = (float)y;
    to[2] = (float)z;
}

/* Two triangles with the corners (±half, ±half, z), from vertex 4 · number on. */
static void set_square(struct sp_elements *mesh, uint32_t number, double half, double z) {
    const uint32_t at = 4 * number;
    for (uint32_t k = 0; k < 4; k++)
        set(mesh->positions[at + k], k & 1 ? half : -half, k & 2 ? half : -half, z);
    memcpy(mesh->triangles[2 * number], (uint32_t[]){ at, at + 1, at + 3 }, 3 * sizeof(uint32_t));
    memcpy(mesh->triangles[2 * number + 1], (uint32_t[]){ at, at + 3, at + 2 },
           3 * sizeof(uint32_t));
}

/* Checks the opacity of every pixel. */
static void assert_alpha(const struct test_image *image, double wanted) {
    for (unsigned y = 0; y < image->height; y++)
        for (unsigned x = 0; x < image->width; x++)
            if (!(fabs(test_image_at(image, x, y)[3] - wanted) < 1e-5))
                fail_msg("pixel (%u, %u): opacity %.7f instead of %.7f", x, y,
                         test_image_at(image, x, y)[3], wanted);
}

static void assert_same(const struct test_image *a, const struct test_image *b) {
    assert_memory_equal(a->rgba, b->rgba, (size_t)a->width * a->height * 4 * sizeof *a->rgba);
}

static void an_empty_mesh_shows_nothing(void **state) {
    (void)state;
    for (uint32_t vertices = 0; vertices < 4; vertices += 3) {
        struct sp_elements mesh;
        struct test_image image;
        assert_true(test_mesh_init(&mesh, vertices, 0));
        render(&mesh, 1, &image);
        assert_alpha(&image, 0);
        test_image_finish(&image);
        test_mesh_finish(&mesh);
    }
}

/* Triangles without an area or with a vertex that is not finite change nothing. */
static void degenerate_triangles_are_not_drawn(void **state) {
    (void)state;
    struct sp_elements mesh;
    struct test_image wanted, got;
    assert_true(test_mesh_init(&mesh, 12, 10));
    set_square(&mesh, 0, 1.5, 0);
    set(mesh.positions[4], NAN, 0, 1);
    set(mesh.positions[5], 0, INFINITY, 1);
    set(mesh.positions[6], 1e15, -1e15, 1e15);
    set(mesh.positions[7], 0, 0, 1);
    set(mesh.positions[8], 1, 0, 1);
    set(mesh.positions[9], 2, 0, 1);
    set(mesh.positions[10], 1, 1, 30); /* behind the eye, as the next two */
    set(mesh.positions[11], -1, 1, 30);
    mesh.shape.count = 2;
    render(&mesh, 1, &wanted);
    const uint32_t bad[8][3] = { { 0, 1, 4 }, { 5, 2, 1 },    { 7, 8, 9 }, { 7, 7, 8 },
                                 { 8, 8, 8 }, { 10, 11, 10 }, { 4, 5, 4 }, { 6, 6, 0 } };
    memcpy(mesh.triangles[2], bad, sizeof bad);
    mesh.shape.count = 10;
    render(&mesh, 1, &got);
    assert_same(&wanted, &got);
    assert_compare(test_image_at(&got, SIZE / 2, SIZE / 2)[3], ==, 1);
    test_image_finish(&wanted);
    test_image_finish(&got);
    test_mesh_finish(&mesh);
}

/* A plane of triangles of all sizes, beyond the borders of the image on all sides: with an opacity
 * of a half, a sample in no triangle or in two of them would show. */
static void each_sample_lies_in_one_triangle(void **state) {
    (void)state;
    enum { N = 24 };
    static const double tilts[] = { 0, 0.6 }, enlargements[] = { 9, 60, 1e5 };
    for (int tilt = 0; tilt < 2; tilt++)
        for (int size = 0; size < 3; size++) {
            struct sp_elements mesh;
            struct test_image image;
            uint32_t random = 12345, at = 0;
            assert_true(test_mesh_init(&mesh, N * N, 2 * (N - 1) * (N - 1)));
            for (int j = 0; j < N; j++)
                for (int i = 0; i < N; i++) {
                    double p[2] = { i, j };
                    for (int a = 0; a < 2; a++) {
                        random = random * 1664525 + 1013904223;
                        const bool is_border = p[a] == 0 || p[a] == N - 1;
                        p[a] += is_border ? 0 : (random >> 16) / 65536.0 * 0.4 - 0.2;
                        p[a] = (p[a] / (N - 1) - 0.5) * 2 * enlargements[size];
                    }
                    set(mesh.positions[j * N + i], p[0], p[1], tilts[tilt] * p[1] - 1);
                }
            for (uint32_t j = 0; j + 1 < N; j++)
                for (uint32_t i = 0; i + 1 < N; i++) {
                    const uint32_t k = j * N + i;
                    const uint32_t one[3] = { k, k + 1, k + N + 1 },
                                   two[3] = { k + N, k, k + N + 1 };
                    memcpy(mesh.triangles[at++], one, sizeof one);
                    memcpy(mesh.triangles[at++], two, sizeof two);
                }
            render(&mesh, 0.5f, &image);
            /* The tilted plane of the largest size passes the eye, above the horizon at most. */
            if (tilt == 0 || size < 2)
                assert_alpha(&image, 0.5);
            else
                assert_compare(test_image_at(&image, 3, SIZE - 1)[3], ==, 0.5);
            test_image_finish(&image);
            test_mesh_finish(&mesh);
        }
}

/* The nearest sheets are drawn, each with its opacity; triangles at the same place one after the
 * other. */
static void sheets_are_composited_in_order(void **state) {
    (void)state;
    enum { SHEETS = 20 };
    const float opacity = 0.125f;
    for (int apart = 0; apart < 2; apart++)
        for (uint32_t count = 1; count <= SHEETS; count += 3) {
            struct sp_elements mesh;
            struct test_image image;
            assert_true(test_mesh_init(&mesh, 4 * count, 2 * count));
            for (uint32_t i = 0; i < count; i++) {
                set_square(&mesh, i, 5, apart * 0.1 * i);
                for (int k = 0; k < 4; k++)
                    mesh.colors[4 * i + k][0] = i + 1 == count;
            }
            render(&mesh, opacity, &image);
            const uint32_t seen = count < 16 ? count : 16;
            assert_alpha(&image, 1 - pow(1 - (double)opacity, seen));
            if (apart) /* the last square is the nearest */
                assert_compare(fabs(test_image_at(&image, 9, 9)[0] - 0.125), <, 1e-5);
            test_image_finish(&image);
            test_mesh_finish(&mesh);
        }
}

/* Three squares at one edge, seen from their side: each pixel shows the nearest square. */
static void edges_may_have_many_triangles(void **state) {
    (void)state;
    struct sp_elements mesh;
    struct test_image image;
    assert_true(test_mesh_init(&mesh, 8, 6));
    for (int k = 0; k < 2; k++) {
        const double y = k ? 2 : -2;
        set(mesh.positions[k], 0, y, 0);
        set(mesh.positions[2 + k], -2, y, 0);
        set(mesh.positions[4 + k], 2, y, 0);
        set(mesh.positions[6 + k], 2, y, 1);
        for (int c = 0; c < 3; c++) {
            mesh.colors[2 + k][c] = c == 0;
            mesh.colors[4 + k][c] = c == 1;
            mesh.colors[6 + k][c] = c == 2;
        }
    }
    for (uint32_t i = 0; i < 3; i++) {
        memcpy(mesh.triangles[2 * i], (uint32_t[]){ 0, 1, 2 * i + 3 }, 3 * sizeof(uint32_t));
        memcpy(mesh.triangles[2 * i + 1], (uint32_t[]){ 2 * i + 3, 2 * i + 2, 0 },
               3 * sizeof(uint32_t));
    }
    render(&mesh, 1, &image);
    const double *left = test_image_at(&image, 14, SIZE / 2);
    const double *right = test_image_at(&image, SIZE - 15, SIZE / 2);
    assert_compare(left[0], >, left[2] + 0.3);
    assert_compare(right[2], >, right[1] + 0.3);
    assert_compare(left[3], ==, 1);
    test_image_finish(&image);
    test_mesh_finish(&mesh);
}

/* Vertices without a normal are lit by the plane of their triangle; opacities and colours outside
 * of [0, 1] are cut. */
static void attributes_may_be_anything(void **state) {
    (void)state;
    struct sp_elements mesh;
    struct test_image image;
    struct sp_view view;
    struct sp_error err = { 0 };
    assert_true(test_mesh_init(&mesh, 4, 2));
    set_square(&mesh, 0, 5, 0);
    for (int k = 0; k < 4; k++) {
        mesh.colors[k][0] = NAN;
        mesh.colors[k][1] = -3;
        mesh.colors[k][2] = 7;
        mesh.colors[k][3] = 9;
        mesh.normals[k][k % 3] = k ? NAN : 0;
    }
    struct sp_volume *volume = sp_volume_create_elements(&mesh, "mesh", &err);
    assert_non_null(volume);
    init_view(&view, volume, 1);
    view.shading.mode = SP_SHADING_PHONG;
    view.shading.ambient = 0.25;
    view.shading.diffuse = 0.5;
    view.shading.specular = 0;
    view.shading.light_count = 1;
    view.shading.lights[0] = (struct sp_light){ { 0, 0, 1 }, SP_LIGHT_WORLD, { 1, 1, 1 } };
    render_view(&view, volume, &image);
    const double wanted[4] = { 0, 0, 0.75, 1 };
    for (int c = 0; c < 4; c++)
        assert_compare(fabs(test_image_at(&image, 20, 30)[c] - wanted[c]), <, 1e-5);
    test_image_finish(&image);
    sp_volume_unref(&volume);
    test_mesh_finish(&mesh);
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(an_empty_mesh_shows_nothing),
                                        cmocka_unit_test(degenerate_triangles_are_not_drawn),
                                        cmocka_unit_test(each_sample_lies_in_one_triangle),
                                        cmocka_unit_test(sheets_are_composited_in_order),
                                        cmocka_unit_test(edges_may_have_many_triangles),
                                        cmocka_unit_test(attributes_may_be_anything) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
