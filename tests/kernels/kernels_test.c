/* SPDX-License-Identifier: Apache-2.0
 *
 * The kernel tables of the CPU backend: compares every instruction set that this machine supports
 * with the definitions in double precision, on random and extreme input. Guard zones surround the
 * memory that the kernels may write.
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

#include "backend/cpu/kernels.h"
#include "support/compare.h"

enum { GUARD = 4096 };

/* Calls `test` for each table. Prints the instruction sets that this build or processor lacks. */
static void each_isa(void (*test)(const struct cpu_kernels *)) {
    const char *isa;
    for (unsigned i = 0; (isa = cpu_isa_at(i)); i++) {
        struct cpu_kernels kernels;
        struct sp_error err;
        if (cpu_kernels_init(&kernels, isa, &err))
            test(&kernels);
        else
            printf("skipped: %s: %s\n", isa, err.text);
    }
}

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

/* A tile and its sums, with guard zones around both. */
struct guarded {
    unsigned char *memory, *sums;
    struct sp_box dirty;
    struct sp_tile *tile;
    struct sp_blend blend;
};
enum { SUMS_BYTES = SP_PLANES * SP_TILE_AREA * sizeof(float) };

static unsigned char *make_zone(size_t size) {
    unsigned char *memory = aligned_alloc(64, 2 * GUARD + size);
    assert_non_null(memory);
    memset(memory, 0x5a, 2 * GUARD + size);
    return memory;
}

static void free_zone(unsigned char *memory, size_t size) {
    for (size_t i = 0; i < GUARD; i++) {
        assert_int_equal(memory[i], 0x5a);
        assert_int_equal(memory[GUARD + size + i], 0x5a);
    }
    free(memory);
}

static void make_guarded(struct guarded *g, int x, int y, float cut) {
    *g = (struct guarded){
        .blend = { .mode = SP_COMPOSITE_SHEET, .planes = SP_PLANES, .slots = 1, .cut = cut }
    };
    g->memory = make_zone(sizeof(struct sp_tile));
    g->sums = make_zone(SUMS_BYTES);
    g->tile = (struct sp_tile *)(void *)(g->memory + GUARD);
    g->tile->sums = (float *)(void *)(g->sums + GUARD);
    g->tile->dirty = &g->dirty;
    sp_tile_init(g->tile, x, y, (int[2]){ 8192, 8192 }, &g->blend);
}

static float *sum_at(const struct guarded *g, int plane, int y, int x) {
    return sp_sums_row(g->tile, &g->blend, 0, y) + plane * SP_TILE + x;
}

static void free_guarded(struct guarded *g) {
    free_zone(g->memory, sizeof(struct sp_tile));
    free_zone(g->sums, SUMS_BYTES);
}

/* Returns a splat of any shape over the tile. With `wild`, the exponents reach the limits of float.
 */
static struct sp_splat random_splat(const struct sp_tile *tile, float cut, int wild) {
    struct sp_splat s = { .sheet = 3 };
    double spread = wild ? 24 : 8;
    double v00 = pow(10, uniform(-spread / 4, spread / 2)),
           v11 = pow(10, uniform(-spread / 4, spread / 2));
    double v01 = sqrt(v00 * v11) * uniform(-1, 1) * (wild ? 1 - 1e-6 : 0.995);
    double det = v00 * v11 - v01 * v01, half = 0.5 / log(2) / det,
           r = sqrt(2 * log(2) * (double)cut);
    double rx = r * sqrt(v00), ry = r * sqrt(v11);
    s.x = (float)(tile->x + uniform(-fmin(rx, 1e6), SP_TILE + fmin(rx, 1e6)));
    s.y = (float)(tile->y + uniform(-fmin(ry, 1e6), SP_TILE + fmin(ry, 1e6)));
    s.a = (float)(half * v11);
    s.b = (float)(-2 * half * v01);
    s.c = (float)(half * v00);
    s.depth = (float)pow(10, uniform(wild ? -30 : -4, wild ? 6 : 0));
    for (int c = 0; c < 3; c++)
        s.emission[c] = s.depth * (float)uniform(0, 3);
    s.x0 = (int16_t)fmax(0, fmax(tile->x - 100, ceil((double)s.x - rx - 0.5)));
    s.x1 = (int16_t)fmin(8192, fmin(tile->x + 200, floor((double)s.x + rx + 0.5)));
    s.y0 = (int16_t)fmax(0, fmax(tile->y - 100, ceil((double)s.y - ry - 0.5)));
    s.y1 = (int16_t)fmin(8192, fmin(tile->y + 200, floor((double)s.y + ry + 0.5)));
    return s;
}

