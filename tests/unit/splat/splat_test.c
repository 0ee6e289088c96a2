/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "splat/adaptive.h"
#include "splat/ewa.h"
#include "splat/exp2.h"
#include "support/compare.h"

static const struct sp_transfer_function thin = {
    .reference_length = 1,
    .point_count = 1,
    .points = { { 0, { 0.25f, 0.5f, 1 }, 0.01f } },
};

static const struct sp_grid grids[] = {
    { { 9, 9, 9 }, { 1, 1, 1 }, { -4, -4, -4 }, { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } }, { 0 } },
    { { 9, 9, 9 }, { 1, 2, 4 }, { -4, -8, -16 }, { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } }, { 0 } },
    { { 9, 9, 9 },
      { 1, 1, 3 },
      { 0, 0, 0 },
      { { 0, 0.6, 0.8 }, { 1, 0, 0 }, { 0, 0.8, -0.6 } },
      { 0 } },
    { { 9, 9, 9 },
      { 2, 1, 1 },
      { 1, 2, 3 },
      { { 1, 0.6, 0 }, { 0, 0.8, 0 }, { 0, 0, -1 } },
      { 0 } },
};
enum { GRIDS = sizeof grids / sizeof grids[0] };

static struct sp_view make_view(enum sp_projection projection) {
    struct sp_view view = {
        .size = { 200, 160 },
        .camera = { .projection = projection,
                    .position = { 30, -50, 25 },
                    .target = { 1, 2, -3 },
                    .up = { 0, 0.2, 1 },
                    .fov_y = 40,
                    .height = 60,
                    .near = 0.1 },
        .transfer_function = thin,
        .filter = { SP_FILTER_EWA, SP_KERNEL_GAUSSIAN, 0.7, 3, 0.8, 0.3, NAN },
        .compositing = { .mode = SP_COMPOSITE_SHEET,
                         .slab = 1,
                         .center = NAN,
                         .width = NAN,
                         .zero = NAN,
                         .absorption = NAN },
        .shading = { .exponent = 1, .reach = 0.2 },
        .layer_count = 1,
        .layers = { { .flatness = INFINITY, .high = 1, .visible = true } },
        .slices = { .normal = { 0, 0, 1 }, .width = 1 },
    };
    return view;
}

/* Returns the world position of index i. */
static struct sp_vec3 world(const struct sp_grid *g, const double i[3]) {
    struct sp_vec3 t = sp_vec3_from(g->origin);
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            t.v[r] += g->direction[r][a] * g->spacing[a] * i[a];
    return t;
}

/* World to ray space, from the definition. */
static struct sp_vec3 project(const struct sp_view *view, struct sp_vec3 t) {
    struct sp_camera_transform c;
    sp_camera_transform_init(&c, &view->camera, view->size);
    struct sp_vec3 u = sp_mat3_apply(&c.w, sp_vec3_sub(t, c.eye));
    if (c.projection == SP_ORTHOGRAPHIC)
        return (struct sp_vec3){ { c.centre[0] + c.scale * u.v[0], c.centre[1] + c.scale * u.v[1],
                                   u.v[2] } };
    return (struct sp_vec3){ { c.centre[0] + c.scale * u.v[0] / u.v[2],
                               c.centre[1] + c.scale * u.v[1] / u.v[2], sp_vec3_length(u) } };
}

/* Sets up one voxel of constant value 1 at index i; false if it is culled. */
static bool set_up(const struct sp_grid *grid, const struct sp_view *view, const uint32_t i[3],
                   struct sp_splat *splat) {
    struct sp_camera_transform camera;
    struct sp_ewa_frame frame;
    sp_camera_transform_init(&camera, &view->camera, view->size);
    sp_ewa_frame_init(&frame, &camera, grid, view, &view->filter);
    uint16_t local = (uint16_t)(i[0] % 16 | i[1] % 16 << 4 | i[2] % 16 << 8);
    uint32_t key = 0, normal = 0;
    uint64_t first[2] = { 0, 1 };
    struct sp_visible list = { .bricks = { 1, 1, 1 },
                               .count = 1,
                               .first = first,
                               .key = &key,
                               .key_bytes = 4,
                               .normal = &normal,
                               .normal_bytes = 4 };
    struct sp_class class = { { 0.25f, 0.5f, 1 }, (float)-log1p(-0.01) };
    struct sp_transfer transfer = { .tf = thin, .table = &class, .count = 1 };
    struct sp_ewa_run run = {
        .list = &list,
        .local = &local,
        .transfer = &transfer,
        .brick = { i[0] & ~15u, i[1] & ~15u, i[2] & ~15u },
        .count = 1,
        .sheet = 7,
        .mode = view->filter.mode,
    };
    return sp_ewa_set_up(&frame, &run, &(struct sp_splats){ .splat = splat }) == 1;
}

