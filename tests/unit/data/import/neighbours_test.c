/* SPDX-License-Identifier: Apache-2.0
 *
 * The size of points from their neighbours. The points change their order, so tests compare what
 * does not depend on it, or find a point by its value.
 */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/neighbours.h"
#include "data/volume/elements.h"
#include "unit/data/import/support.h"

static struct sp_elements make_points(uint32_t count) {
    const struct sp_elements_shape shape = { .kind = SP_KIND_POINTS, .count = count };
    void *memory = aligned_alloc(64, sp_elements_bytes(&shape));
    assert_non_null(memory);
    memset(memory, 0, sp_elements_bytes(&shape));
    struct sp_elements e = sp_elements_at(&shape, memory);
    for (uint32_t i = 0; i < count; i++)
        e.values[i] = (float)i;
    return e;
}

static void free_points(struct sp_elements *e) {
    free((char *)e->positions - 64); /* behind the sample */
}

static void finish(const struct sp_elements *e) {
    struct sp_error err;
    if (!import_neighbours_finish(e, NULL, &err))
        fail_msg("%s", err.text);
    for (uint32_t i = 0; i < e->shape.count; i++) {
        assert_compare(e->volumes[i], >=, FLT_MIN);
        assert_compare(e->volumes[i], <=, FLT_MAX);
        for (int k = 0; k < 6; k++)
            assert_true(isfinite(e->factors[i][k]));
    }
}

/* A lattice with this spacing whose points are shuffled. */
static struct sp_elements make_lattice(uint32_t n, float spacing) {
    struct sp_elements e = make_points(n * n * n);
    for (uint32_t i = 0; i < n * n * n; i++) {
        uint32_t at = (uint32_t)((uint64_t)i * 7919 % (n * n * n));
        e.positions[i][0] = spacing * (float)(at % n) - 7;
        e.positions[i][1] = spacing * (float)(at / n % n);
        e.positions[i][2] = spacing * (float)(at / n / n) + 100;
    }
    return e;
}

static void a_lattice_has_the_kernel_of_a_grid(void **state) {
    enum { N = 12 };
    const double spacing = 0.25;
    (void)state;
    struct sp_elements e = make_lattice(N, (float)spacing);
    finish(&e);
    uint32_t inside = 0;
    double sum = 0;
    for (uint32_t i = 0; i < e.shape.count; i++) {
        bool is_inside = true;
        static const double origin[3] = { -7, 0, 100 };
        for (int a = 0; a < 3; a++) {
            double at = ((double)e.positions[i][a] - origin[a]) / spacing;
            is_inside &= at > 1.5 && at < N - 2.5;
        }
        sum += (double)e.volumes[i];
        if (!is_inside)
            continue;
        inside++;
        static const double unit[6] = { 1, 0, 1, 0, 0, 1 };
        for (int k = 0; k < 6; k++)
            assert_float_equal(e.factors[i][k], 0.7 * spacing * unit[k], 1e-6);
        assert_float_equal(e.volumes[i], spacing * spacing * spacing, 1e-7);
    }
    assert_int_equal(inside, (N - 4) * (N - 4) * (N - 4));
    /* The cells fill the cube that they stand for, also at its border. */
    assert_float_equal(sum / (e.shape.count * spacing * spacing * spacing), 1, 0.06);
    free_points(&e);
}

static double random_number(uint64_t *seed) {
    *seed = *seed * UINT64_C(6364136223846793005) + 1442695040888963407u;
    return (double)(*seed >> 11) / 9007199254740992.0;
}

/* Compares with the neighbours that a search through all points finds. */
static void neighbours_are_the_nearest(void **state) {
    enum { COUNT = 1500, K = 18 };
    uint64_t seed = 5;
    (void)state;
    struct sp_elements e = make_points(COUNT);
    for (uint32_t i = 0; i < COUNT; i++)
        for (int a = 0; a < 3; a++) /* dense and thin parts */
            e.positions[i][a] = (float)(pow(random_number(&seed), 1 + a) * (i % 5 ? 1 : 100));
    finish(&e);
    for (uint32_t i = 0; i < COUNT; i += 7) {
        double nearest[K], sum[3] = { 0 }, squares = 0;
        uint32_t at[K], found = 0;
        for (uint32_t j = 0; j < COUNT; j++) {
            double d = 0;
            for (int a = 0; a < 3; a++)
                d += pow((double)e.positions[j][a] - (double)e.positions[i][a], 2);
            uint32_t k = j == i || (found == K && d >= nearest[K - 1]) ? K
                         : found < K                                   ? found++
                                                                       : K - 1;
            for (; k < K && k > 0 && nearest[k - 1] > d; k--) {
                nearest[k] = nearest[k - 1];
                at[k] = at[k - 1];
            }
            if (k < K) {
                nearest[k] = d;
                at[k] = j;
            }
        }
        for (int k = 0; k < K; k++) {
            squares += nearest[k];
            for (int a = 0; a < 3; a++)
                sum[a] += (double)e.positions[at[k]][a] - (double)e.positions[i][a];
        }
        double n = K + 1, mean = squares / n;
        for (int a = 0; a < 3; a++)
            mean -= sum[a] * sum[a] / (n * n);
        mean *= 19 / 30.;
        mean += 0.1 * (mean - fmin(mean, nearest[0]));
        assert_float_equal((double)e.volumes[i] / pow(mean, 1.5), 1, 1e-4);
    }
    free_points(&e);
}

