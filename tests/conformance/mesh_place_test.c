/* SPDX-License-Identifier: Apache-2.0
 *
 * Where meshes are: the silhouette of a ball, and a plane inside a medium against a closed form.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "support/compare.h"
#include "support/medium.h"
#include "support/mesh.h"
#include "support/render.h"

static void open_renderer(struct test_renderer *renderer) {
    struct sp_error err = { 0 };
    if (!test_renderer_open(renderer, &(struct test_target){ "cpu", "auto" }, 2, &err))
        fail_msg("%s", err.text);
}

static struct sp_volume *make_volume(const struct sp_elements *mesh) {
    struct sp_error err = { 0 };
    struct sp_volume *volume = sp_volume_create_elements(mesh, "mesh", &err);
    if (!volume)
        fail_msg("%s", err.text);
    return volume;
}

/* Half of the area of a disc of radius r between two parallels, y from its middle. */
static double half_area(double r, double y0, double y1) {
    const double low = y0 * sqrt(r * r - y0 * y0) + r * r * asin(y0 / r);
    return 0.5 * (y1 * sqrt(r * r - y1 * y1) + r * r * asin(y1 / r) - low);
}

/* The coverage of a row or a column of pixels adds up to the width between its two silhouettes. */
static void the_silhouette_of_a_ball_is_in_its_place(void **state) {
    (void)state;
    enum { SIZE = 257 };
    const double radius = 5, distance = 20;
    struct sp_elements mesh;
    struct test_renderer renderer;
    struct test_image image;
    struct sp_view view;
    struct sp_error err = { 0 };
    double sum = 0, most = 0;
    int count = 0;
    open_renderer(&renderer);
    assert_true(test_mesh_ball(&mesh, 128, radius));
    struct sp_volume *volume = make_volume(&mesh);
    sp_view_init(&view, sp_volume_info(volume), "ball");
    view.size[0] = view.size[1] = SIZE;
    view.background[3] = 0;
    view.camera.projection = SP_PERSPECTIVE;
    memcpy(view.camera.position, (double[]){ distance, 0, 0 }, 3 * sizeof(double));
    memcpy(view.camera.target, (double[]){ 0, 0, 0 }, 3 * sizeof(double));
    memcpy(view.camera.up, (double[]){ 0, 0, 1 }, 3 * sizeof(double));
    assert_true(test_render(&renderer, volume, &view, &image, &err));
    const double f = SIZE / (2 * tan(view.camera.fov_y * M_PI / 360));
    const double wanted = f * radius / sqrt(distance * distance - radius * radius);
    for (unsigned i = 0; i < 2 * SIZE; i++) {
        const double y = i % SIZE - SIZE / 2.0;
        double covered = 0;
        if (!(y > -0.7 * wanted && y + 1 < 0.7 * wanted))
            continue;
        for (unsigned k = 0; k < SIZE; k++)
            covered += test_image_at(&image, i < SIZE ? k : i % SIZE, i < SIZE ? i : k)[3];
        const double off = covered / 2 - half_area(wanted, y, y + 1);
        sum += off * off;
        most = fmax(most, fabs(off));
        count++;
    }
    printf("silhouette at %.2f px: off by %.3f px (root of the mean square), most %.3f px\n",
           wanted, sqrt(sum / count), most);
    assert_compare(sqrt(sum / count), <, 0.05);
    assert_compare(most, <, 0.15);
    test_image_finish(&image);
    test_renderer_close(&renderer);
    sp_volume_unref(&volume);
    test_mesh_finish(&mesh);
}

/* Half of the world's size of the medium's scene is less than this. */
#define FAR 1000.0

/* A plane p·n = offset as two triangles. */
static void make_plane(struct sp_elements *mesh, const double n[3], double offset, float alpha) {
    double across[2][3], length = 0;
    const double other[3] = { fabs(n[0]) < 0.5, fabs(n[0]) >= 0.5, 0 };
    assert_true(test_mesh_init(mesh, 4, 2));
    for (int a = 0; a < 3; a++)
        across[0][a] = n[(a + 1) % 3] * other[(a + 2) % 3] - n[(a + 2) % 3] * other[(a + 1) % 3];
    length = sqrt(test_dot(across[0], across[0]));
    for (int a = 0; a < 3; a++)
        across[0][a] /= length;
    for (int a = 0; a < 3; a++)
        across[1][a] =
            n[(a + 1) % 3] * across[0][(a + 2) % 3] - n[(a + 2) % 3] * across[0][(a + 1) % 3];
    for (int k = 0; k < 4; k++) {
        for (int a = 0; a < 3; a++)
            mesh->positions[k][a] = (float)(offset * n[a] + (k & 1 ? FAR : -FAR) * across[0][a] +
                                            (k & 2 ? FAR : -FAR) * across[1][a]);
        mesh->colors[k][1] = 0.5f;
        mesh->colors[k][3] = alpha;
    }
    memcpy(mesh->triangles[0], (uint32_t[]){ 0, 1, 3 }, sizeof mesh->triangles[0]);
    memcpy(mesh->triangles[1], (uint32_t[]){ 0, 3, 2 }, sizeof mesh->triangles[1]);
}

static struct sp_volume *find_plane(void *user, const char *id) {
    assert_string_equal(id, "plane");
    return sp_volume_ref(user);
}

