/* SPDX-License-Identifier: Apache-2.0
 *
 * The choice of an instruction set: by name or automatically, and what its kernel table holds.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <string.h>

#include "backend/cpu/kernels.h"

/* Every set has kernels of its own, and its list names every setting of a view that they cover. */
static void no_set_falls_back_to_scalar(void **state) {
    (void)state;
    static const char *const choices[] = { "adaptive", "ewa",         "reconstruction", "lowpass",
                                           "swan",     "none",        "gaussian",       "cubic",
                                           "splat",    "sheet",       "slab",           "pre",
                                           "post",     "exponential", "linear",         "phong",
                                           "clip" };
    struct cpu_kernels scalar, kernels;
    assert_true(cpu_kernels_init(&scalar, "scalar", NULL));
    const char *isa;
    for (unsigned i = 1; (isa = cpu_isa_at(i)); i++) {
        if (!cpu_kernels_init(&kernels, isa, NULL))
            continue;
        assert_string_equal(kernels.isa, isa);
        assert_true(kernels.lanes == (strcmp(isa, "avx512") == 0 ? 16
                                      : strcmp(isa, "avx2") == 0 ? 8
                                                                 : 4));
        assert_true(kernels.set_up != scalar.set_up && kernels.tile_close != scalar.tile_close);
        assert_true(kernels.resolve_rgba8 != scalar.resolve_rgba8 &&
                    kernels.resolve_rgbaf32 != scalar.resolve_rgbaf32);
        for (int c = 0; c < 3; c++)
            assert_true(kernels.add[c] && kernels.add[c] != scalar.add[c]);
        for (size_t c = 0; c < sizeof choices / sizeof *choices; c++) {
            bool is_named = false;
            for (int k = 0; kernels.vectorised[k]; k++)
                is_named = is_named || strcmp(kernels.vectorised[k], choices[c]) == 0;
            assert_true(is_named);
        }
    }
}

static void sets_are_chosen_by_name(void **state) {
    (void)state;
    struct cpu_kernels kernels;
    struct sp_error err;
    assert_true(cpu_kernels_init(&kernels, "auto", NULL));
    const char *isa, *best = NULL;
    for (unsigned i = 0; (isa = cpu_isa_at(i)); i++)
        if (cpu_kernels_init(&(struct cpu_kernels){ 0 }, isa, &err)) {
            best = isa;
        } else {
            assert_int_equal(err.code, SP_ERR_UNSUPPORTED);
            assert_non_null(strstr(err.text, isa));
            assert_non_null(strstr(err.text, "scalar")); /* what there is */
        }
    assert_string_equal(kernels.isa, best);
    assert_false(cpu_kernels_init(&kernels, "mmx", &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_non_null(strstr(err.text, "mmx"));
    assert_non_null(strstr(err.text, best));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_set_falls_back_to_scalar),
        cmocka_unit_test(sets_are_chosen_by_name),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