/* Central differences of the projection by index, which is J·W·direction·spacing. */
static void differentiate(const struct sp_view *view, const struct sp_grid *g, const uint32_t i[3],
                          double d[3][3]) {
    const double h = 1e-4;
    for (int a = 0; a < 3; a++) {
        double p[3] = { i[0], i[1], i[2] }, q[3] = { i[0], i[1], i[2] };
        p[a] += h;
        q[a] -= h;
        struct sp_vec3 x = project(view, world(g, p)), y = project(view, world(g, q));
        for (int r = 0; r < 3; r++)
            d[r][a] = (x.v[r] - y.v[r]) / (2 * h);
    }
}

static void variance_is_that_of_the_projection(void **state) {
    (void)state;
    for (int n = 0; n < GRIDS; n++)
        for (int projection = 0; projection < 2; projection++) {
            struct sp_view view = make_view((enum sp_projection)projection);
            const struct sp_grid *g = &grids[n];
            const uint32_t i[3] = { 1, 7, 3 };
            struct sp_splat s;
            assert_true(set_up(g, &view, i, &s));
            struct sp_vec3 x = project(&view, world(g, (double[3]){ 1, 7, 3 }));
            assert_compare(fabs((double)s.x - x.v[0]), <, 1e-3);
            assert_compare(fabs((double)s.y - x.v[1]), <, 1e-3);
            assert_int_equal(s.sheet, 7);
            double d[3][3], v[2][2] = { { 0 } }, h2 = view.filter.lowpass * view.filter.lowpass;
            differentiate(&view, g, i, d);
            for (int r = 0; r < 2; r++)
                for (int c = 0; c < 2; c++) {
                    v[r][c] = r == c ? h2 : 0;
                    for (int a = 0; a < 3; a++)
                        v[r][c] += 0.49 * d[r][a] * d[c][a];
                }
            double det = v[0][0] * v[1][1] - v[0][1] * v[0][1];
            double half = 0.5 / log(2) / det;
            assert_compare(fabs((double)s.a / (half * v[1][1]) - 1), <, 1e-3);
            assert_compare(fabs((double)s.c / (half * v[0][0]) - 1), <, 1e-3);
            assert_compare(fabs((double)s.b + 2 * half * v[0][1]), <,
                           1e-3 * half * (v[0][0] + v[1][1]));
            /* The integral of the footprint is g·v·|det J| with the Jacobian of world coordinates,
             * which is g·|det d| by index. It is scaled up for the part beyond the cutoff. */
            double g_k = -log1p(-0.01), det_d = fabs(sp_mat3_determinant((struct sp_mat3 *)d));
            double integral = (double)s.depth * 2 * M_PI * sqrt(det) * (1 - exp(-4.5));
            assert_compare(fabs(integral / (g_k * det_d) - 1), <, 2e-3);
            for (int k = 0; k < 3; k++)
                assert_compare(
                    fabs((double)(s.emission[k] / s.depth) - (double)thin.points[0].color[k]), <,
                    1e-6);
            /* The box bounds the ellipse. */
            double rx = 3 * sqrt(v[0][0]), ry = 3 * sqrt(v[1][1]);
            assert_int_equal(s.x0, (int)fmax(0, ceil(x.v[0] - rx - 0.5)));
            assert_int_equal(s.x1, (int)fmin(200, floor(x.v[0] + rx + 0.5)));
            assert_int_equal(s.y0, (int)fmax(0, ceil(x.v[1] - ry - 0.5)));
            assert_int_equal(s.y1, (int)fmin(160, floor(x.v[1] + ry + 0.5)));
        }
}

