/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

#include "data/volume/procedural.h"
#include "support/compare.h"

static struct sp_volume *load(const char *source) {
    struct sp_error err = { .text = "" };
    struct sp_volume *volume = sp_volume_load(source, NULL, &err);
    if (!volume)
        fail_msg("%s: %s", source, err.text);
    return volume;
}

/* Its triangles face outwards, and their vector areas add up to nothing. */
static void the_torus_is_closed(void **state) {
    (void)state;
    struct sp_volume *volume = load("demo:torus?size=24");
    const struct sp_elements *e = sp_volume_elements(volume);
    double sum[3] = { 0, 0, 0 }, area = 0;
    assert_int_equal(e->shape.kind, SP_KIND_MESH);
    assert_int_equal(e->shape.count, 2 * 24 * 24);
    for (uint32_t t = 0; t < e->shape.count; t++) {
        const uint32_t *at = e->triangles[t];
        double edge[2][3], normal[3], along = 0;
        for (int a = 0; a < 3; a++)
            for (int k = 0; k < 2; k++)
                edge[k][a] = (double)(e->positions[at[k + 1]][a] - e->positions[at[0]][a]);
        for (int a = 0; a < 3; a++) {
            const int b = (a + 1) % 3, c = (a + 2) % 3;
            normal[a] = edge[0][b] * edge[1][c] - edge[0][c] * edge[1][b];
            sum[a] += normal[a];
            along += normal[a] * (double)e->normals[at[0]][a];
        }
        assert_compare(along, >, 0);
        area += along / 2;
    }
    for (int a = 0; a < 3; a++)
        assert_float_equal(sum[a], 0, 1e-5);
    assert_float_equal(area / (4 * M_PI * M_PI * 0.4), 1, 0.03);
    sp_volume_unref(&volume);
}

static void demos_of_elements_are_sound(void **state) {
    static const struct {
        const char *source;
        enum sp_kind kind;
        uint32_t count, degree;
        double box[3]; /* greatest extent */
    } expected[] = {
        { "demo:polar", SP_KIND_POINTS, 48 * 96 * 24, 0, { 2, 2, 0.5 } },
        { "demo:points", SP_KIND_POINTS, 100000, 0, { 9, 9, 1.2 } },
        { "demo:gaussians", SP_KIND_GAUSSIANS, 20000, 3, { 2.81, 2.81, 0.81 } },
    };
    (void)state;
    for (size_t d = 0; d < sizeof expected / sizeof *expected; d++) {
        struct sp_volume *volume = load(expected[d].source);
        const struct sp_volume_info *info = sp_volume_info(volume);
        const struct sp_elements *e = sp_volume_elements(volume);
        assert_int_equal(e->shape.kind, expected[d].kind);
        assert_int_equal(e->shape.count, expected[d].count);
        assert_int_equal(e->shape.degree, expected[d].degree);
        assert_int_equal(info->nonfinite, 0);
        for (int a = 0; a < 3; a++) {
            assert_compare(info->grid.spacing[a], <=, expected[d].box[a]);
            assert_compare(info->grid.spacing[a], >, 0.5 * expected[d].box[a]);
        }
        double volumes = 0;
        for (uint32_t i = 0; i < e->shape.count; i++) {
            assert_true(isfinite(e->factors[i][0]) && isfinite(e->positions[i][0]));
            assert_compare(e->factors[i][0], >, 0);
            assert_compare(e->factors[i][5], >, 0);
            volumes += e->volumes ? (double)e->volumes[i] : 0;
            if (e->opacities)
                assert_compare(e->opacities[i], <=, 1);
        }
        if (d == 0) /* the cells fill a ring from 0.4 to 1 that is 0.5 high */
            assert_float_equal(volumes / (M_PI * (1 - 0.16) * 0.5), 1, 2e-3);
        sp_volume_unref(&volume);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(demos_of_elements_are_sound),
                                        cmocka_unit_test(the_torus_is_closed) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
