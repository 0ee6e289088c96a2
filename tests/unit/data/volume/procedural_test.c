/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>

#include "data/volume/procedural.h"
#include "support/compare.h"
#include "support/one_thread.h"

static struct sp_volume *load(const char *source) {
    struct sp_error err = { .text = "" };
    struct sp_volume *volume = sp_volume_load(source, NULL, &err);
    if (!volume)
        print_error("%s: %s\n", source, err.text);
    assert_non_null(volume);
    return volume;
}

static double sample(const struct sp_volume *volume, uint32_t i, uint32_t j, uint32_t k) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    const void *voxels = sp_volume_voxels(volume);
    const uint32_t *d = info->grid.dims;
    assert_compare(i, <, d[0]);
    assert_compare(j, <, d[1]);
    assert_compare(k, <, d[2]);
    size_t at = ((size_t)k * d[1] + j) * d[0] + i;
    return info->type == SP_UINT8    ? ((const uint8_t *)voxels)[at]
           : info->type == SP_UINT16 ? ((const uint16_t *)voxels)[at]
                                     : (double)((const float *)voxels)[at];
}

static void every_demo_has_the_documented_size_type_and_range(void **state) {
    (void)state;
    static const struct {
        const char *name;
        uint32_t dims[3];
        enum sp_type type;
        double low, high;
    } expected[] = {
        { "phantom", { 128, 128, 128 }, SP_FLOAT32, 0, 1 },
        { "engine", { 160, 90, 90 }, SP_UINT8, 0, 235 },
        { "vessels", { 160, 160, 160 }, SP_UINT16, 0, 3600 },
        { "marschner-lobb", { 41, 41, 41 }, SP_FLOAT32, 0, 1 },
        { "checkerboard", { 512, 512, 3 }, SP_UINT8, 64, 192 },
        { "hydrogen", { 128, 128, 128 }, SP_UINT8, 0, 255 },
        { "galaxy", { 96, 96, 48 }, SP_UINT16, 0, 4000 },
        { "sparse", { 256, 256, 256 }, SP_UINT8, 0, 255 },
        { "turbulence", { 128, 128, 128 }, SP_FLOAT32, 0, 1 },
        { "noise", { 128, 128, 128 }, SP_UINT8, 20, 190 },
        { "tornado", { 96, 96, 96 }, SP_FLOAT32, 0, 104 },
        { "jet", { 128, 64, 32 }, SP_FLOAT32, 0, 74 },
    };
    size_t count = sizeof expected / sizeof expected[0];
    assert_non_null(sp_demo_at(count)); /* the first one with elements */
    assert_null(sp_demo_at(count + 4));
    for (size_t i = 0; i < count; i++) {
        const struct sp_demo *demo = sp_demo_at(i);
        assert_string_equal(demo->name, expected[i].name);
        assert_compare(strlen(demo->doc), >, 10);
        char source[64];
        snprintf(source, sizeof source, "demo:%s", demo->name);
        struct sp_volume *volume = load(source);
        const struct sp_volume_info *info = sp_volume_info(volume);
        assert_int_equal(info->type, expected[i].type);
        uint64_t voxels = 1, counted = info->nonfinite;
        for (int axis = 0; axis < 3; axis++) {
            assert_int_equal(info->grid.dims[axis], expected[i].dims[axis]);
            assert_compare(info->grid.spacing[axis], ==, 1);
            assert_compare(info->grid.origin[axis], ==, 0);
            voxels *= info->grid.dims[axis];
        }
        assert_string_equal(info->name, demo->name);
        assert_string_equal(info->source, source);
        assert_int_equal(info->nonfinite, 0);
        /* The range is almost reached: a peak need not be at the centre of a voxel. */
        assert_compare(info->range[0], >=, expected[i].low);
        assert_compare(info->range[0], <=, expected[i].low + 1e-4);
        assert_compare(info->range[1], <=, expected[i].high);
        assert_compare(info->range[1], >=, 0.99 * expected[i].high);
        for (int b = 0; b < SP_HISTOGRAM_BINS; b++)
            counted += info->histogram[b];
        assert_int_equal(counted, voxels);
        sp_volume_unref(&volume);
    }
}

