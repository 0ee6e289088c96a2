/* SPDX-License-Identifier: Apache-2.0
 *
 * Post-convolved sheets except their kernels: tables, filters of bricks, and the tiles of bricks.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "support/compare.h"
#include "support/postconv.h"

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

static struct sp_postconv_tables *make_tables(void) {
    struct sp_postconv_tables *t = aligned_alloc(64, (sizeof *t + 63) & ~(size_t)63);
    assert_non_null(t);
    sp_postconv_tables_init(t);
    return t;
}

static void near_to(double got, double wanted, double slack) {
    if (!(fabs(got - wanted) <= slack))
        fail_msg("%g for %g, slack %g", got, wanted, slack);
}

/* Σ weight[k]·(k + from − centre)^power. */
static double moment(const float *weight, int n, double from, int power) {
    double sum = 0;
    for (int k = 0; k < n; k++)
        sum += (double)weight[k] * pow(k + from, power);
    return sum;
}

/* A deposit has weight 1, the position of its voxel, and the same variance for all phases. Its
 * derivatives change only variances. */
static void deposits_keep_weight_and_place(void **state) {
    (void)state;
    struct sp_postconv_tables *t = make_tables();
    for (int p = 0; p < POSTCONV_PHASES; p++) {
        double from = -1 - (p + 0.5) / POSTCONV_PHASES;
        const float *spline = t->spline[p], *bend = t->spline[p] + 4, *slope = t->slope[p];
        near_to(moment(spline, 4, from, 0), 1, 3e-7);
        near_to(moment(spline, 4, from, 1), 0, 1e-6);
        near_to(moment(spline, 4, from, 2), 1.0 / 3, 2e-6);
        near_to(moment(bend, 4, from, 0), 0, 3e-7);
        near_to(moment(bend, 4, from, 1), 0, 1e-6);
        near_to(moment(bend, 4, from, 2), 1, 2e-6);
        near_to(moment(slope, 4, from, 0), 0, 3e-7);
        near_to(fabs(moment(slope, 4, from, 1)), 1, 1e-6);
        near_to(moment(slope, 4, from, 2), 0, 2e-6);
        for (int k = 0; k < 4; k++)
            assert_compare(spline[k], >=, 0);
    }
    free(t);
}

/* Interpolation keeps constants and linear functions. */
static void interpolation_keeps_lines(void **state) {
    (void)state;
    struct sp_postconv_tables *t = make_tables();
    for (int j = 1; j < POSTCONV_SCALES; j++)
        for (int p = 0; p < 1 << j; p++) {
            const float *between = t->between[j][p];
            double from = -1 - (p + 0.5) / (1 << j);
            near_to(moment(between, 4, from, 0), 1, 3e-7);
            near_to(moment(between, 4, from, 1), 0, 1e-6);
            near_to(moment(between, 4, from, 2), 0.25, 2e-6);
        }
    free(t);
}

static void filters_have_their_variance(void **state) {
    (void)state;
    struct sp_postconv_tables *t = make_tables();
    for (int i = 0; i < 2; i++)
        for (int n = 0; n < POSTCONV_FILTERS; n++) {
            const struct sp_postconv_filter *f = &t->filters[i][n];
            int taps = 2 * f->taps + 1;
            assert_in_range(f->taps, 0, POSTCONV_TAPS);
            assert_compare((f->taps > 0), ==, (n > 0));
            near_to(moment(f->weight, taps, -f->taps, 0), 1, 1e-6);
            near_to(moment(f->weight, taps, -f->taps, 2), (double)n / POSTCONV_STEPS, 2e-5);
            for (int k = 0; k <= f->taps; k++) {
                assert_compare(f->weight[f->taps + k], ==, f->weight[f->taps - k]);
                assert_compare(f->weight[f->taps + k], >=, 0);
                assert_true((k == 0 || f->weight[f->taps + k] <= f->weight[f->taps + k - 1]));
            }
        }
    free(t);
}

/* Checks a group for its kernel: it lies inside the margins of the scratch memory, and has the
 * variance of its footprints, as far as deposits allow. */