static bool overlaps(const struct sp_splat *s, const struct sp_tile *t) {
    return s->x0 < s->x1 && s->y0 < s->y1 && s->x0 < t->x + SP_TILE && s->x1 > t->x &&
           s->y0 < t->y + SP_TILE && s->y1 > t->y;
}

static double exponent(const struct sp_splat *s, double x, double y) {
    double dx = x + 0.5 - (double)s->x, dy = y + 0.5 - (double)s->y;
    return (double)s->a * dx * dx + (double)s->b * dx * dy + (double)s->c * dy * dy;
}

static void check_is_finite_and_not_negative(float value) {
    assert_compare(value, >=, 0);
    assert_compare(value, <, INFINITY);
}

static void check_add(const struct cpu_kernels *kernels) {
    srand(11);
    static const float cuts[] = { 0.7213f, 6.492f, 25.97f }; /* cutoffs 1, 3, 6 */
    for (int n = 0; n < 8000; n++) {
        struct guarded g;
        int wild = n % 5 == 0;
        float cut = cuts[n % 3];
        make_guarded(&g, n % 2 ? 0 : 4096, n % 3 ? 0 : 8160, cut);
        struct sp_splat s = random_splat(g.tile, cut, wild);
        if (overlaps(&s, g.tile)) {
            kernels->add[SP_COMPOSITE_SHEET](g.tile, &g.blend, &(struct sp_splats){ .splat = &s },
                                             0);
            for (int y = 0; y < SP_TILE; y++)
                for (int x = 0; x < SP_TILE; x++) {
                    double e = exponent(&s, g.tile->x + x, g.tile->y + y);
                    double got = (double)*sum_at(&g, 0, y, x), top = (double)s.depth;
                    for (int p = 0; p < SP_PLANES; p++)
                        check_is_finite_and_not_negative(*sum_at(&g, p, y, x));
                    if (wild) { /* no exact check: the exponent is a difference of huge numbers */
                        assert_compare(got, <=, top * 1.0001);
                        continue;
                    }
                    double w = e <= (double)cut ? exp2(-e) : 0;
                    /* Rounding of dx and dy is magnified by the conic. */
                    double slack = top * (1e-4 + 2e-3 * exp2(-(double)cut));
                    bool edge = fabs(e - (double)cut) < 2e-2 * (double)cut;
                    if (!edge)
                        assert_compare(fabs(got - top * w), <, slack);
                    for (int c = 0; c < 3; c++)
                        assert_compare(fabs((double)*sum_at(&g, 1 + c, y, x) * top -
                                            got * (double)s.emission[c]),
                                       <=, 1e-6 * top * top * 3);
                }
            kernels->tile_close(g.tile, &g.blend);
            for (int p = 0; p < SP_PLANES; p++)
                for (int y = 0; y < SP_TILE; y++)
                    for (int x = 0; x < SP_TILE; x++)
                        assert_compare(*sum_at(&g, p, y, x), ==, 0);
        }
        free_guarded(&g);
    }
}

static void footprints_match_their_definition(void **state) {
    (void)state;
    each_isa(check_add);
}