/* Projects a Gaussian cloud of points. It is far away, where the projection is nearly affine. */
static void variance_is_that_of_a_cloud(void **state) {
    (void)state;
    struct sp_view view = make_view(SP_PERSPECTIVE);
    for (int i = 0; i < 3; i++)
        view.camera.position[i] *= 20;
    view.camera.fov_y = 2;
    view.filter.mode = SP_FILTER_RECONSTRUCTION;
    const struct sp_grid *g = &grids[3];
    struct sp_splat s;
    assert_true(set_up(g, &view, (uint32_t[3]){ 4, 4, 4 }, &s));
    enum { POINTS = 200000 };
    double sum[2] = { 0 }, square[3] = { 0 };
    srand(3);
    for (int n = 0; n < POINTS; n++) {
        double i[3];
        for (int a = 0; a < 3; a++) { /* Box and Muller */
            double u = (rand() + 1.0) / (RAND_MAX + 2.0), w = (rand() + 1.0) / (RAND_MAX + 2.0);
            i[a] = 4 + 0.7 * sqrt(-2 * log(u)) * cos(2 * M_PI * w);
        }
        struct sp_vec3 x = project(&view, world(g, i));
        double dx = x.v[0] - (double)s.x, dy = x.v[1] - (double)s.y;
        sum[0] += dx;
        sum[1] += dy;
        square[0] += dx * dx;
        square[1] += dx * dy;
        square[2] += dy * dy;
    }
    double det = (square[0] * square[2] - square[1] * square[1]) / POINTS / POINTS;
    double half = 0.5 / log(2) / det / POINTS, scale = half * (square[0] + square[2]);
    assert_compare(fabs(sum[0]), <, 0.02 * sqrt(square[0] * POINTS));
    assert_compare(fabs((double)s.a - half * square[2]), <, 0.02 * scale);
    assert_compare(fabs((double)s.b + 2 * half * square[1]), <, 0.02 * scale);
    assert_compare(fabs((double)s.c - half * square[0]), <, 0.02 * scale);
}

static void filters_keep_the_footprints_energy(void **state) {
    (void)state;
    static const enum sp_filter_mode modes[] = { SP_FILTER_EWA, SP_FILTER_RECONSTRUCTION,
                                                 SP_FILTER_LOWPASS };
    for (int projection = 0; projection < 2; projection++) {
        double first = 0;
        for (int m = 0; m < 3; m++) {
            struct sp_view view = make_view((enum sp_projection)projection);
            view.filter.mode = modes[m];
            view.filter.lowpass = 1.5;
            struct sp_splat s;
            assert_true(set_up(&grids[1], &view, (uint32_t[3]){ 5, 3, 6 }, &s));
            /* The integral of a Gaussian is its peak times 2π√det; the conic gives √det. */
            double root =
                0.5 / log(2) / sqrt((double)s.a * (double)s.c - 0.25 * (double)s.b * (double)s.b);
            double energy = (double)s.depth * root;
            if (m == 0)
                first = energy;
            assert_compare(fabs(energy / first - 1), <, 1e-4);
        }
    }
}

static void voxels_out_of_sight_are_culled(void **state) {
    (void)state;
    struct sp_view view = make_view(SP_PERSPECTIVE);
    struct sp_splat s;
    const uint32_t i[3] = { 4, 4, 4 };
    assert_true(set_up(&grids[0], &view, i, &s));
    view.camera.near = 1000; /* nearer than the near plane */
    assert_false(set_up(&grids[0], &view, i, &s));
    view = make_view(SP_PERSPECTIVE); /* behind the camera */
    for (int k = 0; k < 3; k++)
        view.camera.target[k] = 2 * view.camera.position[k] - view.camera.target[k];
    assert_false(set_up(&grids[0], &view, i, &s));
    view = make_view(SP_ORTHOGRAPHIC); /* beside the image */
    view.camera.height = 2;
    assert_false(set_up(&grids[0], &view, (uint32_t[3]){ 0, 0, 0 }, &s));
}