static void check_group(const struct sp_postconv_group *g, const double v[3], double deviations) {
    double narrowest = INFINITY;
    for (int a = 0; a < 2; a++) {
        double size = (double)(1 << g->scale[a]);
        assert_in_range(g->scale[a], 0, POSTCONV_SCALES - 1);
        assert_non_null(g->filter[a]);
        near_to((double)g->per_px[a], 1 / size, 0);
        near_to((double)g->reference[a], v[a], 1e-5 * v[a]);
        /* Half a step of the filters, or a deposit that is narrower than its B-spline. */
        double rest = v[a] / size / size - (double)g->base[a];
        assert_compare(rest, >, -0.051 - 0.5 / POSTCONV_STEPS);
        assert_compare(rest, <, 0.501 / POSTCONV_STEPS);
        int reach = g->filter[a]->taps + (g->diagonal ? g->diagonal->taps : 0);
        assert_compare(reach + 6, <=, POSTCONV_MARGIN);
        /* A voxel outside [low, high] adds nothing to the tile, or less than the cutoff keeps. */
        double around = deviations * sqrt(v[a]) * (double)g->per_px[a] - 1e-4;
        double end = (double)g->offset[a] + POSTCONV_TILE * (double)g->per_px[a];
        assert_compare((double)g->low[a], <=,
                       fmax(POSTCONV_MARGIN - reach - 2, (double)g->offset[a] - around));
        assert_compare(
            (double)g->high[a], >=,
            fmin(POSTCONV_MARGIN + (POSTCONV_TILE >> g->scale[a]) + reach + 2, end + around));
        assert_compare(g->low[a], >=, 2);
        assert_compare(g->high[a], <=, POSTCONV_GRID - 2);
        narrowest = fmin(narrowest, v[a] / size / size);
    }
    double cross = v[2] * (double)g->per_px[0] * (double)g->per_px[1];
    double rest = fabs(cross - (double)g->cross);
    assert_true(g->has_cross || fabs(cross) <= 0.0201 * narrowest);
    assert_true(g->diagonal ? rest <= 0.501 / POSTCONV_STEPS : g->cross == 0);
    assert_true(g->diagonal || fabs(cross) <= fmax(0.101 * narrowest, 0.501 / POSTCONV_STEPS));
    assert_compare(g->range[0], <=, g->middle);
    assert_compare(g->middle, <=, g->range[1]);
}

static void every_footprint_has_filters_or_none(void **state) {
    (void)state;
    struct sp_postconv_tables *t = make_tables();
    srand(21);
    unsigned made = 0;
    for (int n = 0; n < 200000; n++) {
        const struct sp_level_frame part = { .ewa[0].radius = 3 };
        struct sp_postconv s = { .tables = t,
                                 .exact = n % 2,
                                 .smooth = { n % 2 ? 1.3f : 0.56f, n % 2 ? 1.3f : 1 },
                                 .reach = n % 2 ? 4 : 3,
                                 .parts = &part };
        double spread = pow(10, uniform(-4, 6)), longer = n % 3 ? 1 : pow(10, uniform(0, 4));
        double v[3] = { spread, spread * longer };
        v[2] = n % 5 == 0 ? sqrt(v[0] * v[1]) * uniform(-1, 1) : 0;
        if (n % 7 < 3) {
            double first = v[0];
            v[0] = v[1];
            v[1] = first;
        }
        struct sp_postconv_brick b = { .scale = 1,
                                       .spread = { (float)v[0], (float)v[1], (float)v[2] },
                                       .scale_max = { POSTCONV_SCALES - 1, POSTCONV_SCALES - 1 } };
        struct sp_postconv_group g;
        const float range[2] = { 1, 1 };
        bool is_made = sp_postconv_group_init(&s, &b, range, &g);
        if (is_made) {
            made++;
            check_group(&g, v, (double)s.reach);
            assert_int_equal(sp_postconv_group_fits(&g, &b, range), 2);
        }
        /* Round footprints have filters, from the variance of a B-spline to the width of a tile. */
        if (longer == 1 && v[2] == 0 && spread >= 1.0 / 3 && spread < 64 * 64)
            assert_true(is_made);
        if (fmin(v[0], v[1]) < 1.0 / 3 - 0.06)
            assert_false(is_made);
    }
    assert_compare(made, >, 40000);
    free(t);
}

