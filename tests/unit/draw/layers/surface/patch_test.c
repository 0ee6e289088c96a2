/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/patch.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/compare.h"

static double random_share(uint32_t *state) {
    *state = *state * 1664525u + 1013904223u;
    return (*state >> 8) / 16777216.0;
}

struct piece {
    float at[3], area[3];
};

static int compute_patches(const double f[8], struct piece out[SURFACE_PARTS_MAX]) {
    struct sp_surface_patches patches = { 0 };
    struct sp_surface_parts parts;
    unsigned inside = 0;
    for (int c = 0; c < 8; c++)
        inside |= (unsigned)((float)f[c] >= 0) << c;
    sp_surface_parts_init(inside, &parts);
    patches.count = parts.count;
    for (int p = 0; p < parts.count; p++) {
        for (int c = 0; c < 8; c++)
            patches.f[c][p] = (float)f[c];
        patches.corners[p] = parts.corners[p];
        patches.sign[p] = parts.are_outside ? -1 : 1;
    }
    sp_surface_patches_compute(&patches);
    for (int p = 0; p < parts.count; p++)
        for (int a = 0; a < 3; a++) {
            out[p].at[a] = patches.at[a][p];
            out[p].area[a] = patches.area[a][p];
        }
    return parts.count;
}

/* The area, the direction and the centre of a plane are exact. Many small samples of the cell are
 * the reference. */
static void planes_are_exact(void **state) {
    (void)state;
    uint32_t random = 7;
    for (int round = 0; round < 300; round++) {
        double n[3], length = 0, f[8];
        for (int a = 0; a < 3; a++)
            n[a] = random_share(&random) - 0.5;
        for (int a = 0; a < 3; a++)
            length += n[a] * n[a];
        for (int a = 0; a < 3; a++)
            n[a] /= sqrt(length);
        double offset = 0;
        for (int a = 0; a < 3; a++)
            offset += n[a] * (0.2 + 0.6 * random_share(&random));
        int inside = 0;
        for (int c = 0; c < 8; c++) {
            f[c] = n[0] * (c & 1) + n[1] * (c >> 1 & 1) + n[2] * (c >> 2) - offset;
            inside += f[c] >= 0;
        }
        if (inside == 0 || inside == 8)
            continue;
        /* Lines along the axis that the plane faces most cross it once or not at all. */
        enum { STEPS = 200 };
        int b = fabs(n[0]) > fabs(n[1]) ? 0 : 1;
        b = fabs(n[2]) > fabs(n[b]) ? 2 : b;
        const int c = (b + 1) % 3, d = (b + 2) % 3;
        double count = 0, sum[3] = { 0 };
        for (int i = 0; i < STEPS; i++)
            for (int k = 0; k < STEPS; k++) {
                double p[3];
                p[c] = (i + 0.5) / STEPS;
                p[d] = (k + 0.5) / STEPS;
                p[b] = (offset - n[c] * p[c] - n[d] * p[d]) / n[b];
                if (p[b] < 0 || p[b] > 1)
                    continue;
                count++;
                for (int a = 0; a < 3; a++)
                    sum[a] += p[a];
            }
        const double area = count / (STEPS * STEPS) / fabs(n[b]);
        struct piece patch[SURFACE_PARTS_MAX];
        assert_int_equal(compute_patches(f, patch), 1);
        for (int a = 0; a < 3; a++) {
            assert_compare(fabs(patch[0].area[a] + n[a] * area), <, 0.01);
            if (area > 0.05)
                assert_compare(fabs(patch[0].at[a] - sum[a] / count), <, 0.02);
        }
    }
}

/* For any values, the points lie in the cell, and two cells agree about their common face: the
 * directed areas of all cells of a closed surface add up to zero. */
static void closed_surfaces_have_no_area(void **state) {
    (void)state;
    enum { N = 12 };
    double values[N][N][N], sum[3] = { 0 }, total = 0;
    uint32_t random = 3;
    for (int z = 0; z < N; z++)
        for (int y = 0; y < N; y++)
            for (int x = 0; x < N; x++) {
                int is_border = !x || !y || !z || x == N - 1 || y == N - 1 || z == N - 1;
                values[z][y][x] = is_border ? -1 : random_share(&random) - 0.5;
            }
    int most = 0;
    for (int z = 0; z + 1 < N; z++)
        for (int y = 0; y + 1 < N; y++)
            for (int x = 0; x + 1 < N; x++) {
                struct piece patch[SURFACE_PARTS_MAX];
                double f[8];
                unsigned inside = 0;
                for (int c = 0; c < 8; c++) {
                    f[c] = values[z + (c >> 2)][y + (c >> 1 & 1)][x + (c & 1)];
                    inside |= (unsigned)(f[c] >= 0) << c;
                }
                if (inside == 0 || inside == 255)
                    continue;
                int count = compute_patches(f, patch);
                most = count > most ? count : most;
                for (int p = 0; p < count; p++)
                    for (int a = 0; a < 3; a++) {
                        assert_compare(patch[p].at[a], >=, 0);
                        assert_compare(patch[p].at[a], <=, 1);
                        sum[a] += (double)patch[p].area[a];
                        total += fabs((double)patch[p].area[a]);
                    }
            }
    assert_int_equal(most, SURFACE_PARTS_MAX);
    for (int a = 0; a < 3; a++) /* where the outside has several parts, faces may differ */
        assert_compare(fabs(sum[a]), <, 0.02 * total);
}

/* Values that are equal to the iso-value, and the smallest that floats have. */
static void extreme_values_are_finite(void **state) {
    (void)state;
    static const double values[] = { 0, -0.0, 1e-38, -1e-38, 2, -2, 1, -1 };
    uint32_t random = 11;
    for (int round = 0; round < 20000; round++) {
        struct piece patch[SURFACE_PARTS_MAX];
        double f[8];
        int inside = 0;
        for (int c = 0; c < 8; c++) {
            f[c] = values[(int)(random_share(&random) * 8)];
            inside += f[c] >= 0;
        }
        if (inside == 0 || inside == 8)
            continue;
        int count = compute_patches(f, patch);
        for (int p = 0; p < count; p++)
            for (int a = 0; a < 3; a++) {
                assert_compare(fabs(patch[p].area[a]), <=, 1.000001);
                assert_compare(patch[p].at[a], >=, 0);
                assert_compare(patch[p].at[a], <=, 1);
            }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(planes_are_exact),
        cmocka_unit_test(closed_surfaces_have_no_area),
        cmocka_unit_test(extreme_values_are_finite),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
