/* SPDX-License-Identifier: Apache-2.0
 *
 * Compositors of sheets, slabs and single splats, with a few splats whose result is known.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "draw/footprints/footprint.h"
#include "draw/footprints/sheet.h"
#include "draw/footprints/slab.h"
#include "draw/footprints/splat.h"
#include "splat/normal.h"
#include "support/compare.h"

enum { SLOTS = 16, SIZE = SP_TILE };

/* One tile with memory for its layers. */
struct bench {
    struct sp_blend blend;
    float *sums;
    struct sp_box dirty[SLOTS];
    struct sp_tile *tile;
};

static struct bench make_bench(enum sp_compositing mode) {
    struct bench b = { .blend = { .mode = mode,
                                  .planes = SP_PLANES,
                                  .slots = mode == SP_COMPOSITE_SLAB ? SLOTS : 1,
                                  .cut = 4.5f * SP_LOG2E,
                                  .thickness = 1 } };
    b.sums = calloc(SLOTS * (size_t)5 * SP_TILE_AREA, sizeof *b.sums);
    b.tile = aligned_alloc(64, sizeof *b.tile);
    assert_true(b.sums);
    assert_true(b.tile);
    b.tile->sums = b.sums;
    return b;
}

static void start(struct bench *b) {
    b->tile->dirty = b->dirty;
    sp_tile_init(b->tile, 0, 0, (int[2]){ SIZE, SIZE }, &b->blend);
}

static void free_bench(struct bench *b) {
    free(b->sums);
    free(b->tile);
}

/* Returns a round splat in the middle of the tile, with a standard deviation of 3 px. */
static struct sp_splat make_splat(float depth, uint32_t layer) {
    return (struct sp_splat){ .x = 16,
                              .y = 16,
                              .a = SP_LOG2E / 18,
                              .c = SP_LOG2E / 18,
                              .depth = depth,
                              .emission = { depth, 0.5f * depth, 0 },
                              .sheet = layer,
                              .x0 = 7,
                              .y0 = 7,
                              .x1 = 25,
                              .y1 = 25 };
}

static double weight_at(int x, int y) {
    double dx = x + 0.5 - 16, dy = y + 0.5 - 16, r2 = (dx * dx + dy * dy) / 9;
    return r2 <= 9 ? exp(-0.5 * r2) : 0;
}

static void assert_near(double a, double b, double tolerance) {
    if (!(fabs(a - b) <= tolerance))
        fail_msg("%.9g is not %.9g within %g", a, b, tolerance);
}

/* Two splats, the second behind the first: each has an opacity of 1 − e^−τ. */
static void splats_are_composited_one_by_one(void **state) {
    (void)state;
    for (int linear = 0; linear < 2; linear++) {
        struct bench b = make_bench(SP_COMPOSITE_SPLAT);
        b.blend.linear = linear;
        start(&b);
        struct sp_splat s[2] = { make_splat(0.7f, 0), make_splat(2.0f, 0) };
        s[1].emission[2] = 3;
        struct sp_splats records = { .splat = s };
        sp_splat_add(b.tile, &b.blend, &records, 0);
        sp_splat_add(b.tile, &b.blend, &records, 1);
        sp_tile_close(b.tile, &b.blend);
        for (int y = 0; y < SIZE; y++)
            for (int x = 0; x < SIZE; x++) {
                double w = weight_at(x, y), t0 = w * 0.7, t1 = w * 2;
                double a0 = linear ? fmin(t0, 1) : -expm1(-t0);
                double a1 = linear ? fmin(t1, 1) : -expm1(-t1);
                assert_near((double)b.tile->done[0][y][x], (1 - a0) * (1 - a1), 2e-6);
                assert_near((double)b.tile->done[1][y][x], a0 + (1 - a0) * a1, 2e-6);
                assert_near((double)b.tile->done[3][y][x], (1 - a0) * a1 * 1.5, 3e-6);
            }
        free_bench(&b);
    }
}