/* A group accepts exactly the voxels between its ends. */
static void a_group_serves_its_range(void **state) {
    (void)state;
    struct sp_postconv_tables *t = make_tables();
    srand(22);
    for (int n = 0; n < 20000; n++) {
        const struct sp_level_frame part = { .ewa[0].radius = 3 };
        struct sp_postconv s = {
            .tables = t, .exact = n % 2, .smooth = { 1.3f, 1.3f }, .parts = &part
        };
        struct sp_postconv_brick b = { .scale = 1,
                                       .spread = { (float)uniform(0.5, 9), (float)uniform(0.5, 9) },
                                       .scale_max = { 6, 6 } };
        float low = (float)uniform(0.9, 1.1), range[2] = { low, low * (float)uniform(1, 1.3) };
        struct sp_postconv_group g;
        if (!sp_postconv_group_init(&s, &b, range, &g))
            continue;
        int fits = sp_postconv_group_fits(&g, &b, range);
        assert_int_equal(fits, g.range[1] >= range[1] ? 2 : 1);
        assert_compare(g.range[0], <=,
                       range[0]); /* as the farthest voxels are accepted, all others are */
        const float beside[2][2] = { { 0.5f * g.range[0], 0.9f * g.range[0] },
                                     { 1.1f * g.range[1], 2 * g.range[1] } };
        assert_int_equal(sp_postconv_group_fits(&g, &b, beside[0]), 0);
        assert_int_equal(sp_postconv_group_fits(&g, &b, beside[1]), 0);
        struct sp_postconv_brick other = b;
        other.spread[n % 2] *= 1.5f;
        assert_int_equal(sp_postconv_group_fits(&g, &other, range), 0);
    }
    free(t);
}

/* Counts the calls of the tile function. */
struct count {
    atomic_uint tiles, missed, needed;
    atomic_bool cancel;
};

/* True if tile (column, row) meets the brick. */
static bool is_met(const struct sp_postconv *s, int column, int row, uint32_t brick) {
    uint32_t tile = (uint32_t)(row * s->columns + column);
    for (uint32_t n = s->first[tile]; n < s->first[tile + 1]; n++)
        if (s->bricks[s->met[n]].brick == brick)
            return true;
    return false;
}

/* Marks each tile that the box of a footprint of the brick touches. */
static void check_brick(const struct sp_postconv *s, uint32_t brick, struct count *count) {
    enum { COUNT = 256 };
    const struct test_postconv *t = test_postconv_of(s);
    const struct sp_level *level = s->parts[0].level;
    const struct sp_visible *list = &level->visible;
    uint32_t entries = (uint32_t)(list->first[brick + 1] - list->first[brick]);
    static struct sp_splat splats[COUNT];
    struct sp_splats out = { .splat = splats };
    uint16_t local[COUNT];
    struct sp_ewa_run run = { .list = list,
                              .local = local,
                              .transfer = &level->transfer,
                              .first = list->first[brick],
                              .mode = t->modes ? (enum sp_filter_mode)t->modes[brick]
                                               : t->view->filter.mode };
    sp_visible_brick_corner(list->bricks, brick, run.brick);
    for (; run.begin < entries; run.begin += COUNT) {
        run.count = entries - run.begin < COUNT ? entries - run.begin : COUNT;
        sp_visible_locals(list, brick, NULL, run.begin, run.count, local);
        uint32_t n = sp_ewa_set_up(&s->parts[0].ewa[0], &run, &out);
        for (uint32_t i = 0; i < n; i++)
            for (int r = splats[i].y0 / POSTCONV_TILE; r <= (splats[i].y1 - 1) / POSTCONV_TILE; r++)
                for (int c = splats[i].x0 / POSTCONV_TILE; c <= (splats[i].x1 - 1) / POSTCONV_TILE;
                     c++) {
                    atomic_fetch_add(&count->needed, 1);
                    atomic_fetch_add(&count->missed, !is_met(s, c, r, brick));
                }
    }
}

static void check_lists(const struct sp_postconv *s, struct sp_postconv_scratch *scratch,
                        uint32_t tile) {
    (void)scratch;
    struct count *count = test_postconv_of(s)->user;
    atomic_fetch_add(&count->tiles, 1);
    for (uint32_t b = 0; tile == 0 && b < sp_visible_bricks(&s->parts[0].level->visible); b++)
        check_brick(s, b, count);
}

static double waves(const void *user, double x, double y, double z) {
    (void)user;
    return 0.5 + 0.5 * sin(0.3 * x + 0.2 * y) * cos(0.25 * z);
}

static void make_scene(struct test_scene *s, int n) {
    test_view_init(&s->view);
    assert_true(test_scene_voxels(
        s, "waves", (uint32_t[]){ 20 + (uint32_t)n % 40, 37, 50 - (uint32_t)n % 30 },
        (double[]){ 1, uniform(0.5, 2), uniform(0.5, 2) }, SP_UINT8, waves, NULL));
    test_scene_points(s, (const double[][5]){ { 0, 1, 1, 1, 0.2 }, { 1, 1, 0, 0, 0.6 } }, 2);
    test_scene_direction(s, (double[]){ uniform(-90, 90), uniform(-90, 90), 0 }, n % 2 ? 1 : -1,
                         n % 3 ? 0 : uniform(-0.5, 0.5));
    test_scene_orbit(s, NULL, uniform(-180, 180), uniform(-80, 80), uniform(1, 150));
    struct sp_view *v = &s->view;
    v->size[0] = 1 + (uint32_t)uniform(0, 400);
    v->size[1] = 1 + (uint32_t)uniform(0, 400);
    v->camera.projection = n % 3 == 0 ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
    v->camera.height = uniform(3, 200);
    v->camera.fov_y = uniform(3, n % 5 ? 60 : 170);
    v->camera.near = n % 4 ? 1e-3 : 1;
    v->filter.mode = (enum sp_filter_mode)(n % 5); /* almost none */
    v->filter.sigma = uniform(0.4, 1.5);
    v->filter.cutoff = n % 7 ? 3 : 6;
    v->filter.lowpass = uniform(0.1, 2);
}