static uint64_t continue_fnv(uint64_t hash, const void *data, uint64_t n) {
    const unsigned char *bytes = data;
    for (uint64_t i = 0; i < n; i++)
        hash = (hash ^ bytes[i]) * UINT64_C(0x100000001b3);
    return hash;
}

static uint64_t fnv(const struct sp_volume *volume) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    uint64_t hash =
        continue_fnv(UINT64_C(0xcbf29ce484222325), sp_volume_voxels(volume), info->voxel_bytes);
    hash = continue_fnv(hash, sp_volume_vectors(volume), info->vector_bytes);
    return continue_fnv(hash, sp_volume_voxels(volume), info->element_bytes);
}

/* Demos are computed by as many threads as there are CPUs that the process may use. */
static void demos_do_not_depend_on_threads(void **state) {
    (void)state;
    cpu_set_t all, one;
    assert_int_equal(sched_getaffinity(0, sizeof all, &all), 0);
    if (CPU_COUNT(&all) < 2) {
        print_message("skipped: this test needs at least two CPUs\n");
        skip();
    }
    int first = 0;
    while (!CPU_ISSET(first, &all))
        first++;
    CPU_ZERO(&one);
    CPU_SET(first, &one);
    for (size_t i = 0; sp_demo_at(i); i++) {
        char source[64];
        snprintf(source, sizeof source, "demo:%s?size=48", sp_demo_at(i)->name);
        struct sp_volume *many = load(source), *again = load(source);
        assert_int_equal(sched_setaffinity(0, sizeof one, &one), 0);
        assert_int_equal(sp_volume_threads(), 1);
        struct sp_volume *single = load(source);
        assert_int_equal(sched_setaffinity(0, sizeof all, &all), 0);
        assert_int_equal(fnv(many), fnv(again));
        assert_int_equal(fnv(many), fnv(single));
        assert_memory_equal(sp_volume_info(many)->histogram, sp_volume_info(single)->histogram,
                            sizeof sp_volume_info(many)->histogram);
        sp_volume_unref(&many);
        sp_volume_unref(&again);
        sp_volume_unref(&single);
    }
}

static void sizes_from_8_to_1024_are_accepted(void **state) {
    (void)state;
    for (size_t i = 0; sp_demo_at(i); i++) {
        char source[64];
        snprintf(source, sizeof source, "demo:%s?size=8", sp_demo_at(i)->name);
        struct sp_volume *volume = load(source);
        const struct sp_volume_info *info = sp_volume_info(volume);
        if (info->elements.kind == SP_KIND_GRID)
            assert_int_equal(info->grid.dims[0], 8);
        else
            assert_compare(info->elements.count, >=, 64);
        if (info->elements.kind == SP_KIND_GRID || info->elements.kind == SP_KIND_POINTS)
            assert_compare(info->range[1], >, info->range[0]);
        sp_volume_unref(&volume);
    }
    struct sp_volume *volume = load("demo:checkerboard?size=1024");
    assert_int_equal(sp_volume_info(volume)->grid.dims[1], 1024);
    assert_int_equal(sp_volume_info(volume)->grid.dims[2], 3);
    sp_volume_unref(&volume);
}

