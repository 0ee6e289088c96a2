/* SPDX-License-Identifier: Apache-2.0
 *
 * Points, trained Gaussians and shells close to the eye, against rays through their kernels
 * (support/kernels.h): the eye 0.3 to 8 voxels above a ball, looking along its surface, and inside
 * a gyroid.
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
#include "support/kernels.h"
#include "support/render.h"
#include "support/sanitized.h"
#include "support/scene.h"

enum { SIDE = 52, RADIUS = 20, KERNELS = 40000 }; /* of the volume, of the ball [voxels] */
enum what { POINTS, GAUSSIANS, SHELL, STREAKS, WHATS };
static const char *const names[WHATS] = { "points", "gaussians", "shell", "streaks" };
static const double deviation = 0.7; /* of a shell's kernels */

/* A layer in a shape, in the renderer and as kernels. */
struct close_shape {
    enum what what;
    bool is_gyroid;
    struct sp_volume *volume;
    struct test_kernel *kernels;
    unsigned count;
    struct sp_view view; /* without the camera */
};

static bool is_points(const struct close_shape *s) {
    return s->what == POINTS || s->what == STREAKS;
}

static double random_in(unsigned *seed, double low, double high) {
    *seed = *seed * 1664525u + 1013904223u;
    return low + (high - low) * (*seed >> 8) / 16777216.0;
}

/* How deep a place is in the shape [voxels], about; from the middle of the volume. */
static double depth_in(bool is_gyroid, const double p[3]) {
    const double k = 2 * M_PI / 20;
    if (!is_gyroid)
        return RADIUS - sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    return 3 * (sin(k * p[0]) * cos(k * p[1]) + sin(k * p[1]) * cos(k * p[2]) +
                sin(k * p[2]) * cos(k * p[0]));
}

/* A pattern of two colours, [0, 1]. */
static double pattern(const double p[3]) {
    return 0.5 + 0.45 * sin(0.9 * p[0]) * cos(0.7 * p[1] + 0.4 * p[2]);
}

static double shape_value(const void *user, double x, double y, double z) {
    const struct close_shape *s = user;
    const double middle = (SIDE - 1) / 2.0, p[3] = { x - middle, y - middle, z - middle };
    return depth_in(s->is_gyroid, p) < 0 ? -1 : pattern(p);
}

static void set_color(double value, double color[3]) {
    color[0] = value;
    color[1] = 0.5;
    color[2] = 1 - value;
}

/* The lower triangular factor of t²·(I − n·nᵀ) + s²·n·nᵀ. */
static void flatten(const double n[3], double t, double s, double l[6]) {
    double m[3][3] = { { 0 } };
    for (int r = 0; r < 3; r++)
        for (int c = 0; c <= r; c++) {
            double rest = (r == c ? t * t : 0) + (s * s - t * t) * n[r] * n[c];
            for (int k = 0; k < c; k++)
                rest -= m[r][k] * m[c][k];
            m[r][c] = r == c ? sqrt(rest) : rest / m[c][c];
            l[r * (r + 1) / 2 + c] = m[r][c];
        }
}

static const double point_opacity = 0.6;

/* The kernel at a place of the lattice. */
static void make_kernel(const struct close_shape *s, const double p[3], unsigned *seed,
                        struct test_kernel *k) {
    double n[3], square = 0;
    *k = (struct test_kernel){ .factor = { deviation, 0, deviation, 0, 0, deviation } };
    for (int r = 0; r < 3; r++) {
        k->position[r] =
            s->what == SHELL ? p[r] : (double)(float)(p[r] + random_in(seed, -0.2, 0.2));
        n[r] = random_in(seed, -1, 1);
        square += n[r] * n[r];
    }
    for (int r = 0; r < 3; r++)
        n[r] /= sqrt(square);
    if (is_points(s))
        flatten(n, 0.8, 0.4, k->factor);
    if (s->what == GAUSSIANS)
        flatten(n, 0.8, 0.25, k->factor);
    for (int i = 0; i < 6; i++)
        k->factor[i] = (double)(float)k->factor[i];
    if (s->what == GAUSSIANS)
        k->opacity = (double)(float)random_in(seed, 0.2, 0.9);
    else
        k->mass = s->what == SHELL ? 8 : -log1p(-point_opacity);
    set_color(s->what == STREAKS ? 1 : pattern(p), k->color);
}

