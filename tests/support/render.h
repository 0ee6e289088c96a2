/* SPDX-License-Identifier: Apache-2.0
 *
 * Rendering in tests: enumerates the backends and instruction sets, and renders to images of
 * doubles.
 */
#ifndef TESTS_SUPPORT_RENDER_H
#define TESTS_SUPPORT_RENDER_H

#include <stdbool.h>

#include "sp/renderer.h"
#include "support/image.h"
#include "support/scene.h"

struct test_target {
    const char *backend;
    const char *isa; /* "auto" for backends without instruction sets */
};

/* Sets the i-th target: a compiled backend (except null) and the name of an instruction set, which
 * this machine may lack. False past the end. The CPU backend comes first, beginning with its
 * reference "scalar". With sanitizers there are only two targets: "scalar" and the best instruction
 * set of the CPU, "auto". */
bool test_target_at(unsigned i, struct test_target *target);

struct test_renderer {
    struct sp_renderer *renderer;
    struct sp_frame_pool *pool;
};

/* False with *err set if the target cannot start on this machine or would run with another
 * instruction set. */
bool test_renderer_open(struct test_renderer *r, const struct test_target *target, unsigned threads,
                        struct sp_error *err);
void test_renderer_close(struct test_renderer *r);

/* Returns the number of failures that check() reports. */
typedef unsigned test_target_check_fn(const struct test_target *target,
                                      const struct test_renderer *renderer);
/* Calls check() with a renderer for each target that starts on this machine, and prints the others
 * as skipped. Returns the sum of the failures. */
unsigned test_check_targets(unsigned threads, test_target_check_fn *check);

/* Renders with RGBAF32 into a new image; false with *err set on failure. */
bool test_render(const struct test_renderer *r, struct sp_volume *volume,
                 const struct sp_view *view, struct test_image *image, struct sp_error *err);

/* The same for a scene. Creates its volume and releases it. */
bool test_render_scene(const struct test_renderer *r, const struct test_scene *scene,
                       struct test_image *image, struct sp_error *err);

/* True if the target draws this scene as post-convolved sheets (draw/postconv/postconv.h). The
 * scalar reference always draws footprints. The kernels of post-convolved sheets do not end at
 * view.filter.cutoff, so such images differ from images of footprints. */
bool test_uses_postconv(const struct test_target *target, const struct test_scene *scene);

/* True if two frames have the same size, the same format and, within their rows, the same bytes. */
bool test_frames_equal(const struct sp_frame *a, const struct sp_frame *b);

#endif