static float random_extreme(void) {
    static const float values[] = { 0, 1e-30f, 1e-6f, 0.3f, 1, 17, 1e4f, 1e12f, 1e30f, 3e38f };
    float x = values[rand() % 10] * (float)(rand() / (RAND_MAX / 2.0) - 1);
    return x;
}

/* For any input, a splat that is drawn is finite and its box lies in the image. */
static void extreme_views_give_finite_splats(void **state) {
    (void)state;
    srand(4);
    int drawn = 0;
    for (int n = 0; n < 100000; n++) {
        struct sp_view view = make_view((enum sp_projection)(n % 2));
        struct sp_grid g = grids[n % GRIDS];
        for (int k = 0; k < 3; k++) {
            if (rand() % 4 == 0)
                view.camera.position[k] = (double)random_extreme() * 1e200;
            else if (rand() % 2)
                view.camera.position[k] = (double)random_extreme();
            if (rand() % 3 == 0)
                g.spacing[k] = fabs((double)random_extreme()) + 1e-12;
            if (rand() % 3 == 0)
                g.origin[k] = (double)random_extreme();
        }
        view.camera.near = fabs((double)random_extreme()) + 1e-300;
        view.camera.height = fabs((double)random_extreme()) + 1e-300;
        view.camera.fov_y = n % 3 ? 40 : n % 2 ? 1 : 170;
        view.transfer_function.reference_length = fabs((double)random_extreme()) + 1e-300;
        view.filter.lowpass = n % 5 ? 1 : 0;
        view.filter.mode = (enum sp_filter_mode[]){ SP_FILTER_EWA, SP_FILTER_RECONSTRUCTION,
                                                    SP_FILTER_LOWPASS }[n % 3];
        view.size[0] = n % 7 ? 200 : 8192;
        view.size[1] = n % 11 ? 160 : 1;
        struct sp_splat s;
        if (!sp_view_validate(&view, NULL) ||
            !set_up(&g, &view, (uint32_t[3]){ (uint32_t)n % 9, (uint32_t)n % 5, 4 }, &s))
            continue;
        drawn++;
        const float numbers[] = { s.x, s.y, s.a, s.b, s.c, s.depth, s.emission[0], s.emission[2] };
        for (size_t k = 0; k < sizeof numbers / sizeof numbers[0]; k++)
            assert_true(isfinite(numbers[k]));
        assert_compare(s.a, >=, 0);
        assert_compare(s.c, >=, 0);
        assert_compare(s.depth, >, 0);
        assert_compare(s.depth, <=, SP_DEPTH_MAX);
        assert_compare(s.x0, >=, 0);
        assert_compare(s.x0, <, s.x1);
        assert_compare(s.x1, <=, (int)view.size[0]);
        assert_compare(s.y0, >=, 0);
        assert_compare(s.y0, <, s.y1);
        assert_compare(s.y1, <=, (int)view.size[1]);
    }
    assert_compare(drawn, >, 4500);
}