static bool is_opaque(const struct close_shape *s, const double p[3]) {
    return depth_in(s->is_gyroid, p) >= 0;
}

/* True if the shape has a kernel at a place of the lattice. */
static bool has_kernel(const struct close_shape *s, const double p[3]) {
    const double depth = depth_in(s->is_gyroid, p);
    if (s->what != SHELL)
        return depth >= 0 && depth < 2;
    bool is_border = false;
    for (int side = 0; side < 6; side++) {
        double q[3] = { p[0], p[1], p[2] };
        q[side / 2] += side % 2 ? 1 : -1;
        is_border |= fabs(q[side / 2]) > SIDE / 2.0 || !is_opaque(s, q);
    }
    return depth >= 0 && is_border;
}

static void make_kernels(struct close_shape *s) {
    const double middle = (SIDE - 1) / 2.0;
    unsigned seed = 3;
    s->kernels = calloc(KERNELS, sizeof *s->kernels);
    assert_non_null(s->kernels);
    for (int i = 0; i < SIDE * SIDE * SIDE; i++) {
        const double p[3] = { i % SIDE - middle, i / SIDE % SIDE - middle,
                              i / SIDE / SIDE - middle };
        if (!has_kernel(s, p))
            continue;
        assert_compare(s->count, <, KERNELS);
        make_kernel(s, p, &seed, &s->kernels[s->count++]);
    }
}

static struct sp_volume *make_elements(const struct close_shape *s) {
    struct sp_elements e = { .shape = { .kind = is_points(s) ? SP_KIND_POINTS : SP_KIND_GAUSSIANS,
                                        .count = s->count } };
    const double harmonic = 0.5 / sqrt(M_PI);
    float *numbers = calloc((size_t)s->count * 5, sizeof *numbers);
    e.positions = calloc(s->count, sizeof *e.positions);
    e.factors = calloc(s->count, sizeof *e.factors);
    assert_true(numbers && e.positions && e.factors);
    e.values = is_points(s) ? numbers : NULL;
    e.volumes = is_points(s) ? numbers + s->count : NULL;
    e.opacities = s->what == GAUSSIANS ? numbers : NULL;
    e.harmonics = s->what == GAUSSIANS ? numbers + s->count : NULL;
    e.shape.has_vectors = s->what == STREAKS;
    if (e.shape.has_vectors)
        e.vectors = calloc(s->count, sizeof *e.vectors);
    for (unsigned n = 0; n < s->count; n++) {
        const struct test_kernel *k = &s->kernels[n];
        if (e.vectors)
            e.vectors[n][0] = 1;
        for (int r = 0; r < 3; r++)
            e.positions[n][r] = (float)k->position[r];
        for (int i = 0; i < 6; i++)
            e.factors[n][i] = (float)k->factor[i];
        numbers[n] = (float)(is_points(s) ? k->color[0] : k->opacity);
        if (is_points(s))
            e.volumes[n] = 1;
        for (int c = 0; c < 3 && e.harmonics; c++)
            e.harmonics[3 * n + (unsigned)c] = (float)((k->color[c] - 0.5) / harmonic);
    }
    struct sp_volume *volume = sp_volume_create_elements(&e, names[s->what], NULL);
    free(e.positions);
    free(e.factors);
    free(e.vectors);
    free(numbers);
    return volume;
}

static void set_points(struct close_shape *s) {
    struct sp_transfer_function *tf = &s->view.transfer_function;
    tf->reference_length = 1;
    const float opacity = s->what == SHELL ? 0.999f : (float)point_opacity;
    tf->point_count = 3;
    tf->points[0] = (struct sp_tf_point){ -1e-5, { 0, 0.5f, 1 }, 0 };
    for (int i = 0; i < 2; i++)
        tf->points[i + 1] = (struct sp_tf_point){ i, { (float)i, 0.5f, 1 - (float)i }, opacity };
}

/* Streaks of the colour of the points, which therefore do not show. */
static void set_streaks(struct sp_layer *layer) {
    *layer = sp_layer_default(SP_LAYER_VECTORS);
    layer->style = SP_VECTORS_BLEND;
    layer->stretch = layer->density = 1;
    layer->color[0] = 1;
    layer->color[1] = 0.5f;
    layer->color[2] = 0;
}