static void check_close(const struct cpu_kernels *kernels) {
    srand(12);
    for (int n = 0; n < 1000; n++) {
        struct guarded g;
        make_guarded(&g, 32, 64, 6.5f);
        struct sp_tile *t = g.tile;
        static const double powers[] = { -30, -12, -4, -2.1, -1.9, 0, 2, 12 };
        double top = pow(10, powers[n % 8]);
        t->sheet = 1;
        struct sp_box box = { .x0 = rand() % 16, .y0 = rand() % 16 };
        box.x1 = box.x0 + 1 + rand() % (SP_TILE - box.x0);
        box.y1 = box.y0 + 1 + rand() % (SP_TILE - box.y0);
        t->dirty[0] = box;
        double depth[SP_TILE][SP_TILE] = { { 0 } };
        for (int y = box.y0; y < box.y1; y++)
            for (int x = box.x0; x < box.x1; x++)
                if (rand() % 4) {
                    *sum_at(&g, 0, y, x) = (float)uniform(0, top);
                    depth[y][x] = (double)*sum_at(&g, 0, y, x);
                    for (int c = 1; c < 4; c++)
                        *sum_at(&g, c, y, x) = *sum_at(&g, 0, y, x) * 0.25f * (float)c;
                }
        for (int y = 0; y < SP_TILE; y++)
            for (int x = 0; x < SP_TILE; x++) {
                t->done[0][y][x] = 0.5f;
                t->done[2][y][x] = 0.125f;
            }
        kernels->tile_close(t, &g.blend);
        for (int y = 0; y < SP_TILE; y++)
            for (int x = 0; x < SP_TILE; x++) {
                double pass = exp(-depth[y][x]), alpha = -expm1(-depth[y][x]);
                assert_compare(fabs((double)t->done[0][y][x] - 0.5 * pass), <, 1e-6);
                for (int c = 1; c < 4; c++) {
                    double before = c == 2 ? 0.125 : 0, expected = 0.5 * alpha * 0.25 * c;
                    assert_compare(fabs((double)t->done[c][y][x] - before - expected), <,
                                   1e-7 + 1e-5 * expected);
                }
            }
        assert_int_equal(t->sheet, SP_NO_SHEET);
        free_guarded(&g);
    }
}

static void closing_a_sheet_composites_it(void **state) {
    (void)state;
    each_isa(check_close);
}

static void check_resolve(const struct cpu_kernels *kernels) {
    enum { MOST = 70 };
    srand(13);
    for (uint32_t count = 1; count <= MOST; count++) {
        float plane[4][MOST], wide[4 * MOST + 8];
        unsigned char narrow[4 * MOST + 8];
        const float *const planes[4] = { plane[0], plane[1], plane[2], plane[3] };
        const float background[4] = { 0.1f, 0.9f, 0.4f, count % 3 ? 1.0f : 0.25f };
        for (uint32_t i = 0; i < count; i++) {
            plane[0][i] = (float)uniform(0, 1);
            for (int c = 1; c < 4; c++)
                plane[c][i] = (float)uniform(0, i % 7 ? 1 : 1e6) * (1 - plane[0][i]);
        }
        memset(wide, 0x5a, sizeof wide);
        memset(narrow, 0x5a, sizeof narrow);
        kernels->resolve_rgbaf32(planes, count, background, wide);
        kernels->resolve_rgba8(planes, count, background, narrow);
        for (uint32_t i = 0; i < count; i++) {
            double share = (double)plane[0][i] * (double)background[3];
            double alpha = 1 - (double)plane[0][i] + share;
            assert_compare(fabs((double)wide[4 * i + 3] - alpha), <, 1e-6);
            assert_compare(fabs(narrow[4 * i + 3] - alpha * 255), <=, 0.51);
            for (int c = 0; c < 3; c++) {
                double colour = (double)plane[1 + c][i] + share * (double)background[c];
                assert_compare(fabs((double)wide[4 * i + (uint32_t)c] / colour - 1), <, 1e-5);
                assert_compare(fabs(narrow[4 * i + (uint32_t)c] - fmin(1, colour / alpha) * 255),
                               <=, 0.51);
            }
        }
        for (size_t k = 4 * count; k < sizeof narrow; k++)
            assert_int_equal(narrow[k], 0x5a);
        for (size_t k = 16 * count; k < sizeof wide; k++)
            assert_int_equal(((unsigned char *)wide)[k], 0x5a);
    }
}

static void resolved_pixels_match_their_definition(void **state) {
    (void)state;
    each_isa(check_resolve);
}

