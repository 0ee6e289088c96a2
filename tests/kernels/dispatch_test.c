/* SPDX-License-Identifier: Apache-2.0
 *
 * The selection of an instruction set, by name or automatically, and the content of its kernel
 * table.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <string.h>

#include "backend/cpu/kernels.h"

/* Every instruction set has its own kernels. Its list `vectorised` names every setting of a view
 * that they cover. */
static void no_instruction_set_falls_back_to_scalar(void **state) {
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
        assert_int_equal(kernels.lanes, strcmp(isa, "avx512") == 0 ? 16
                                        : strcmp(isa, "avx2") == 0 ? 8
                                                                   : 4);
        assert_true(kernels.set_up != scalar.set_up);
        assert_true(kernels.tile_close != scalar.tile_close);
        assert_true(kernels.resolve_rgba8 != scalar.resolve_rgba8);
        assert_true(kernels.resolve_rgbaf32 != scalar.resolve_rgbaf32);
        for (int c = 0; c < 3; c++) {
            assert_non_null(kernels.add[c]);
            assert_true(kernels.add[c] != scalar.add[c]);
        }
        for (size_t c = 0; c < sizeof choices / sizeof *choices; c++) {
            bool is_named = false;
            for (int k = 0; kernels.vectorised[k]; k++)
                is_named = is_named || strcmp(kernels.vectorised[k], choices[c]) == 0;
            if (!is_named)
                fail_msg("%s: the list of vectorised settings lacks %s", isa, choices[c]);
        }
    }
}

static void instruction_sets_are_selected_by_name(void **state) {
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
            assert_non_null(strstr(err.text, "scalar")); /* the message lists the available sets */
        }
    assert_string_equal(kernels.isa, best);
    assert_false(cpu_kernels_init(&kernels, "mmx", &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_non_null(strstr(err.text, "mmx"));
    assert_non_null(strstr(err.text, best));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_instruction_set_falls_back_to_scalar),
        cmocka_unit_test(instruction_sets_are_selected_by_name),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