static void set_view(struct close_shape *s) {
    test_view_init(&s->view);
    s->view.size[0] = s->view.size[1] = 56;
    s->view.filter.lowpass = 0;
    s->view.filter.sigma = deviation;
    s->view.level_of_detail = SP_LOD_OFF;
    s->view.layer_count = 1;
    s->view.layers[0] = sp_layer_default(s->what == POINTS      ? SP_LAYER_POINTS
                                         : s->what == GAUSSIANS ? SP_LAYER_GAUSSIANS
                                                                : SP_LAYER_SHELL);
    if (s->what == STREAKS)
        set_streaks(&s->view.layers[0]);
    s->view.layers[0].low = s->view.layers[0].high = 0.5;
    s->view.camera.fov_y = 60;
    s->view.camera.near = 0.1;
    set_points(s);
}

static void open_shape(struct close_shape *s) {
    struct test_scene scene = { 0 };
    set_view(s);
    make_kernels(s);
    if (s->what != SHELL) {
        s->volume = make_elements(s);
    } else {
        assert_true(test_scene_voxels(&scene, "shape", (uint32_t[]){ SIDE, SIDE, SIDE },
                                      (double[]){ 1, 1, 1 }, SP_FLOAT32, shape_value, s));
        s->volume = test_scene_volume(&scene, NULL);
        test_scene_finish(&scene);
    }
    assert_non_null(s->volume);
}

static void set_camera(struct sp_camera *camera, const double from[3], const double ahead[3],
                       const double up[3]) {
    for (int r = 0; r < 3; r++) {
        camera->position[r] = from[r];
        camera->target[r] = from[r] + ahead[r];
        camera->up[r] = up[r];
    }
}

/* The eye at a height above the ball [voxels], looking along it, 20 degrees down; or in a channel
 * of the gyroid, turned by degrees. */
static void see_shape(struct close_shape *s, double at, double fov_y) {
    const double out[3] = { 0.48, 0.6, 0.64 }, along[3] = { 0.8, 0, -0.6 };
    const double tilt = 20 * M_PI / 180, turn = at * M_PI / 180;
    double from[3], ahead[3];
    s->view.camera.fov_y = fov_y;
    if (s->is_gyroid) {
        set_camera(&s->view.camera, (double[]){ 3.5 - 5, 1.5 - 5, 0.5 - 5 },
                   (double[]){ cos(turn), 0.3, sin(turn) }, (double[]){ 0, 1, 0 });
        return;
    }
    for (int r = 0; r < 3; r++) {
        from[r] = (RADIUS + at) * out[r];
        ahead[r] = cos(tilt) * along[r] - sin(tilt) * out[r];
    }
    set_camera(&s->view.camera, from, ahead, out);
}

/* Voxels of a shell are drawn slice by slice, row by row, and voxel by voxel, each away from the
 * eye (draw/layers/splat_list/order.h). */
static void rank_voxels(struct close_shape *s) {
    static const int orders[3][3] = { { 0, 2, 1 }, { 1, 2, 0 }, { 2, 1, 0 } };
    const struct sp_camera *c = &s->view.camera;
    int major = 0;
    for (int a = 1; a < 3; a++)
        if (fabs(c->target[a] - c->position[a]) > fabs(c->target[major] - c->position[major]))
            major = a;
    for (unsigned n = 0; n < s->count; n++) {
        double rank = 0;
        for (int i = 0; i < 3; i++) {
            const int a = orders[major][i];
            rank = 1000 * rank + fabs(s->kernels[n].position[a] - c->position[a]);
        }
        s->kernels[n].rank = rank;
    }
}

static struct close_shape shapes[2 * WHATS];

/* Heights above the ball, and turns in the gyroid; floors half a decibel below the measured values
 * [dB]. */
