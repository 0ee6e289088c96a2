/* SPDX-License-Identifier: Apache-2.0 */
#include "conformance/invariant.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "sp/log.h"
#include "support/compare.h"

void invariant_skip_unsupported(struct invariant_context *c, const struct test_scene *scene) {
    struct sp_error err;
    if (sp_renderer_supports(c->renderer.renderer, &scene->view, &err) ||
        err.code != SP_ERR_UNSUPPORTED)
        return;
    print_message("  skipped the rest of this test: %s: %s\n", err.place, err.text);
    skip();
}

struct test_image invariant_render(struct invariant_context *c, const struct test_scene *scene) {
    struct test_image image;
    struct sp_error err;
    invariant_skip_unsupported(c, scene);
    if (!test_render_scene(&c->renderer, scene, &image, &err))
        fail_msg("%s: %s: %s", scene->info.name, err.place, err.text);
    return image;
}

void invariant_assert_same(const char *name, struct test_image *got, struct test_image *wanted,
                           double floor) {
    double psnr = test_image_psnr(got, wanted), mean, variance;
    test_image_statistics(wanted, 3, &mean, &variance);
    print_message("  %s: %.1f dB\n", name, psnr);
    if (!(psnr >= floor)) {
        struct test_difference d = test_image_difference(got, wanted);
        test_image_dump(name, got, wanted, 20);
        fail_msg("%s: %.1f dB, floor %.1f; largest difference at (%u,%u) channel %u: %g, expected "
                 "%g",
                 name, psnr, floor, d.x, d.y, d.channel, d.a, d.b);
    }
    assert_compare(mean, >, 0.01); /* two empty images would be equal as well */
    test_image_finish(got);
    test_image_finish(wanted);
}

const enum sp_compositing invariant_modes[INVARIANT_MODES] = { SP_COMPOSITE_SHEET,
                                                               SP_COMPOSITE_SLAB,
                                                               SP_COMPOSITE_SPLAT };

void invariant_choose_way(struct sp_view *view, int way) {
    static const enum sp_filter_mode filters[INVARIANT_WAYS] = {
        SP_FILTER_EWA,  SP_FILTER_ADAPTIVE, SP_FILTER_EWA,     SP_FILTER_ADAPTIVE,
        SP_FILTER_SWAN, SP_FILTER_NONE,     SP_FILTER_LOWPASS, SP_FILTER_EWA
    };
    static const enum sp_compositing compositors[INVARIANT_WAYS] = {
        SP_COMPOSITE_SHEET, SP_COMPOSITE_SHEET, SP_COMPOSITE_SLAB,
        SP_COMPOSITE_SLAB,  SP_COMPOSITE_SPLAT, SP_COMPOSITE_SLAB,
        SP_COMPOSITE_SPLAT, SP_COMPOSITE_SLAB,  SP_COMPOSITE_SLAB
    };
    view->filter.mode = filters[way];
    view->transfer_function.order = way == INVARIANT_POST_WAY ? SP_TF_POST : SP_TF_PRE;
    view->filter.kernel = way == 6 || way == 7 ? SP_KERNEL_CUBIC : SP_KERNEL_GAUSSIAN;
    view->compositing.mode = compositors[way];
    view->compositing.slab = way == 3 ? 0.3 : 1.2;
    view->compositing.attenuation = way & 1 ? SP_ATTENUATION_LINEAR : SP_ATTENUATION_EXPONENTIAL;
}

/* The kernels tests hold each instruction set to the scalar reference. So two of them stand for
 * all: the reference and the best set. True if `target` is another set; names the best set "auto".
 */
static bool is_left_out(struct test_target *target, bool *has_best) {
    if (strcmp(target->backend, "cpu") != 0 || strcmp(target->isa, "scalar") == 0)
        return false;
    bool left_out = *has_best;
    target->isa = "auto";
    *has_best = true;
    return left_out;
}

int invariant_run(int (*run)(struct invariant_context *c)) {
    struct invariant_context c = { 0 };
    int failed = 0;
    unsigned ran = 0;
    bool has_best = false;
    sp_log_init(NULL, NULL, SP_LOG_ERROR); /* refusals are printed here as skips */
    for (unsigned i = 0; test_target_at(i, &c.target); i++) {
        struct sp_error err;
        if (is_left_out(&c.target, &has_best)) {
            printf("reduced: cpu/auto and cpu/scalar stand for another instruction set\n");
            continue;
        }
        if (!test_renderer_open(&c.renderer, &c.target, 2, &err)) {
            printf("skipped: %s/%s: %s\n", c.target.backend, c.target.isa, err.text);
            continue;
        }
        ran++;
        print_message("%s/%s\n", c.target.backend, c.target.isa);
        failed += run(&c);
        test_renderer_close(&c.renderer);
    }
    return failed ? 1 : ran ? 0 : TEST_SKIPPED;
}