static void tiles_meet_every_brick_that_reaches_them(void **state) {
    (void)state;
    srand(23);
    unsigned needed = 0;
    for (int n = 0; n < 120; n++) {
        struct test_scene scene;
        struct count count = { 0 };
        struct sp_error err;
        make_scene(&scene, n);
        struct test_postconv *t = test_postconv_open(&scene, 2, &err);
        if (!t)
            fail_msg("%s", err.text);
        t->user = &count;
        assert_true(test_postconv_draw(t, check_lists, NULL, &err));
        const uint32_t *size = scene.view.size;
        assert_int_equal(count.tiles, (size[0] + POSTCONV_TILE - 1) / POSTCONV_TILE *
                                          ((size[1] + POSTCONV_TILE - 1) / POSTCONV_TILE));
        if (count.missed)
            fail_msg("scene %d: %u of %u pairs of tile and footprint are missed", n, count.missed,
                     count.needed);
        needed += count.needed;
        test_postconv_close(t);
        test_scene_finish(&scene);
    }
    assert_compare(needed, >, 100000);
}

static void note_work(const struct sp_postconv *s, struct sp_postconv_scratch *scratch,
                      uint32_t tile) {
    (void)scratch, (void)tile;
    atomic_store((atomic_bool *)test_postconv_of(s)->user, sp_postconv_is_worthwhile(s));
}

/* Filters cannot draw voxels that are seen from many directions, for example around the camera.
 * They cannot draw dense voxels either, which are visible beyond the cutoff of their footprints. */
static void views_that_filters_cannot_draw_use_footprints(void **state) {
    (void)state;
    srand(26);
    for (int n = 0; n < 20; n++) {
        struct test_scene scene;
        struct sp_error err;
        bool is_near = n % 2, is_deep = n % 4 == 2;
        atomic_bool pays = is_near || is_deep;
        test_view_init(&scene.view);
        assert_true(test_scene_voxels(&scene, "waves", (uint32_t[]){ 50, 50, 50 },
                                      (double[]){ 1, 1, 1 }, SP_UINT8, waves, NULL));
        test_scene_points(&scene, (const double[][5]){ { 0, 1, 1, 1, 0.2 }, { 1, 1, 0, 0, 0.6 } },
                          2);
        test_scene_orbit(&scene, NULL, uniform(-180, 180), uniform(-80, 80), is_near ? 2 : 150);
        scene.view.size[0] = scene.view.size[1] = 200;
        scene.view.camera.fov_y = is_near ? 100 : 30;
        scene.view.transfer_function.reference_length = is_deep ? 0.01 : 1;
        struct test_postconv *t = test_postconv_open(&scene, 2, &err);
        assert_non_null(t);
        t->user = &pays;
        assert_true(test_postconv_draw(t, note_work, NULL, &err));
        assert_int_equal(atomic_load(&pays), !is_near && !is_deep);
        test_postconv_close(t);
        test_scene_finish(&scene);
    }
}

static void ask_to_stop(const struct sp_postconv *s, struct sp_postconv_scratch *scratch,
                        uint32_t tile) {
    (void)scratch, (void)tile;
    struct count *count = test_postconv_of(s)->user;
    atomic_fetch_add(&count->tiles, 1);
    atomic_store(&count->cancel, true);
}