static const struct row {
    bool is_gyroid;
    double at, fov_y;
    double floors[WHATS];
} rows[] = {
    { false, 8, 60, { 55.3, 39.6, 41.8, 39.0 } },   { false, 4, 60, { 65.0, 38.7, 42.1, 35.6 } },
    { false, 2, 60, { 64.2, 43.8, 50.3, 28.7 } },   { false, 1, 60, { 63.7, 49.9, 60.1, 33.6 } },
    { false, 0.3, 60, { 62.4, 57.9, 61.6, 28.3 } }, { true, 100, 60, { 57.0, 39.1, 45.3, 39.9 } },
    { true, 220, 60, { 54.0, 41.9, 42.4, 42.1 } },  { false, 1, 120, { 65.7, 49.7, 54.5, 32.2 } },
    { false, 4, 150, { 68.0, 46.1, 47.2, 22.4 } },
};
enum { ROWS = sizeof rows / sizeof *rows };
static struct test_image wanted[ROWS][WHATS];

static struct close_shape *shape_of(const struct row *row, int what) {
    return &shapes[row->is_gyroid ? WHATS + what : what];
}

static int open_shapes(void **state) {
    (void)state;
    for (int i = 0; i < 2 * WHATS; i++) {
        shapes[i].what = (enum what)(i % WHATS);
        shapes[i].is_gyroid = i >= WHATS;
        open_shape(&shapes[i]);
    }
    for (int i = 0; i < ROWS; i++)
        for (int what = 0; what < WHATS; what++) {
            struct close_shape *s = shape_of(&rows[i], what);
            see_shape(s, rows[i].at, rows[i].fov_y);
            if (what == SHELL)
                rank_voxels(s);
            assert_true(test_kernels_render(s->kernels, s->count, &s->view,
                                            what == GAUSSIANS ? 0.3 : 0, &wanted[i][what]));
        }
    return 0;
}

static int close_shapes(void **state) {
    (void)state;
    for (int i = 0; i < 2 * WHATS; i++) {
        sp_volume_unref(&shapes[i].volume);
        free(shapes[i].kernels);
    }
    for (int i = 0; i < ROWS * WHATS; i++)
        test_image_finish(&wanted[i / WHATS][i % WHATS]);
    return 0;
}

static unsigned compare_all(const struct test_target *target,
                            const struct test_renderer *renderer) {
    unsigned failures = 0;
    for (int i = 0; i < ROWS * WHATS; i++) {
        const struct row *row = &rows[i / WHATS];
        const int what = i % WHATS;
        struct close_shape *s = shape_of(row, what);
        struct test_image got;
        struct sp_error err;
        see_shape(s, row->at, row->fov_y);
        if (!test_render(renderer, s->volume, &s->view, &got, &err))
            fail_msg("%s: %s", names[what], err.text);
        const double db = test_image_psnr(&got, &wanted[i / WHATS][what]);
        printf("%s %s, %s, %s %g, field of view %g: %.1f dB\n", target->backend, target->isa,
               names[what], row->is_gyroid ? "turn" : "height", row->at, s->view.camera.fov_y, db);
        if (!(db >= row->floors[what])) {
            char name[64];
            snprintf(name, sizeof name, "%s %s %s %g", target->backend, target->isa, names[what],
                     row->at);
            test_image_dump(name, &got, &wanted[i / WHATS][what], 4);
        }
        failures += !(db >= row->floors[what]);
        test_image_finish(&got);
    }
    return failures;
}

static void splats_near_the_eye_are_exact(void **state) {
    (void)state;
    assert_int_equal(test_check_targets(2, compare_all), 0);
}

/* The bend of the error of three frames. */
static double bend_of_error(struct close_shape *s, const struct test_image frames[3], double height,
                            double step) {
    struct test_image errors[3];
    for (int i = 0; i < 3; i++) {
        see_shape(s, height + (2 - i) * step, 60);
        assert_true(test_kernels_render(s->kernels, s->count, &s->view,
                                        s->what == GAUSSIANS ? 0.3 : 0, &errors[i]));
        for (size_t k = 0; k < (size_t)errors[i].width * errors[i].height * 4; k++)
            errors[i].rgba[k] -= frames[i].rgba[k];
    }
    const double bend = test_image_bend(errors);
    for (int i = 0; i < 3; i++)
        test_image_finish(&errors[i]);
    return bend;
}

/* The largest bend while the eye comes down to the ball. Where it is not below the bound, the exact
 * image may bend as much: then that of the error counts.
 *
 * Every frame runs the same code: a sanitizer sees the first ones. */