/* Linear attenuation of a sheet: min(Σ τ, 1), with the same ratio of the colours. */
static void a_sheet_attenuates_linearly(void **state) {
    (void)state;
    struct bench b = make_bench(SP_COMPOSITE_SHEET);
    b.blend.linear = true;
    start(&b);
    struct sp_splat s[2] = { make_splat(0.6f, 0), make_splat(0.9f, 0) };
    struct sp_splats records = { .splat = s };
    sp_sheet_add(b.tile, &b.blend, &records, 0);
    sp_sheet_add(b.tile, &b.blend, &records, 1);
    sp_tile_close(b.tile, &b.blend);
    for (int y = 0; y < SIZE; y++)
        for (int x = 0; x < SIZE; x++) {
            double alpha = fmin(1.5 * weight_at(x, y), 1);
            assert_near((double)b.tile->done[0][y][x], 1 - alpha, 3e-6);
            assert_near((double)b.tile->done[2][y][x], 0.5 * alpha, 3e-6);
        }
    free_bench(&b);
}

/* A splat in several slabs has shares of the normal distribution; its tails are in the first and
 * the last slab. */
static void slabs_share_a_splat_by_its_depth(void **state) {
    (void)state;
    struct bench b = make_bench(SP_COMPOSITE_SLAB);
    b.blend.nearest = 10;
    start(&b);
    struct sp_splat s = make_splat(1e-3f, 1);
    struct sp_span span = {
        .distance = 13.3f, .slope = { 0.2f, -0.1f }, .sharpness = 1 / 0.8f, .reach = 2
    };
    struct sp_splats records = { .splat = &s, .span = &span };
    sp_slab_add(b.tile, &b.blend, &records, 0);
    for (int y = 7; y < 25; y++)
        for (int x = 7; x < 25; x++) {
            double mean = 13.3 + 0.2 * (x + 0.5 - 16) - 0.1 * (y + 0.5 - 16), sum = 0;
            for (int k = 0; k < SLOTS; k++) { /* 11.3 … 15.3: slabs 1 … 5 */
                double low = k == 1 ? -INFINITY : 10 + k, high = k == 5 ? INFINITY : 11 + k;
                double share = k < 1 || k > 5 ? 0
                                              : 0.5 * (erf((high - mean) / 0.8 * M_SQRT1_2) -
                                                       erf((low - mean) / 0.8 * M_SQRT1_2));
                double got = (double)sp_sums_row(b.tile, &b.blend, (uint32_t)k, y)[x];
                assert_near(got, 1e-3 * weight_at(x, y) * share, 2e-9);
                sum += got;
            }
            assert_near(sum, 1e-3 * weight_at(x, y), 1e-9);
        }
    free_bench(&b);
}

/* Slabs close in order, however far away the next splat is. At the end no layer holds anything. */
static void slabs_close_front_to_back(void **state) {
    (void)state;
    static const uint32_t layers[] = { 0, 3, 3, 17, 40, 41, 3000 };
    enum { COUNT = sizeof layers / sizeof *layers };
    struct bench b = make_bench(SP_COMPOSITE_SLAB);
    start(&b);
    struct sp_splat s[COUNT];
    struct sp_span span[COUNT];
    double through = 1, colour = 0, alpha[COUNT] = { 0 };
    for (int i = 0; i < COUNT; i++) {
        s[i] = make_splat(0.4f, layers[i]);
        s[i].emission[1] = 0.4f * (float)(i + 1) / COUNT;
        span[i] = (struct sp_span){ .distance = (float)layers[i] + 0.5f,
                                    .sharpness = 100,
                                    .reach = 0.1f };
    }
    struct sp_splats records = { .splat = s, .span = span };
    for (uint32_t i = 0; i < COUNT; i++)
        sp_slab_add(b.tile, &b.blend, &records, i);
    sp_tile_close(b.tile, &b.blend);
    for (int i = 0; i < COUNT;
         i++) { /* in the middle, px (16, 16); splats 1 and 2 are in one slab */
        int n = i == 1 ? 2 : 1;
        double t = 0.4 * n * weight_at(16, 16), c = n == 2 ? 2.5 : i + 1;
        alpha[i] = -expm1(-t);
        colour += through * alpha[i] * c / COUNT;
        through *= 1 - alpha[i];
        i += n - 1;
    }
    assert_near((double)b.tile->done[0][16][16], through, 2e-6);
    assert_near((double)b.tile->done[2][16][16], colour, 2e-6);
    for (int i = 0; i < SLOTS * SP_PLANES * SP_TILE_AREA; i++)
        assert_compare(b.sums[i], ==, 0);
    free_bench(&b);
}