static void adaptive_rule_is_conservative(void **state) {
    (void)state;
    for (int projection = 0; projection < 2; projection++)
        for (int zoom = 0; zoom < 12; zoom++) {
            struct sp_view view = make_view((enum sp_projection)projection);
            struct sp_grid g = { .dims = { 70, 40, 33 },
                                 .spacing = { 1, 1, 3 },
                                 .origin = { -35, -20, -50 },
                                 .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
            double factor = pow(2, zoom - 4);
            for (int k = 0; k < 3; k++)
                view.camera.position[k] = view.camera.position[k] * factor + view.camera.target[k];
            view.camera.height *= factor;
            struct sp_camera_transform camera;
            struct sp_adaptive adaptive;
            sp_camera_transform_init(&camera, &view.camera, view.size);
            sp_adaptive_init(&adaptive, &camera, &g, &view, &view.filter);
            assert_compare(fabs(adaptive.radius[0] - 0.7), <, 1e-9);
            assert_compare(fabs(adaptive.radius[1] - 2.1), <, 1e-9);
            uint8_t modes[5 * 3 * 3];
            assert_int_equal(sp_adaptive_count(&g), sizeof modes);
            enum sp_filter_mode shared = sp_adaptive_fill(&adaptive, modes);
            int differ = 0;
            /* No voxel of a block needs a more expensive filter than the block uses. */
            for (uint32_t k = 0; k < 33; k++)
                for (uint32_t j = 0; j < 40; j++)
                    for (uint32_t i = 0; i < 70; i++) {
                        uint8_t mode = modes[i / 16 + 5 * (j / 16 + 3 * (k / 16))];
                        struct sp_vec3 t = world(&g, (double[3]){ i, j, k });
                        double u2 = sp_mat3_apply(&camera.w, sp_vec3_sub(t, camera.eye)).v[2];
                        enum sp_filter_mode own =
                            sp_adaptive_mode(&adaptive, adaptive.radius, u2, u2);
                        differ += mode != modes[0];
                        if (mode != SP_FILTER_EWA && u2 > 0)
                            assert_int_equal(own, mode);
                    }
            assert_int_equal(shared == SP_FILTER_ADAPTIVE, differ > 0);
        }
}

static void adaptive_thresholds_are_those_of_the_definition(void **state) {
    (void)state;
    struct sp_adaptive a = { .projection = SP_PERSPECTIVE,
                             .scale = 100,
                             .radius = { 0.7, 0.7 },
                             .lowpass = 1,
                             .c_min = 0.3,
                             .c_max = 2 };
    /* R = 70/u2: reconstruction while R·0.3 > 1, lowpass once R·2 < 1. */
    assert_int_equal(sp_adaptive_mode(&a, a.radius, 1, 20.9), SP_FILTER_RECONSTRUCTION);
    assert_int_equal(sp_adaptive_mode(&a, a.radius, 1, 21.1), SP_FILTER_EWA);
    assert_int_equal(sp_adaptive_mode(&a, a.radius, 139, 200), SP_FILTER_EWA);
    assert_int_equal(sp_adaptive_mode(&a, a.radius, 141, 200), SP_FILTER_LOWPASS);
    assert_int_equal(sp_adaptive_mode(&a, a.radius, -5, 200), SP_FILTER_EWA);
    a.lowpass = 0;
    assert_int_equal(sp_adaptive_mode(&a, a.radius, 141, 200), SP_FILTER_RECONSTRUCTION);
}

/* The same voxel in each SIMD lane: all get the same colour. */
static void shade_one(const struct sp_shade *shade, uint32_t packed, const float to_eye[3],
                      float color[3]) {
    sp_wide eye[3], wide[3];
    for (int c = 0; c < 3; c++) {
        eye[c] = sp_wide_all(to_eye[c]);
        wide[c] = sp_wide_all(color[c]);
    }
    sp_shade_apply(shade, sp_wide_int_all((int32_t)packed), eye, wide);
    for (int c = 0; c < 3; c++) {
        color[c] = wide[c][0];
        for (int i = 1; i < SP_WIDE; i++)
            assert_compare(wide[c][i], ==, color[c]);
    }
}

static void shading_follows_its_formula(void **state) {
    (void)state;
    struct sp_view view = make_view(SP_PERSPECTIVE);
    struct sp_camera_transform camera;
    sp_camera_transform_init(&camera, &view.camera, view.size);
    struct sp_shading shading = {
        .mode = SP_SHADING_PHONG,
        .ambient = 0.2,
        .diffuse = 0.7,
        .specular = 0.4,
        .exponent = 12,
        .light_count = 2,
        .lights = { { { 0.5, 0.5, 2 }, SP_LIGHT_CAMERA, { 1, 0.5f, 0.25f } },
                    { { -3, 1, 0 }, SP_LIGHT_WORLD, { 0.3f, 0.3f, 0.3f } } },
    };
    struct sp_shade shade;
    sp_shade_init(&shade, &camera, &shading);
    struct sp_gradient_grid unit = { .bound = 1, .unit = 1, .scale = 1 };
    srand(5);
    for (int n = 0; n < 5000; n++) {
        double g[3], v[3] = { 0.1, -0.2, -1 };
        for (int r = 0; r < 3; r++)
            g[r] = rand() / (RAND_MAX / 2.0) - 1;
        uint32_t packed = sp_gradient_pack(&unit, g);
        float direction[3], to_eye[3], colour[3] = { 0.9f, 0.6f, 0.3f };
        sp_gradient_unpack(packed, direction);
        struct sp_vec3 normal = { { (double)direction[0], (double)direction[1],
                                    (double)direction[2] } };
        struct sp_vec3 eye = sp_vec3_normalize(sp_vec3_from(v));
        for (int r = 0; r < 3; r++)
            to_eye[r] = (float)eye.v[r];
        normal = sp_mat3_apply(&camera.w, normal);
        double expected[3];
        for (int c = 0; c < 3; c++) {
            double lit = 0.2, shine = 0;
            for (int i = 0; i < 2; i++) {
                struct sp_vec3 l = sp_vec3_normalize(sp_vec3_from(shading.lights[i].direction));
                l = i ? sp_mat3_apply(&camera.w, l)
                      : (struct sp_vec3){ { l.v[0], -l.v[1], -l.v[2] } };
                struct sp_vec3 h = sp_vec3_normalize(sp_vec3_add(l, eye));
                double strength = (double)shading.lights[i].color[c];
                lit += 0.7 * strength * fabs(sp_vec3_dot(normal, l));
                shine += 0.4 * strength * pow(fabs(sp_vec3_dot(normal, h)), 12);
            }
            expected[c] = (double)colour[c] * lit + shine;
        }
        shade_one(&shade, packed, to_eye, colour);
        for (int c = 0; c < 3; c++)
            assert_compare(fabs((double)colour[c] - expected[c]), <, 1e-4);
        /* Shading is two-sided: the opposite gradient gives the same colour. */
        float other[3] = { 0.9f, 0.6f, 0.3f };
        for (int r = 0; r < 3; r++)
            g[r] = -g[r];
        shade_one(&shade, sp_gradient_pack(&unit, g), to_eye, other);
        for (int c = 0; c < 3; c++)
            assert_compare(fabsf(colour[c] - other[c]), <, 5e-3f);
    }
    float flat[3] = { 0.5f, 0.5f, 0.5f }, to_eye[3] = { 0, 0, -1 };
    shade_one(&shade, 0, to_eye, flat);
    assert_compare(fabsf(flat[0] - 0.5f * (0.2f + 0.7f * 1.3f)), <, 1e-5f);
}

static void powers_of_two_are_close(void **state) {
    (void)state;
    for (int n = -125990; n <= 125990; n++) {
        float x = (float)n * 0.001f;
        assert_compare(fabs((double)sp_exp2(x) / exp2((double)x) - 1), <, 2e-7);
        sp_wide wide = sp_wide_exp2((sp_wide){ x, -x, 0, x });
        assert_compare(wide[0], ==, sp_exp2(x));
        assert_compare(wide[1], ==, sp_exp2(-x));
        assert_compare(wide[2], ==, 1);
        float y = exp2f(x);
        assert_compare(fabs((double)sp_log2(y) - log2((double)y)), <,
                       3e-6 * fmax(1, fabs((double)x)));
    }
    assert_compare(sp_exp2(-1e30f), >, 0);
    assert_compare(sp_exp2(-1e30f), <, 1e-37f);
    assert_true(isfinite(sp_exp2(1e30f)));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(variance_is_that_of_the_projection),
        cmocka_unit_test(variance_is_that_of_a_cloud),
        cmocka_unit_test(filters_keep_the_footprints_energy),
        cmocka_unit_test(voxels_out_of_sight_are_culled),
        cmocka_unit_test(extreme_views_give_finite_splats),
        cmocka_unit_test(adaptive_rule_is_conservative),
        cmocka_unit_test(adaptive_thresholds_are_those_of_the_definition),
        cmocka_unit_test(shading_follows_its_formula),
        cmocka_unit_test(powers_of_two_are_close),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