static void errors_explain_bad_sources(void **state) {
    (void)state;
    static const struct {
        const char *source;
        enum sp_code code;
        const char *text;
    } cases[] = {
        { "demo:", SP_ERR_NOT_FOUND, "phantom, engine, vessels, marschner-lobb" },
        { "demo:Phantom", SP_ERR_NOT_FOUND, "checkerboard, hydrogen, galaxy, sparse" },
        { "demo:phantom ", SP_ERR_NOT_FOUND, "no such built-in volume" },
        { "demo:phantom?", SP_ERR_INVALID, "?size=N" },
        { "demo:phantom?size=", SP_ERR_INVALID, "[8, 1024]" },
        { "demo:phantom?size=7", SP_ERR_INVALID, "[8, 1024]" },
        { "demo:phantom?size=1025", SP_ERR_INVALID, "[8, 1024]" },
        { "demo:phantom?size=-64", SP_ERR_INVALID, "[8, 1024]" },
        { "demo:phantom?size=064", SP_ERR_INVALID, "[8, 1024]" },
        { "demo:phantom?size=64 ", SP_ERR_INVALID, "[8, 1024]" },
        { "demo:phantom?size=6e1", SP_ERR_INVALID, "[8, 1024]" },
        { "demo:phantom?size=18446744073709551680", SP_ERR_INVALID, "[8, 1024]" },
        { "demo:phantom?size=64&seed=3", SP_ERR_INVALID, "nothing or ?size=N" },
        { "demo:phantom?SIZE=64", SP_ERR_INVALID, "nothing or ?size=N" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct sp_error err;
        assert_null(sp_volume_load(cases[i].source, NULL, &err));
        assert_int_equal(err.code, cases[i].code);
        assert_string_equal(err.place, cases[i].source);
        if (!strstr(err.text, cases[i].text))
            fail_msg("%s: \"%s\" does not contain \"%s\"", cases[i].source, err.text,
                     cases[i].text);
    }
}

static void assert_near(double value, double expected, double tolerance) {
    if (!(fabs(value - expected) <= tolerance))
        fail_msg("%.9g is not %.9g within %g", value, expected, tolerance);
}

static void marschner_lobb_has_the_published_values(void **state) {
    (void)state;
    struct sp_volume *volume = load("demo:marschner-lobb");
    /* Sample i lies at i/20 − 1. At the origin cos(12π cos 0) = 1: (1 − 0 + 0.25·2)/2.5. */
    assert_near(sample(volume, 20, 20, 20), 0.6, 1e-6);
    assert_near(sample(volume, 20, 20, 40), 0.2, 1e-6);
    assert_near(sample(volume, 20, 20, 0), 1.0, 1e-6);
    /* r = 1: cos(12π·0) = 1 in every direction. */
    assert_near(sample(volume, 40, 20, 20), 0.6, 1e-6);
    assert_near(sample(volume, 20, 0, 20), 0.6, 1e-6);
    /* r = 0.5, z = 0.5: sin(π/4) = 0.70710678, cos(π/4)·12π = 26.657298 → cos = 0.0378... */
    double wave = cos(12 * M_PI * 0.70710678118654752);
    assert_near(sample(volume, 30, 20, 30), (1 - 0.70710678 + 0.25 * (1 + wave)) / 2.5, 1e-6);
    /* In a slice the value depends only on the radius: 3² + 4² = 5². */
    assert_near(sample(volume, 23, 24, 11), sample(volume, 25, 20, 11), 1e-6);
    sp_volume_unref(&volume);
}

static void hydrogen_has_two_lobes_and_a_nodal_cone(void **state) {
    (void)state;
    struct sp_volume *volume = load("demo:hydrogen?size=220"); /* a voxel is 0.2 Bohr radii */
    /* On the axis, r = 5.9 and 6.1, voxels 139 and 140 in z (x = y = 0.1): the peak, 255. */
    assert_near(sample(volume, 110, 110, 139), 255, 1);
    assert_near(sample(volume, 110, 110, 80), 255, 1);
    /* In the plane z = 0 the density is a quarter of that: (−r²)² against (2r²)². */
    assert_near(sample(volume, 139, 110, 110), 63.75, 1.5);
    assert_near(sample(volume, 110, 80, 110), 63.75, 1.5);
    /* The density is 0 on the cone 3z² = r², here x = √2·z, z = 4.1, x = 5.8. */
    assert_compare(sample(volume, 139, 110, 130), <=, 1);
    assert_near(sample(volume, 110, 110, 110), 0, 1);
    assert_near(sample(volume, 0, 0, 0), 0, 0);
    sp_volume_unref(&volume);
}

static void phantom_has_the_published_values(void **state) {
    (void)state;
    struct sp_volume *volume = load("demo:phantom?size=200"); /* x = (i + 0.5)/100 − 1 */
    const struct {
        double x, y, z, value;
    } points[] = {
        { 0, 0.9, 0, 1.0 },                                /* skull */
        { 0.675, 0, 0, 1.0 },                              /* between 0.6624 and 0.69 */
        { 0, -0.3, 0, 0.2 },                               /* brain: 1 − 0.8 */
        { 0.22, 0, 0, 0.0 },                               /* right ventricle: 0.2 − 0.2 */
        { -0.22, 0, 0, 0.0 },                              /* left ventricle */
        { 0, 0.4, -0.15, 0.3 },                            /* the large one, 0.2 + 0.1 */
        { 0, 0.1, 0.25, 0.3 },                             /* a small one */
        { 0, -0.1, 0.25, 0.3 },                            /* another */
        { -0.08, -0.605, 0, 0.3 },                         /* the three at the bottom */
        { 0.06, -0.605, 0, 0.3 },  { 0.95, 0.95, 0, 0.0 }, /* outside */
    };
    for (size_t i = 0; i < sizeof points / sizeof points[0]; i++) {
        uint32_t at[3] = { (uint32_t)((points[i].x + 1) * 100), (uint32_t)((points[i].y + 1) * 100),
                           (uint32_t)((points[i].z + 1) * 100) };
        assert_near(sample(volume, at[0], at[1], at[2]), points[i].value, 2e-6);
    }
    /* Anti-aliasing preserves the mass: the sum of 4/3·π·abc·value over the ellipsoids. */
    double sum = 0,
           mass = 0.69 * 0.92 * 0.81 - 0.8 * 0.6624 * 0.874 * 0.78 -
                  0.2 * (0.11 * 0.31 * 0.22 + 0.16 * 0.41 * 0.28) +
                  0.1 * (0.21 * 0.25 * 0.41 + 2 * 0.046 * 0.046 * 0.05 + 0.046 * 0.023 * 0.05 +
                         0.023 * 0.023 * 0.02 + 0.023 * 0.046 * 0.02);
    const float *voxels = sp_volume_voxels(volume);
    for (size_t i = 0; i < 200u * 200 * 200; i++)
        sum += (double)voxels[i];
    assert_near(sum * 1e-6 / (4 * M_PI / 3 * mass), 1, 2e-3);
    sp_volume_unref(&volume);
}

static void checkerboard_alternates(void **state) {
    (void)state;
    struct sp_volume *volume = load("demo:checkerboard");
    for (uint32_t k = 0; k < 3; k++) {
        assert_near(sample(volume, 0, 0, k), 192, 0);
        assert_near(sample(volume, 15, 15, k), 192, 0);
        assert_near(sample(volume, 16, 15, k), 64, 0);
        assert_near(sample(volume, 15, 16, k), 64, 0);
        assert_near(sample(volume, 511, 511, k), 192, 0);
    }
    assert_int_equal(sp_volume_info(volume)->histogram[0], 512 * 512 * 3 / 2);
    assert_int_equal(sp_volume_info(volume)->histogram[255], 512 * 512 * 3 / 2);
    sp_volume_unref(&volume);
}

static void engine_is_made_of_three_materials(void **state) {
    (void)state;
    struct sp_volume *volume = load("demo:engine");
    const uint64_t *bins = sp_volume_info(volume)->histogram;
    uint64_t voxels = 160 * 90 * 90, pure = 0;
    static const double values[] = { 0, 110, 190, 235 };
    for (int i = 0; i < 4; i++) {
        int bin = (int)(values[i] * 256 / 235);
        assert_compare(bins[bin > 255 ? 255 : bin], >, voxels / 1000);
        pure += bins[bin > 255 ? 255 : bin];
    }
    assert_compare(pure, >, voxels * 3 / 4); /* the others are at boundaries */
    /* Symmetric in y, except for the oil gallery, which ends before the front. */
    assert_near(sample(volume, 80, 20, 60), sample(volume, 80, 69, 60), 0);
    /* The middle of a bore is air above the piston crown. */
    double bore_x = (1 - 0.5 * 0.38) * 80;
    assert_near(sample(volume, (uint32_t)bore_x, 45, 70), 0, 0);
    sp_volume_unref(&volume);
}

/* The spacing is fine in the middle, coarse outside and symmetric. The shape is the same for every
 * number of samples. */
static void galaxy_is_finer_in_the_middle(void **state) {
    (void)state;
    struct sp_volume *volume = load("demo:galaxy"), *fine = load("demo:galaxy?size=191");
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    for (int axis = 0; axis < 3; axis++) {
        const double *c = grid->coordinates[axis];
        uint32_t last = grid->dims[axis] - 1;
        assert_non_null(c);
        assert_near(c[last], last, 1e-12 * last);
        for (uint32_t i = 0; i < last; i++) {
            assert_near(c[i] + c[last - i], last, 1e-12 * last);
            double gap = c[i + 1] - c[i], before = i ? gap - (c[i] - c[i - 1]) : -1;
            assert_compare(i > last / 2 ? before : -before, >, 0);
        }
        assert_near((c[1] - c[0]) / (c[last / 2 + 1] - c[last / 2]), cosh(3), 1.2);
    }
    /* Every second sample of the finer volume has the same relative position. */
    for (uint32_t i = 0; i < 96; i += 5)
        assert_near(grid->coordinates[0][i] / 95,
                    sp_volume_info(fine)->grid.coordinates[0][2 * i] / 190, 1e-12);
    assert_near(sample(volume, 48, 48, 24), 4000, 20); /* the core */
    /* The two arms are symmetric under a rotation by 180° about the axis. */
    uint32_t arms = 0;
    for (uint32_t i = 0; i < 96; i++)
        for (uint32_t j = 0; j < 96; j++) {
            assert_near(sample(volume, i, j, 20), sample(volume, 95 - i, 95 - j, 20), 1);
            assert_near(sample(volume, i, j, 20), sample(volume, i, j, 27), 1);
            arms += sample(volume, i, j, 20) > 1000;
        }
    assert_compare(arms, >, 500);
    assert_compare(arms, <, 96 * 96 / 2);
    sp_volume_unref(&volume);
    sp_volume_unref(&fine);
}

/* The balls fill a twentieth of the volume. Their surface has the value 100; 50 is halfway to the
 * empty space. */
static void sparse_fills_a_twentieth(void **state) {
    (void)state;
    static const char *const sources[] = { "demo:sparse?size=96", "demo:sparse?size=200" };
    for (int s = 0; s < 2; s++) {
        struct sp_volume *volume = load(sources[s]);
        const struct sp_volume_info *info = sp_volume_info(volume);
        const uint8_t *voxels = sp_volume_voxels(volume);
        uint64_t inside = 0, count = info->voxel_bytes;
        uint32_t n = info->grid.dims[0], occupied = 0;
        for (uint64_t i = 0; i < count; i++)
            inside += voxels[i] > 50;
        assert_near((double)inside / (double)count, 0.05, 0.002);
        /* Each of the 1000 cells contains one ball. */
        for (uint32_t cell = 0; cell < 1000; cell++) {
            uint32_t low[3], high[3], most = 0;
            for (uint32_t axis = 0, rest = cell; axis < 3; axis++, rest /= 10) {
                low[axis] = rest % 10 * n / 10;
                high[axis] = (rest % 10 + 1) * n / 10;
            }
            for (uint32_t k = low[2]; k < high[2]; k++)
                for (uint32_t j = low[1]; j < high[1]; j++)
                    for (uint32_t i = low[0]; i < high[0]; i++) {
                        uint32_t v = voxels[((size_t)k * n + j) * n + i];
                        most = v > most ? v : most;
                    }
            occupied += most > 100;
        }
        assert_int_equal(occupied, 1000);
        sp_volume_unref(&volume);
    }
}

/* A flood fill from the root of the trunk reaches the whole tree. */
static void vessels_are_connected(void **state) {
    (void)state;
    enum { N = 160, COUNT = N * N * N };
    struct sp_volume *volume = load("demo:vessels");
    const uint16_t *voxels = sp_volume_voxels(volume);
    static uint8_t seen[COUNT];
    static uint32_t stack[COUNT];
    size_t depth = 0, reached = 0, solid = 0;
    for (size_t i = 0; i < COUNT; i++)
        solid += voxels[i] > 900;
    uint32_t root = (N * 10 + N / 2) * N + N / 2;
    assert_compare(voxels[root], >, 900);
    seen[root] = 1;
    stack[depth++] = root;
    while (depth > 0) {
        uint32_t at = stack[--depth], x = at % N, y = at / N % N, z = at / (N * N);
        reached++;
        for (int dz = -1; dz <= 1; dz++)
            for (int dy = -1; dy <= 1; dy++)
                for (int dx = -1; dx <= 1; dx++) {
                    uint32_t nx = x + (uint32_t)dx, ny = y + (uint32_t)dy, nz = z + (uint32_t)dz;
                    if (nx >= N || ny >= N || nz >= N)
                        continue;
                    uint32_t next = (nz * N + ny) * N + nx;
                    if (!seen[next] && voxels[next] > 300) {
                        seen[next] = 1;
                        stack[depth++] = next;
                    }
                }
    }
    assert_compare(solid, >, 10000);
    assert_compare(solid, <, COUNT / 20);
    assert_compare(reached, >, solid * 97 / 100);
    sp_volume_unref(&volume);
}

/* The samples of a wind are its speeds. */
static void assert_samples_are_lengths(const struct sp_volume *volume) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    const float *speeds = sp_volume_voxels(volume);
    const float(*wind)[3] = sp_volume_vectors(volume);
    assert_string_equal(info->value_name, "magnitude");
    assert_string_equal(info->vector_name, "wind");
    assert_int_equal(info->vector_bytes, 3 * info->voxel_bytes);
    assert_near(info->longest, info->range[1], 1e-5);
    for (size_t i = 0; i < info->voxel_bytes / sizeof *speeds; i++) {
        const float *v = wind[i];
        float length = sqrtf(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        assert_near((double)speeds[i], (double)length, 1e-6 * (double)(1 + length));
    }
}

static void tornado_turns_rises_and_widens(void **state) {
    (void)state;
    enum { N = 48 };
    struct sp_volume *volume = load("demo:tornado?size=48");
    const float(*wind)[3] = sp_volume_vectors(volume);
    uint32_t before = 0;
    assert_samples_are_lengths(volume);
    for (uint32_t k = 0; k < N; k += 12) {
        const float(*layer)[3] = wind + (size_t)k * N * N;
        double x = 0, y = 0, lift = 0, turn = 0;
        uint32_t fast = 0;
        for (uint32_t i = 0; i < N * N; i++) { /* the axis: the mean place of the updraft */
            double up = (double)layer[i][2];
            assert_compare(up, >=, 0);
            lift += up;
            x += up * (i % N);
            y += up * (i / N);
        }
        for (uint32_t i = 0; i < N * N; i++) {
            double dx = i % N - x / lift, dy = i / N - y / lift;
            turn += dx * (double)layer[i][1] - dy * (double)layer[i][0];
            fast += hypot((double)layer[i][0], (double)layer[i][1]) > 30;
        }
        assert_compare(turn, >, 0); /* counterclockwise seen from above */
        assert_compare(fast, >, before);
        before = fast;
    }
    sp_volume_unref(&volume);
}

/* Central differences of the wind at every height add up to nearly nothing. */
static void jet_has_shear_and_no_divergence(void **state) {
    (void)state;
    struct sp_volume *volume = load("demo:jet");
    const float(*wind)[3] = sp_volume_vectors(volume);
    assert_samples_are_lengths(volume);
    double divergence = 0, shear = 0, west = 0, east = 0;
    for (uint32_t k = 0; k < 32; k++)
        for (uint32_t j = 1; j < 63; j++)
            for (uint32_t i = 1; i < 127; i++) {
                const float(*at)[3] = wind + (k * 64 + j) * 128 + i;
                divergence += fabs((double)(at[1][0] - at[-1][0] + at[128][1] - at[-128][1]));
                shear += fabs((double)(at[128][0] - at[-128][0]));
                west = fmax(west, (double)at[0][0]);
                east = fmin(east, (double)at[0][0]);
                assert_compare(at[0][2], ==, 0);
            }
    assert_compare(divergence, <, 0.05 * shear);
    assert_near(west, 75, 5);
    assert_compare(east, <, -5);
    sp_volume_unref(&volume);
}

struct calls {
    int reserves, progresses;
    uint64_t bytes;
    double last;
    bool refuse;
    int cancel_after; /* progress calls; 0 = do not cancel */
};

static bool on_reserve(void *user, uint64_t bytes, struct sp_error *err) {
    struct calls *c = user;
    c->reserves++;
    c->bytes = bytes;
    return !c->refuse || sp_fail(err, SP_ERR_BUDGET, "", "needs %d, has %d", 2, 1);
}

static bool on_progress(void *user, double fraction) {
    struct calls *c = user;
    assert_compare(fraction, >=, 0);
    assert_compare(fraction, <=, 1);
    c->last = fraction;
    return ++c->progresses != c->cancel_after;
}

static void budget_progress_and_cancellation_are_applied(void **state) {
    (void)state;
    struct calls calls = { 0 };
    struct sp_load_options options = { .reserve = on_reserve,
                                       .progress = on_progress,
                                       .user = &calls };
    struct sp_error err;
    struct sp_volume *volume = sp_volume_load("demo:phantom?size=128", &options, &err);
    assert_non_null(volume);
    assert_int_equal(calls.reserves, 1);
    assert_int_equal(calls.bytes, 128 * 128 * 128 * 4);
    assert_compare(calls.progresses, >, 1);
    assert_compare(calls.last, ==, 1);
    sp_volume_unref(&volume);

    calls = (struct calls){ .refuse = true };
    assert_null(sp_volume_load("demo:jet?size=1024", &options, &err));
    assert_int_equal(calls.bytes, UINT64_C(1024) * 512 * 256 * (4 + 3 * 4));
    assert_null(sp_volume_load("demo:phantom?size=1024", &options, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_int_equal(calls.bytes, UINT64_C(4) << 30);
    assert_int_equal(calls.progresses, 0);

    calls = (struct calls){ .cancel_after = 1 };
    assert_null(sp_volume_load("demo:engine", &options, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        one_thread_test(every_demo_has_the_documented_size_type_and_range),
        cmocka_unit_test(demos_do_not_depend_on_threads),
        one_thread_test(sizes_from_8_to_1024_are_accepted),
        one_thread_test(errors_explain_bad_sources),
        one_thread_test(marschner_lobb_has_the_published_values),
        one_thread_test(hydrogen_has_two_lobes_and_a_nodal_cone),
        one_thread_test(phantom_has_the_published_values),
        one_thread_test(checkerboard_alternates),
        one_thread_test(engine_is_made_of_three_materials),
        one_thread_test(galaxy_is_finer_in_the_middle),
        one_thread_test(sparse_fills_a_twentieth),
        one_thread_test(vessels_are_connected),
        one_thread_test(tornado_turns_rises_and_widens),
        one_thread_test(jet_has_shear_and_no_divergence),
        cmocka_unit_test(budget_progress_and_cancellation_are_applied),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
