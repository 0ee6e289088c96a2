/* SPDX-License-Identifier: Apache-2.0
 *
 * Shared code of invariant_test.c and geometry_test.c, which render two views and compare the
 * images, on every backend of this machine.
 */
#ifndef CONFORMANCE_INVARIANT_H
#define CONFORMANCE_INVARIANT_H

#include "support/data.h"
#include "support/render.h"

struct invariant_context {
    struct test_target target;
    struct test_renderer renderer; /* two threads */
};

/* Bounds for the comparison of an image of post-convolved sheets with an image of footprints.
 * Measured: 65.0 dB; the sum of optical depths is within 0.31 % of the largest depth. */
#define INVARIANT_POSTCONV_FLOOR 64.5
#define INVARIANT_POSTCONV_DEPTH 4e-3

enum { INVARIANT_MODES = 3 };
extern const enum sp_compositing invariant_modes[INVARIANT_MODES];

/* Sets the filter, the kernel, the compositor and the classification order of a view, so that each
 * `way`, of [0, INVARIANT_WAYS), takes another path through the renderer. INVARIANT_POST_WAY
 * classifies after reconstruction. */
enum { INVARIANT_WAYS = 9, INVARIANT_POST_WAY = 8 };
void invariant_choose_way(struct sp_view *view, int way);

/* Ends the test with a visible skip if the backend does not support the view. */
void invariant_skip_unsupported(struct invariant_context *c, const struct test_scene *scene);

/* Renders the scene; skips as above, fails on any other error. */
struct test_image invariant_render(struct invariant_context *c, const struct test_scene *scene);

/* Fails and writes both images to files if their PSNR is below `floor` [dB]. Frees both images. */
void invariant_assert_same(const char *name, struct test_image *got, struct test_image *wanted,
                           double floor);

/* Calls run() for every target that starts on this machine; prints the others as skipped. run()
 * returns the number of failed tests. Returns the exit status of the test program. */
int invariant_run(int (*run)(struct invariant_context *c));

#endif