/* The volumes of random points add up to the volume of the box that they fill. */
static void volumes_of_random_points_fill_their_box(void **state) {
    enum { COUNT = 40000 };
    uint64_t seed = 9;
    (void)state;
    struct sp_elements e = make_points(COUNT);
    for (uint32_t i = 0; i < COUNT; i++)
        for (int a = 0; a < 3; a++)
            e.positions[i][a] = (float)random_number(&seed);
    finish(&e);
    double sum = 0, border = 0.08; /* where neighbours are missing */
    for (uint32_t i = 0; i < COUNT; i++) {
        bool is_inside = true;
        for (int a = 0; a < 3; a++)
            is_inside &= fabs((double)e.positions[i][a] - 0.5) < 0.5 - border;
        sum += is_inside ? (double)e.volumes[i] : 0;
    }
    assert_float_equal(sum / pow(1 - 2 * border, 3), 1, 0.015);
    free_points(&e);
}

/* A plane, a line, and a corner have kernels with a thickness. */
static void flat_sets_have_a_thickness(void **state) {
    (void)state;
    for (int dimensions = 0; dimensions < 3; dimensions++)
        for (int turned = 0; turned < 3; turned++) {
            struct sp_elements e = make_points(100);
            for (uint32_t i = 0; i < 100; i++)
                for (int a = 0; a < dimensions; a++)
                    e.positions[i][(a + turned) % 3] = (float)(a                 ? i / 10
                                                               : dimensions == 1 ? i
                                                                                 : i % 10);
            finish(&e);
            for (uint32_t i = 0; i < 100; i++) {
                const double share = dimensions ? 1 : 100; /* at one place */
                const double edge = cbrt(share * (double)e.volumes[i]);
                assert_compare(edge, >, dimensions ? 0.5 : 0.99);
                assert_compare(edge, <, dimensions ? 12 : 1.01);
                for (int k = 0; k < 6; k++)
                    if (k == 0 || k == 2 || k == 5)
                        assert_compare(e.factors[i][k], >=, 0.069 * edge);
            }
            free_points(&e);
        }
}

static void few_points_have_a_size(void **state) {
    (void)state;
    for (uint32_t count = 0; count < 30; count++) {
        uint64_t seed = count;
        struct sp_elements e = make_points(count);
        for (uint32_t i = 0; i < count; i++)
            for (int a = 0; a < 3; a++)
                e.positions[i][a] = (float)random_number(&seed);
        finish(&e);
        if (count == 1) {
            assert_float_equal(e.volumes[0], 1, 0);
            assert_float_equal(e.factors[0][0], 0.7, 1e-6);
        }
        free_points(&e);
    }
}

/* Points at one place have the kernel of that place, and share its volume. */
static void coincident_points_share_their_space(void **state) {
    enum { N = 7, SITES = N * N * N };
    (void)state;
    for (uint32_t most = 1; most <= 64; most *= 4) {
        struct sp_elements once = make_lattice(N, 2);
        struct sp_elements e = make_points(SITES * most);
        double volumes[SITES] = { 0 }, expected[SITES];
        uint32_t count = 0, copies[SITES] = { 0 };
        for (uint32_t i = 0; i < SITES; i++)
            for (uint32_t k = 0; k <= i * 7 % most; k++, count++) { /* some of them are alone */
                memcpy(e.positions[count], once.positions[i], sizeof e.positions[count]);
                for (int a = 0; a < 3; a++) /* zeros have both signs */
                    e.positions[count][a] *= e.positions[count][a] == 0 && k % 3 ? -1 : 1;
                e.values[count] = (float)(once.values[i] + 0.5f * (float)(k % 2));
                copies[i]++;
            }
        e.shape.count = count;
        finish(&once);
        finish(&e);
        for (uint32_t i = 0; i < SITES; i++)
            expected[(uint32_t)once.values[i]] = (double)once.volumes[i];
        for (uint32_t i = 0; i < count; i++) {
            const uint32_t site = (uint32_t)e.values[i];
            volumes[site] += (double)e.volumes[i];
            assert_float_equal((double)e.volumes[i] * copies[site], expected[site],
                               0.2 * expected[site]); /* neighbours at equal distances differ */
        }
        double sum = 0, all = 0;
        for (uint32_t i = 0; i < SITES; i++) {
            sum += volumes[i];
            all += expected[i];
        }
        assert_float_equal(sum / all, 1, 0.01);
        free_points(&once);
        e.shape.count = SITES * most;
        free_points(&e);
    }
}

/* Most points coincide; some are not finite, or as far away as a float can be. */
static void coincident_and_infinite_points_have_a_size(void **state) {
    (void)state;
    struct sp_elements e = make_points(5000);
    for (uint32_t i = 0; i < 5000; i++) {
        for (int a = 0; a < 3; a++)
            e.positions[i][a] = i % 100 ? 1 : (float)i;
        if (i % 50 == 7)
            e.positions[i][i % 3] = i % 4 ? NAN : -INFINITY;
        if (i == 500)
            e.positions[i][1] = -1e30f;
        e.values[i] = i % 50 == 7 ? -1 : e.positions[i][0];
    }
    finish(&e);
    uint32_t bad = 0;
    for (uint32_t i = 0; i < 5000; i++) {
        bool is_bad = e.values[i] < 0;
        bad += is_bad;
        assert_int_equal(is_bad, i >= 4900); /* they come last */
        if (!is_bad)                         /* values move with their points */
            assert_float_equal(e.positions[i][0], e.values[i], 0);
    }
    assert_int_equal(bad, 100);
    free_points(&e);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_lattice_has_the_kernel_of_a_grid),
        cmocka_unit_test(neighbours_are_the_nearest),
        cmocka_unit_test(volumes_of_random_points_fill_their_box),
        cmocka_unit_test(flat_sets_have_a_thickness),
        cmocka_unit_test(few_points_have_a_size),
        cmocka_unit_test(coincident_points_share_their_space),
        cmocka_unit_test(coincident_and_infinite_points_have_a_size),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
