/* SPDX-License-Identifier: Apache-2.0
 *
 * The kernel that turns moments into depth and spread (frame/depth.h): every instruction set that
 * this machine supports against the definition in double precision.
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

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

static void check_depth(const struct cpu_kernels *kernels) {
    enum { MOST = 70 };
    srand(17);
    for (uint32_t count = 1; count <= MOST; count++) {
        float plane[3][MOST], place[2][MOST], out[2][MOST + 2];
        double mean[MOST], spread[MOST];
        const float *const planes[3] = { plane[0], plane[1], plane[2] };
        const float *const places[2] = { place[0], place[1] };
        for (uint32_t i = 0; i < count; i++) {
            const double opacity = i % 5 ? uniform(0.01, 1) : uniform(0, 0.0009);
            mean[i] = uniform(-20, 20);
            spread[i] = i % 3 ? uniform(1, 5) : 0;
            plane[0][i] = (float)(1 - opacity);
            const double shown = 1 - (double)plane[0][i];
            plane[1][i] = (float)(shown * mean[i]);
            plane[2][i] = (float)(shown * (mean[i] * mean[i] + spread[i] * spread[i]));
            place[0][i] = (float)uniform(50, 60);
            place[1][i] = (float)uniform(-2, 2);
        }
        memset(out, 0x5a, sizeof out);
        kernels->resolve_depth(planes, places, count, out[0], out[1]);
        for (uint32_t i = 0; i < count; i++) {
            if (i % 5 == 0) { /* nearly transparent */
                assert_true(out[0][i] == INFINITY && out[1][i] == 0);
                continue;
            }
            const double factor = (double)place[1][i];
            const double depth = (double)place[0][i] + factor * mean[i];
            assert_compare(fabs((double)out[0][i] - depth), <, 1e-4);
            assert_compare(fabs((double)out[1][i] - fabs(factor) * spread[i]),
                           <, spread[i]> 0 ? 1e-3 : 0.05); /* m2 − m1² loses digits */
        }
        for (int k = 0; k < 2; k++)
            for (size_t at = 4 * count; at < sizeof out[k]; at++)
                assert_int_equal(((unsigned char *)out[k])[at], 0x5a);
    }
}

static void depths_match_their_definition(void **state) {
    const char *isa;
    (void)state;
    for (unsigned i = 0; (isa = cpu_isa_at(i)); i++) {
        struct cpu_kernels kernels;
        struct sp_error err;
        if (cpu_kernels_init(&kernels, isa, &err))
            check_depth(&kernels);
        else
            printf("skipped: %s: %s\n", isa, err.text);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(depths_match_their_definition) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
