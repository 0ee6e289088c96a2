/* SPDX-License-Identifier: Apache-2.0
 *
 * Rendering in a test: every backend and instruction set by turns, images as doubles.
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

/* The i-th pair of a compiled backend (all but null) and an instruction set by name, whether this
 * machine has it or not; false past the end. The CPU's come first, and of those the reference. With
 * sanitizers only two: the CPU's reference, "scalar", and its best set, "auto". */
bool test_target_at(unsigned i, struct test_target *target);

struct test_renderer {
    struct sp_renderer *renderer;
    struct sp_frame_pool *pool;
};

/* False when the target cannot start on this machine or would run as something else; *err says
 * why. */
bool test_renderer_open(struct test_renderer *r, const struct test_target *target, unsigned threads,
                        struct sp_error *err);
void test_renderer_close(struct test_renderer *r);

/* Renders with RGBAF32 into a new image; false with *err set on failure. */
bool test_render(const struct test_renderer *r, struct sp_volume *volume,
                 const struct sp_view *view, struct test_image *image, struct sp_error *err);

/* The same from a scene, whose volume is made and forgotten. */
bool test_render_scene(const struct test_renderer *r, const struct test_scene *scene,
                       struct test_image *image, struct sp_error *err);

/* Does the target draw this scene's sheets without footprints (postconv/postconv.h)? The scalar
 * reference never does: held to it or to what has footprints, such an image is another
 * algorithm's, whose kernels end where filters do and not at view.filter.cutoff. */
bool test_uses_postconv(const struct test_target *target, const struct test_scene *scene);

/* Do two frames have the same size, format and, within their rows, the same bytes? */
bool test_frames_equal(const struct sp_frame *a, const struct sp_frame *b);

#endif