enum { FRAMES = TEST_SANITIZED ? 10 : 100 };
static double measure_bend(const struct test_renderer *renderer, struct close_shape *s, double from,
                           double step, double bound, double *where) {
    struct test_image frames[3] = { { 0 } };
    double worst = 0;
    for (int i = 0; i < FRAMES; i++) {
        const double height = from - step * i;
        test_image_finish(&frames[0]);
        frames[0] = frames[1];
        frames[1] = frames[2];
        see_shape(s, height, 60);
        assert_true(test_render(renderer, s->volume, &s->view, &frames[2], NULL));
        double bend = i < 2 ? 0 : test_image_bend(frames);
        bend = bend < bound ? bend : bend_of_error(s, frames, height, step);
        *where = bend > worst ? height : *where;
        worst = fmax(worst, bend);
    }
    for (int i = 0; i < 3; i++)
        test_image_finish(&frames[i]);
    return worst;
}

/* Kernels become exact, contain the eye and are left behind. The order of points and Gaussians
 * stays, because only the eye moves. */
static void nothing_jumps_where_kernels_become_exact(void **state) {
    static const struct {
        double from, step, bounds[2];
    } ways[] = { { 8, 0.04, { 0.02, 0.025 } }, { 1.2, 0.01, { 0.013, 0.013 } } };
    struct test_renderer renderer;
    (void)state;
    assert_true(test_renderer_open(&renderer, &(struct test_target){ "cpu", "auto" }, 2, NULL));
    for (size_t w = 0; w < sizeof ways / sizeof *ways; w++)
        for (int what = POINTS; what <= GAUSSIANS; what++) {
            double where = 0;
            const double worst = measure_bend(&renderer, &shapes[what], ways[w].from, ways[w].step,
                                              ways[w].bounds[what], &where);
            printf("%s, from %g above a ball, in steps of %g: a pixel bends by %.4f at most, at "
                   "%.3f\n",
                   names[what], ways[w].from, ways[w].step, worst, where);
            assert_compare(worst, <, ways[w].bounds[what]);
        }
    test_renderer_close(&renderer);
}

/* The largest mean change of a pixel between two frames, while the eye comes down to the ball. */
static double measure_change(const struct test_renderer *renderer, struct close_shape *s,
                             double *where) {
    struct test_image frames[2] = { { 0 } };
    double worst = 0;
    for (int i = 0; i < 300; i++) {
        const double height = 3.2 - 0.01 * i;
        double change = 0;
        test_image_finish(&frames[0]);
        frames[0] = frames[1];
        see_shape(s, height, 60);
        assert_true(test_render(renderer, s->volume, &s->view, &frames[1], NULL));
        const size_t n = (size_t)frames[1].width * frames[1].height * 4;
        for (size_t k = 0; k < n && i > 0; k++)
            change += fabs(frames[1].rgba[k] - frames[0].rgba[k]) / (double)n;
        *where = change > worst ? height : *where;
        worst = fmax(worst, change);
    }
    test_image_finish(&frames[0]);
    test_image_finish(&frames[1]);
    return worst;
}

/* Squares of a shell in `fast` detail have no truth near the eye. But they grow slowly, and none
 * appears or vanishes at once. */
static void squares_near_the_eye_change_slowly(void **state) {
    struct close_shape *s = &shapes[SHELL];
    struct test_target target;
    (void)state;
    s->view.layers[0].detail = SP_SHELL_FAST;
    for (unsigned t = 0; test_target_at(t, &target); t++) {
        struct test_renderer renderer;
        double where = 0;
        if (!test_renderer_open(&renderer, &target, 2, NULL))
            continue;
        const double worst = measure_change(&renderer, s, &where);
        printf("%s %s: squares change pixels by %.4f in the mean at most, at a height of %.2f\n",
               target.backend, target.isa, worst, where);
        assert_compare(worst, <, 0.03);
        test_renderer_close(&renderer);
    }
    s->view.layers[0].detail = SP_SHELL_HIGH;
}

/* The largest |a − b| of a channel of two differences, a from b's frame before. */
static double change_of(const struct test_image *got, const struct test_image *exact,
                        double *before, bool is_first) {
    const size_t n = (size_t)got->width * got->height * 4;
    double most = 0;
    for (size_t i = 0; i < n; i++) {
        const double error = got->rgba[i] - exact->rgba[i];
        most = is_first ? 0 : fmax(most, fabs(error - before[i]));
        before[i] = error;
    }
    return most;
}