/* Fails unless |got - want| ≤ slack + share·|want|. */
static void assert_near(float got, float want, float slack, float share) {
    if (!(fabsf(got - want) <= slack + share * fabsf(want)))
        fail_msg("%.9g differs from %.9g by more than %g + %g·|%g|", (double)got, (double)want,
                 (double)slack, (double)share, (double)want);
}

/* Compares every table with the scalar one, on runs of random voxels. The records before the first
 * and past the last must stay untouched. */
static void check_set_up(const struct cpu_kernels *kernels) {
    enum { COUNT = 257 };
    struct cpu_kernels scalar;
    assert_true(cpu_kernels_init(&scalar, "scalar", NULL));
    const struct sp_grid grid = { .dims = { 100, 90, 80 },
                                  .spacing = { 1, 2, 0.5 },
                                  .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    uint16_t local[COUNT], order[COUNT], of_run[COUNT];
    uint32_t key[COUNT], normal[2 * COUNT];
    uint64_t first[2] = { 0, COUNT };
    struct sp_class classes[4] = {
        { { 1, 0, 0 }, 0.1f }, { { 0, 1, 0 }, 1 }, { { 0, 0, 1 }, 10 }, { { 1, 1, 1 }, 0.01f }
    };
    struct sp_visible list = {
        .bricks = { 1, 1, 1 }, .count = COUNT, .first = first, .key = key, .normal = normal
    };
    struct sp_transfer transfer = { .table = classes, .count = 4 };
    struct sp_splat *a = malloc((COUNT + 2) * sizeof *a), *b = malloc((COUNT + 2) * sizeof *b);
    static struct sp_span spans[2][COUNT];
    static struct sp_cut cuts[2][COUNT];
    srand(14);
    for (int n = 0; n < 300; n++) {
        struct sp_view view = {
            .size = { 300, 200 },
            .camera = { .projection = (enum sp_projection)(n % 2),
                        .position = { uniform(-300, 300), uniform(-300, 300), uniform(-50, 50) },
                        .target = { 50, 90, 20 },
                        .up = { 0, 0, 1 },
                        .fov_y = uniform(1, 170),
                        .height = pow(10, uniform(-3, 4)),
                        .near = 0.1 },
            .transfer_function = { .reference_length = 1 },
            .shading = { .mode = SP_SHADING_PHONG,
                         .ambient = 0.1,
                         .diffuse = 1,
                         .specular = 1,
                         .exponent = pow(2, n % 8),
                         .light_count = 1,
                         .lights = { { { 1, 2, 3 }, SP_LIGHT_WORLD, { 1, 0.5f, 0.2f } } } },
            .filter = { SP_FILTER_EWA, (enum sp_kernel)(n / 2 % 2), 0.7, 3, 1, 0.3, NAN },
            .clip = { .box = { { 0, 0.4, 0 }, { 1, 1, 1 } },
                      .plane_count = 1,
                      .planes = { { { 1, 0, 1 }, 70 } } }
        };
        list.key_bytes = 1u << n % 3;
        for (int i = 0; i < COUNT; i++) {
            local[i] = (uint16_t)(rand() % 4096);
            order[i] = (uint16_t)(rand() % COUNT);
            sp_visible_set_key(&list, (uint64_t)i, (uint32_t)rand() % 4);
            normal[2 * i] = (uint32_t)rand() << 1;
            normal[2 * i + 1] = (uint32_t)rand() << 1;
        }
        list.normal_bytes = n % 3 ? 4 : 8; /* 4: normals; 8: microflakes */
        struct sp_camera_transform camera;
        struct sp_ewa_frame frame;
        struct sp_shade shade;
        sp_camera_transform_init(&camera, &view.camera, view.size);
        sp_ewa_frame_init(&frame, &camera, &grid, &view, &view.filter);
        sp_shade_init(&shade, &camera, &view.shading);
        sp_clip_frame_init(&frame.clip, &camera, &grid, &view.clip, frame.unit);
        struct sp_ewa_run run = { .list = &list,
                                  .local = of_run,
                                  .transfer = &transfer,
                                  .shade = n % 4 ? &shade : NULL,
                                  .brick = { (uint32_t)n % 6 * 16, 32, (uint32_t)n % 5 * 16 },
                                  .order = n % 2 ? order : NULL,
                                  .begin = (uint32_t)n % 5,
                                  .count = (uint32_t)(COUNT - n % 40 - 5),
                                  .sheet = 9,
                                  .mode = (enum sp_filter_mode)(1 + n % 5) };
        for (uint32_t i = 0; i < run.count; i++)
            of_run[i] = local[run.order ? order[run.begin + i] : run.begin + i];
        memset(a, 0x5a, (COUNT + 2) * sizeof *a);
        memset(b, 0x5a, (COUNT + 2) * sizeof *b);
        struct sp_splats to = { .splat = a + 1, .span = spans[0], .cut = cuts[0] },
                         from = { .splat = b + 1, .span = spans[1], .cut = cuts[1] };
        uint32_t got = kernels->set_up(&frame, &run, &to),
                 want = scalar.set_up(&frame, &run, &from);
        assert_int_equal(got, want);
        assert_in_range(got, 0, run.count);
        for (uint32_t i = 1; i <= got; i++) {
            assert_near(a[i].x, b[i].x, 1e-3f, 1e-6f);
            assert_near(a[i].depth, b[i].depth, 1e-4f * b[i].depth, 0);
            for (int k = 0; k < 3; k++) /* colours are of order 1 */
                assert_near(a[i].emission[k], b[i].emission[k], 2e-3f * b[i].depth, 0);
            assert_int_equal(a[i].sheet, 9);
            assert_int_equal(a[i].cuts, b[i].cuts);
            const struct sp_span *p = &spans[0][i - 1], *q = &spans[1][i - 1];
            assert_near(p->distance, q->distance, 1e-5f * q->distance, 0);
            assert_near(p->sharpness, q->sharpness, 1e-4f * q->sharpness, 0);
            for (uint32_t k = 0; k < a[i].cuts; k++) /* a small difference of large numbers */
                assert_near(cuts[0][i - 1].planes[k].e, cuts[1][i - 1].planes[k].e, 1e-2f, 1e-2f);
        }
        for (size_t k = 0; k < sizeof *a; k++) { /* before the first and past the last possible */
            assert_int_equal(((unsigned char *)a)[k], 0x5a);
            assert_int_equal(((unsigned char *)(a + 1 + run.count))[k], 0x5a);
        }
    }
    free(a);
    free(b);
}

static void splats_match_those_of_scalar(void **state) {
    (void)state;
    each_isa(check_set_up);
}

/* The layers of one tile, and a splat with all data that a compositor may read. */
enum { SLOTS = 24 };
struct bench {
    struct sp_tile tile;
    float sums[SLOTS * SP_PLANES * SP_TILE_AREA];
    struct sp_box dirty[SLOTS];
    struct sp_blend blend;
    struct sp_splat splat;
    struct sp_span span;
    struct sp_cut cut;
    struct sp_splats records;
};

static struct bench *make_bench(enum sp_compositing mode, const struct sp_cubic_table *cubic,
                                bool linear, unsigned cuts) {
    struct bench *b = aligned_alloc(64, (sizeof *b + 63) & ~(size_t)63);
    assert_non_null(b);
    double r = cubic ? SP_CUBIC_RADIUS / SP_CUBIC_SIGMA : 3;
    b->blend = (struct sp_blend){ .mode = mode,
                                  .linear = linear,
                                  .planes = SP_PLANES,
                                  .slots = mode == SP_COMPOSITE_SLAB ? SLOTS : 1,
                                  .cut = (float)(0.5 * r * r / log(2)),
                                  .cubic = cubic,
                                  .thickness = 1,
                                  .nearest = 10 };
    b->tile.sums = b->sums;
    b->tile.dirty = b->dirty;
    sp_tile_init(&b->tile, 0, 0, (int[2]){ SP_TILE, SP_TILE }, &b->blend);
    do
        b->splat = random_splat(&b->tile, b->blend.cut, 0);
    while (!overlaps(&b->splat, &b->tile) || b->splat.depth < 1e-3f);
    b->splat.sheet = 0;
    b->splat.cuts = cuts;
    float slope = rand() % 2 ? 0.1f : 0;
    b->span = (struct sp_span){ .distance = (float)uniform(14, 28),
                                .slope = { slope * (float)uniform(-1, 1), slope },
                                .sharpness = (float)uniform(0.5, 4),
                                .reach = (float)uniform(0.2, 4) };
    for (unsigned i = 0; i < cuts; i++)
        b->cut.planes[i] = (struct sp_cut_plane){ (float)uniform(-2, 2),
                                                  { (float)uniform(-0.2, 0.2), 0.1f },
                                                  rand() % 3 - 1 };
    b->records = (struct sp_splats){ &b->splat, &b->span, cuts ? &b->cut : NULL };
    return b;
}

/* Returns the share of the kernel before a depth, at a pixel of exponent e, by the definition. */
static double share_before(const struct bench *b, double e, double depth) {
    if (!b->blend.cubic)
        return 0.5 * erfc(-depth * M_SQRT1_2);
    double rho = SP_CUBIC_RADIUS * sqrt(fmin(e / (double)b->blend.cut, 1));
    double all = sp_cubic_footprint(rho), part = sp_cubic_part(rho, fabs(depth) * SP_CUBIC_SIGMA);
    return all > 0 ? 0.5 + copysign(part / all, depth) : depth > 0;
}

/* Sets the weight and the depth bounds of a pixel by the definition. False where rounding decides
 * whether the pixel counts. */
static bool compute_pixel(const struct bench *b, int x, int y, double *weight, double *low,
                          double *high) {
    const struct sp_splat *s = &b->splat;
    double e = exponent(s, x, y), cut = (double)b->blend.cut;
    double dx = x + 0.5 - (double)s->x, dy = y + 0.5 - (double)s->y;
    bool is_in = x >= s->x0 && x < s->x1 && y >= s->y0 && y < s->y1 && e <= cut;
    double rho = SP_CUBIC_RADIUS * sqrt(fmin(fmax(e / cut, 0), 1));
    *weight = !is_in           ? 0
              : b->blend.cubic ? sp_cubic_footprint(rho) / sp_cubic_footprint(0)
                               : exp2(-e);
    *low = -INFINITY;
    *high = INFINITY;
    for (uint32_t i = 0; i < s->cuts; i++) {
        const struct sp_cut_plane *p = &b->cut.planes[i];
        double eta = (double)p->e + (double)p->k[0] * dx + (double)p->k[1] * dy;
        if (p->side > 0)
            *low = fmax(*low, -eta);
        else if (p->side < 0)
            *high = fmin(*high, eta);
        else
            *weight *= share_before(b, e, eta);
    }
    return fabs(e - cut) > 0.03 * cut;
}

/* Sets the share of each slab: none is negative, and they add up to what the planes keep. */
static void compute_shares(const struct bench *b, double x, double y, double low, double high,
                           double shares[SLOTS]) {
    const struct sp_splat *s = &b->splat;
    const struct sp_span *p = &b->span;
    double dx = x + 0.5 - (double)s->x, dy = y + 0.5 - (double)s->y,
           e = exponent(s, (int)x, (int)y);
    double mean = (double)p->distance + (double)p->slope[0] * dx + (double)p->slope[1] * dy;
    float first = floorf(p->distance - p->reach - 10), last = floorf(p->distance + p->reach - 10);
    double before = s->cuts ? share_before(b, e, fmax(low, -1e4)) : 0;
    for (int k = 0; k < SLOTS; k++) {
        shares[k] = 0;
        if ((float)k < first || (float)k > last)
            continue;
        double face = (10 + k + 1 - mean) * (double)p->sharpness, next = 1;
        if ((float)k < last)
            next = share_before(b, e, fmin(face, high));
        else if (s->cuts)
            next = share_before(b, e, fmin(high, 1e4));
        next = fmax(next, before);
        shares[k] = next - before;
        before = next;
    }
}

static void check_slabs(const struct cpu_kernels *kernels) {
    struct sp_cubic_table table;
    sp_cubic_table_init(&table);
    srand(15);
    for (int n = 0; n < 1200; n++) {
        struct bench *b =
            make_bench(SP_COMPOSITE_SLAB, n % 3 == 0 ? &table : NULL, false, n % 2 ? n % 4 : 0);
        kernels->add[SP_COMPOSITE_SLAB](&b->tile, &b->blend, &b->records, 0);
        double top = (double)b->splat.depth;
        for (int y = 0; y < SP_TILE; y++)
            for (int x = 0; x < SP_TILE; x++) {
                double weight, low, high, shares[SLOTS];
                if (!compute_pixel(b, x, y, &weight, &low, &high))
                    continue;
                compute_shares(b, x, y, low, high, shares);
                for (uint32_t k = 0; k < SLOTS; k++) {
                    const float *sum = sp_sums_row(&b->tile, &b->blend, k, y) + x;
                    double slack = b->blend.cubic ? 4e-4 : 8e-5; /* error of the table, or of Φ */
                    assert_compare(fabs((double)sum[0] - top * weight * shares[k]), <, slack * top);
                    for (int c = 0; c < 3; c++)
                        assert_compare(fabs((double)sum[(1 + c) * SP_TILE] * top -
                                            (double)sum[0] * (double)b->splat.emission[c]),
                                       <=, 3e-6 * top * top);
                }
            }
        free(b);
    }
}

static void slabs_match_their_definition(void **state) {
    (void)state;
    each_isa(check_slabs);
}

/* Sheets and single splats of every kernel, with and without cuts by planes. */
static void check_composites(const struct cpu_kernels *kernels) {
    struct sp_cubic_table table;
    sp_cubic_table_init(&table);
    srand(16);
    for (int n = 0; n < 1600; n++) {
        bool linear = n % 4 == 1, single = n % 2;
        struct bench *b = make_bench(single ? SP_COMPOSITE_SPLAT : SP_COMPOSITE_SHEET,
                                     n % 3 == 0 ? &table : NULL, linear, n % 5 < 2 ? n % 3 : 0);
        for (int i = 0; i < SP_TILE_AREA; i++) {
            (&b->tile.done[0][0][0])[i] = 0.5f;
            (&b->tile.done[2][0][0])[i] = 0.125f;
        }
        kernels->add[b->blend.mode](&b->tile, &b->blend, &b->records, 0);
        kernels->tile_close(&b->tile, &b->blend);
        for (int y = 0; y < SP_TILE; y++)
            for (int x = 0; x < SP_TILE; x++) {
                double weight, low, high, e = exponent(&b->splat, x, y);
                if (!compute_pixel(b, x, y, &weight, &low, &high))
                    continue;
                if (b->splat.cuts)
                    weight *= fmax(share_before(b, e, fmin(high, 1e4)) -
                                       share_before(b, e, fmax(low, -1e4)),
                                   0);
                double depth = weight * (double)b->splat.depth;
                double alpha = linear ? fmin(depth, 1) : -expm1(-depth);
                double slack = 2e-5 * fmin((double)b->splat.depth, 1);
                assert_compare(fabs((double)b->tile.done[0][y][x] - 0.5 * (1 - alpha)), <,
                               slack + 1e-6);
                for (int c = 0; c < 3; c++) {
                    double colour = (double)b->splat.emission[c] / (double)b->splat.depth;
                    double expected = (c == 1 ? 0.125 : 0) + 0.5 * alpha * colour;
                    assert_compare(fabs((double)b->tile.done[1 + c][y][x] - expected), <,
                                   3 * slack + 1e-6);
                }
            }
        free(b);
    }
}

static void sheets_and_splats_match_their_definition(void **state) {
    (void)state;
    each_isa(check_composites);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(splats_match_those_of_scalar),
        cmocka_unit_test(footprints_match_their_definition),
        cmocka_unit_test(closing_a_sheet_composites_it),
        cmocka_unit_test(resolved_pixels_match_their_definition),
        cmocka_unit_test(slabs_match_their_definition),
        cmocka_unit_test(sheets_and_splats_match_their_definition),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