/* Planes that bound the depth are intersected with the slabs; a plane along the ray is a factor. */
static void cuts_bound_the_shares(void **state) {
    (void)state;
    for (int slabs = 0; slabs < 2; slabs++) {
        struct bench b = make_bench(slabs ? SP_COMPOSITE_SLAB : SP_COMPOSITE_SHEET);
        start(&b);
        struct sp_splat s = make_splat(1e-3f, 0);
        s.cuts = 3;
        struct sp_cut cut = {
            { { 0.5f, { 0.1f, 0 }, 1 }, { 0.9f, { 0, -0.05f }, -1 }, { 0.2f, { 0.3f, 0.2f }, 0 } }
        };
        struct sp_span span = { .distance = 3.2f, .sharpness = 1 / 0.7f, .reach = 2 };
        struct sp_splats records = { .splat = &s, .span = &span, .cut = &cut };
        (slabs ? sp_slab_add : sp_sheet_add)(b.tile, &b.blend, &records, 0);
        for (int y = 7; y < 25; y++)
            for (int x = 7; x < 25; x++) {
                double dx = x + 0.5 - 16, dy = y + 0.5 - 16, sum = 0;
                double low = -(0.5 + 0.1 * dx), high = 0.9 - 0.05 * dy,
                       third = 0.2 + 0.3 * dx + 0.2 * dy;
                double all = fmax(0.5 * (erf(high * M_SQRT1_2) - erf(low * M_SQRT1_2)), 0);
                double factor = weight_at(x, y) * 0.5 * (1 + erf(third * M_SQRT1_2)) * 1e-3;
                for (uint32_t k = 0; k < b.blend.slots; k++) {
                    double got = (double)sp_sums_row(b.tile, &b.blend, (uint32_t)k, y)[x];
                    sum += got;
                    if (!slabs || k > 5)
                        continue;
                    double z0 = k <= 1 ? low : fmax(low, (k - 3.2) / 0.7);
                    double z1 = k == 5 ? high : fmin(high, (k + 1 - 3.2) / 0.7);
                    double share = 0.5 * (erf(z1 * M_SQRT1_2) - erf(z0 * M_SQRT1_2));
                    assert_near(got, k < 1 ? 0 : factor * fmax(share, 0), 2e-9);
                }
                assert_near(sum, factor * all, 2e-9);
            }
        free_bench(&b);
    }
}

static void the_cubic_kernel_has_its_own_profile(void **state) {
    (void)state;
    struct sp_cubic_table table;
    sp_cubic_table_init(&table);
    struct bench b = make_bench(SP_COMPOSITE_SLAB);
    double radius = SP_CUBIC_RADIUS / SP_CUBIC_SIGMA;
    b.blend.cubic = &table;
    b.blend.cut = (float)(0.5 * radius * radius) * SP_LOG2E;
    start(&b);
    struct sp_splat s = make_splat(1e-3f, 0);
    s.x0 = s.y0 = 5;
    s.x1 = s.y1 = 27;
    struct sp_span span = { .distance = 3.2f, .sharpness = 1 / 0.7f, .reach = 2.5f };
    struct sp_splats records = { .splat = &s, .span = &span };
    sp_slab_add(b.tile, &b.blend, &records, 0);
    for (int y = 5; y < 27; y++)
        for (int x = 5; x < 27; x++) {
            double rho = hypot(x + 0.5 - 16, y + 0.5 - 16) / 3 * SP_CUBIC_SIGMA;
            double f = sp_cubic_footprint(rho), top = sp_cubic_footprint(0), before = 0;
            for (int k = 0; k < 7; k++) {
                double z = (k + 1 - 3.2) / 0.7 * SP_CUBIC_SIGMA;
                double part = f > 0 ? 0.5 * f + copysign(sp_cubic_part(rho, fabs(z)), z) : 0;
                if (k >= 5)
                    part = f;
                assert_near((double)sp_sums_row(b.tile, &b.blend, (uint32_t)k, y)[x],
                            1e-3 * (part - before) / top, 1e-7);
                before = part;
            }
        }
    free_bench(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(splats_are_composited_one_by_one),
        cmocka_unit_test(a_sheet_attenuates_linearly),
        cmocka_unit_test(slabs_share_a_splat_by_its_depth),
        cmocka_unit_test(slabs_close_front_to_back),
        cmocka_unit_test(cuts_bound_the_shares),
        cmocka_unit_test(the_cubic_kernel_has_its_own_profile),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