/* Computes the colour of a ray: the medium, the plane with its opacity, and the medium behind the
 * plane. */
static void expect(const struct test_medium *s, const double n[3], double offset, double alpha,
                   double x, double y, double rgb[3]) {
    const double color[3] = { 1, 0.5, 1 };
    double from[3], along[3], t[2];
    test_medium_ray(&s->view.camera, x, y, from, along);
    const bool is_inside = test_medium_cut(s, from, along, true, t);
    const double at = (offset - test_dot(n, from)) / test_dot(n, along);
    const double first = is_inside ? fmax(fmin(at, t[1]) - t[0], 0) : 0;
    const double rest = is_inside ? t[1] - t[0] - first : 0;
    const double pass[2] = { exp(-s->sigma * first), exp(-s->sigma * rest) };
    const bool is_met = at > 0;
    for (int c = 0; c < 3; c++) {
        const double medium = (double)test_medium_color[c];
        const double behind = (1 - pass[1]) * medium + pass[1] * (double)s->view.background[c];
        rgb[c] = (1 - pass[0]) * medium +
                 pass[0] * (is_met ? alpha * color[c] + (1 - alpha) * behind : behind);
    }
}

/* True if the border of the medium is near a pixel. */
static bool is_edge(const struct test_medium *s, double x, double y) {
    double from[3], along[3], t[2];
    test_medium_ray(&s->view.camera, x, y, from, along);
    const bool is_inside = test_medium_cut(s, from, along, true, t);
    for (int i = 0; i < 16; i++) {
        test_medium_ray(&s->view.camera, x + 12 * cos(i * M_PI / 8), y + 12 * sin(i * M_PI / 8),
                        from, along);
        if (test_medium_cut(s, from, along, true, t) != is_inside)
            return true;
    }
    return false;
}

static void check_medium(enum sp_projection projection, enum sp_compositing mode, float alpha,
                         const double most[2]) {
    struct test_medium s;
    struct test_renderer renderer;
    struct test_image image;
    struct sp_elements mesh;
    struct sp_error err = { 0 };
    double n[3] = { 0.8, -0.36, 0.48 }, middle[3], axis[3], range[2], worst = 0, sum = 0;
    int count = 0;
    open_renderer(&renderer);
    test_medium_init(&s, projection);
    assert_non_null(s.volume);
    memcpy(middle, s.grid.origin, sizeof middle);
    for (int a = 0; a < 3; a++) {
        test_medium_axis(&s.grid, a, axis, range);
        for (int r = 0; r < 3; r++)
            middle[r] += 0.5 * (range[0] + range[1]) * axis[r];
    }
    const double offset = test_dot(n, middle);
    make_plane(&mesh, n, offset, alpha);
    struct sp_volume *plane = make_volume(&mesh);
    s.view.compositing.mode = mode;
    s.view.layer_count = 2;
    s.view.layers[0] = sp_layer_default(SP_LAYER_VOLUME);
    s.view.layers[1] = sp_layer_default(SP_LAYER_GEOMETRY);
    snprintf(s.view.layers[1].id, sizeof s.view.layers[1].id, "plane");
    const struct sp_render_options options = { .format = SP_RGBAF32,
                                               .find = find_plane,
                                               .user = plane };
    struct sp_frame *frame =
        sp_renderer_render(renderer.renderer, s.volume, &s.view, renderer.pool, &options, &err);
    if (!frame)
        fail_msg("%s", err.text);
    assert_true(test_image_from_frame(&image, frame));
    for (unsigned y = 0; y < image.height; y++)
        for (unsigned x = 0; x < image.width; x++) {
            double rgb[3];
            if (is_edge(&s, x + 0.5, y + 0.5))
                continue;
            expect(&s, n, offset, (double)alpha, x + 0.5, y + 0.5, rgb);
            for (int c = 0; c < 3; c++) {
                const double off = fabs(test_image_at(&image, x, y)[c] - rgb[c]);
                worst = fmax(worst, off);
                sum += off / 3;
            }
            count++;
        }
    printf("%s, mode %d, opacity %.1f: %d px, mean %.5f, worst %.5f\n",
           projection == SP_PERSPECTIVE ? "perspective" : "orthographic", mode, (double)alpha,
           count, sum / count, worst);
    assert_compare(count, >, 2000);
    assert_compare(sum / count, <, most[0]);
    assert_compare(worst, <, most[1]);
    test_image_finish(&image);
    sp_frame_unref(&frame);
    test_renderer_close(&renderer);
    sp_volume_unref(&plane);
    sp_volume_unref(&s.volume);
    test_mesh_finish(&mesh);
}

static void a_plane_is_in_its_place_inside_a_medium(void **state) {
    (void)state;
    const double exact[2] = { 5e-5, 2e-4 }; /* mean and largest difference */
    for (int projection = 0; projection < 2; projection++)
        for (int k = 0; k < 2; k++) {
            const float alpha = k ? 0.4f : 1;
            check_medium((enum sp_projection)projection, SP_COMPOSITE_SLAB, alpha, exact);
            check_medium((enum sp_projection)projection, SP_COMPOSITE_SHEET, alpha, exact);
        }
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(the_silhouette_of_a_ball_is_in_its_place),
                                        cmocka_unit_test(a_plane_is_in_its_place_inside_a_medium) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