/* One kernel, which ends where it is invisible. */
static void open_single(struct close_shape *s) {
    static const double factor[6] = { 1.1, 0.3, 0.7, -0.2, 0.25, 0.6 };
    *s = (struct close_shape){ .what = s->what, .count = 1 };
    s->kernels = calloc(1, sizeof *s->kernels);
    assert_non_null(s->kernels);
    *s->kernels = (struct test_kernel){ .opacity = s->what == GAUSSIANS ? 0.95 : 0,
                                        .mass = s->what == GAUSSIANS ? 0 : -log1p(-point_opacity) };
    for (int i = 0; i < 6; i++)
        s->kernels->factor[i] = (double)(float)factor[i];
    set_color(1, s->kernels->color);
    set_view(s);
    s->view.filter.cutoff = 6;
    s->volume = make_elements(s);
    assert_non_null(s->volume);
}

/* The view of a kernel by an eye that passes it at a distance of x. */
static void pass_kernel(struct close_shape *s, double x, double z) {
    set_camera(&s->view.camera, (double[]){ x, -0.4 * x, z }, (double[]){ 0, 0, 1 },
               (double[]){ 0, -1, 0 });
}

/* How much the error of a pixel changes at most while an eye passes a kernel. */
static double measure_pass(const struct test_renderer *renderer, struct close_shape *s, double x,
                           double *where) {
    /* It passes the kernel after 280 steps. A sanitizer sees the last ones. */
    enum { FIRST = TEST_SANITIZED ? 260 : 0, STEPS = 320 };
    static double before[56 * 56 * 4];
    double worst = 0;
    for (int step = FIRST; step < STEPS; step++) {
        struct test_image got, exact;
        pass_kernel(s, x, -28 + 0.1 * step);
        assert_true(test_render(renderer, s->volume, &s->view, &got, NULL));
        assert_true(
            test_kernels_render(s->kernels, 1, &s->view, s->what == GAUSSIANS ? 0.3 : 0, &exact));
        const double change = change_of(&got, &exact, before, step == FIRST);
        *where = change > worst ? -28 + 0.1 * step : *where;
        worst = fmax(worst, change);
        test_image_finish(&got);
        test_image_finish(&exact);
    }
    return worst;
}

/* Between two frames the error hardly changes, also where the kernel is beside the image of a wide
 * view. Gaussians end where their opacity is a level of 8 bits, so that theirs changes by more. */
static void the_error_of_one_kernel_never_jumps(void **state) {
    static const struct {
        double fov_y, aside;
    } ways[] = { { 60, 0 },   { 60, 1.5 }, { 60, 6 },   { 120, 6 }, { 120, 12 },
                 { 120, 20 }, { 150, 12 }, { 150, 20 }, { 150, 30 } };
    enum { WAYS = sizeof ways / sizeof *ways };
    struct test_renderer renderer;
    (void)state;
    assert_true(test_renderer_open(&renderer, &(struct test_target){ "cpu", "auto" }, 2, NULL));
    for (int i = 0; i < 2 * WAYS; i++) {
        struct close_shape s = { .what = (enum what)(i % 2) };
        double where = 0;
        open_single(&s);
        s.view.camera.fov_y = ways[i / 2].fov_y;
        const double worst = measure_pass(&renderer, &s, ways[i / 2].aside, &where);
        printf("one of the %s, field of view %g, %g aside: the error changes by %.5f at most, at "
               "%.1f\n",
               names[s.what], ways[i / 2].fov_y, ways[i / 2].aside, worst, where);
        assert_compare(worst, <, s.what == GAUSSIANS ? 4 / 255.0 : 0.001);
        sp_volume_unref(&s.volume);
        free(s.kernels);
    }
    test_renderer_close(&renderer);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(splats_near_the_eye_are_exact),
        cmocka_unit_test(nothing_jumps_where_kernels_become_exact),
        cmocka_unit_test(squares_near_the_eye_change_slowly),
        cmocka_unit_test(the_error_of_one_kernel_never_jumps),
    };
    return cmocka_run_group_tests(tests, open_shapes, close_shapes);
}