static void no_tile_begins_after_cancel(void **state) {
    (void)state;
    struct test_scene scene;
    struct sp_error err;
    srand(24);
    make_scene(&scene, 3);
    scene.view.size[0] = scene.view.size[1] = 640;
    struct test_postconv *t = test_postconv_open(&scene, 2, &err);
    assert_non_null(t);
    struct count count = { 0 };
    t->user = &count;
    assert_false(test_postconv_draw(t, ask_to_stop, &count.cancel, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    assert_in_range(count.tiles, 1, 2); /* of 100; each thread has started one at most */
    test_postconv_close(t);
    test_scene_finish(&scene);
}

static void views_with_footprints_are_left_to_them(void **state) {
    (void)state;
    struct test_scene s;
    struct sp_view view;
    double even[20] = { 0 };
    srand(25);
    make_scene(&s, 1);
    assert_true(sp_postconv_can_draw(&s.view, &s.info.grid));
    for (int k = 0; k < 8; k++) {
        view = s.view;
        struct sp_grid grid = s.info.grid;
        if (k == 0)
            view.compositing.mode = SP_COMPOSITE_SPLAT;
        if (k == 1)
            view.filter.kernel = SP_KERNEL_CUBIC;
        if (k == 2)
            view.filter.mode = SP_FILTER_NONE;
        if (k == 3)
            view.transfer_function.order = SP_TF_POST;
        if (k == 4)
            view.clip.plane_count = 1;
        if (k == 5)
            view.clip.box[1][2] = 0.75;
        if (k == 6)
            grid.coordinates[0] = even;
        if (k == 7)
            view.filter.cutoff = 2.9;
        assert_false(sp_postconv_can_draw(&view, &grid));
    }
    test_scene_finish(&s);
}

/* A block in a corner of a volume that is uniform otherwise. */
static double corner_block(const void *user, double x, double y, double z) {
    (void)user;
    return x < 6 && y < 6 && z < 30 ? 1 : 0.5;
}

struct pairs {
    atomic_uint joined, alone;
};

static void count_pairs(const struct sp_postconv *s, struct sp_postconv_scratch *scratch,
                        uint32_t tile) {
    (void)scratch;
    struct pairs *p = test_postconv_of(s)->user;
    for (uint32_t k = 0; tile == 0 && k + 1 < s->layers; k++)
        atomic_fetch_add(s->layer[k] == s->layer[k + 1] ? &p->joined : &p->alone, 1);
}

/* Which sheets are merged depends on the view and the whole volume. It stays the same when the
 * densest voxels leave the image. Volumes with fewer sheets are not merged. */
static void merged_sheets_do_not_depend_on_what_is_in_sight(void **state) {
    (void)state;
    for (unsigned n = 0; n < 8; n++) {
        bool deep = n & 1, beside = n & 2;
        uint32_t sheets = n & 4 ? 63 : 64;
        struct test_scene scene;
        struct pairs pairs = { 0 };
        struct sp_error err;
        test_view_init(&scene.view);
        assert_true(test_scene_voxels(&scene, "block", (uint32_t[]){ 32, 32, sheets },
                                      (double[]){ 1, 1, 1 }, SP_UINT8, corner_block, NULL));
        test_scene_points(&scene,
                          (const double[][5]){ { 0, 1, 0, 0, 0 },
                                               { 0.5, 0, 1, 0, 0.5 },
                                               { 1, 0, 0, 1, deep ? 0.8 : 0.6 } },
                          3);
        test_scene_orbit(&scene, NULL, 0, 0, 100);
        struct sp_camera *c = &scene.view.camera;
        c->projection = SP_ORTHOGRAPHIC;
        c->height = 16;
        for (int a = 0; a < 3; a++) {
            c->target[a] = beside ? 24 : 8;
            c->position[a] = c->target[a] - (a == 2 ? 100 : 0);
        }
        c->up[0] = c->up[2] = 0;
        c->up[1] = 1;
        scene.view.filter.mode = SP_FILTER_ADAPTIVE;
        scene.view.size[0] = scene.view.size[1] = 48;
        struct test_postconv *t = test_postconv_open(&scene, 1, &err);
        if (!t)
            fail_msg("%s", err.text);
        t->user = &pairs;
        assert_true(test_postconv_draw(t, count_pairs, NULL, &err));
        assert_int_equal(pairs.joined, deep || sheets < 64 ? 0 : sheets / 2);
        assert_int_equal(pairs.joined + pairs.alone, sheets - 1);
        test_postconv_close(t);
        test_scene_finish(&scene);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(deposits_keep_weight_and_place),
        cmocka_unit_test(interpolation_keeps_lines),
        cmocka_unit_test(filters_have_their_variance),
        cmocka_unit_test(every_footprint_has_filters_or_none),
        cmocka_unit_test(a_group_serves_its_range),
        cmocka_unit_test(tiles_meet_every_brick_that_reaches_them),
        cmocka_unit_test(merged_sheets_do_not_depend_on_what_is_in_sight),
        cmocka_unit_test(views_that_filters_cannot_draw_use_footprints),
        cmocka_unit_test(no_tile_begins_after_cancel),
        cmocka_unit_test(views_with_footprints_are_left_to_them),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
