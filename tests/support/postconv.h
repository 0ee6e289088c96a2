/* SPDX-License-Identifier: Apache-2.0
 *
 * Runs only the stage postconv (draw/postconv/postconv.h) on a scene, prepared as in the CPU
 * backend. Any function can replace the kernel that draws the tiles.
 */
#ifndef TESTS_SUPPORT_POSTCONV_H
#define TESTS_SUPPORT_POSTCONV_H

#include "draw/postconv/postconv.h"
#include "support/scene.h"

struct test_postconv {
    struct sp_postconv_tables tables; /* first, so that test_postconv_of() can cast its address */
    const struct sp_view *view;
    struct sp_frame *target; /* test_postconv_draw() draws into it; initially `frame` */
    struct sp_frame *frame;
    struct sp_frame_pool *frames;
    struct sp_pool *pool;
    struct sp_arena arena;
    struct sp_volume *volume;
    struct sp_classification classification;
    struct sp_camera_transform camera;
    struct sp_shade shade;
    struct sp_ewa_frame ewa;
    struct sp_level_frame parts[SP_LEVELS];
    struct sp_detail detail;
    unsigned axis;
    uint8_t *modes; /* filter modes for filter adaptive; otherwise NULL */
    void *user;     /* for the test */
};

static inline struct test_postconv *test_postconv_of(const struct sp_postconv *postconv) {
    return (struct test_postconv *)(uintptr_t)postconv->tables;
}

/* Prepares a scene that sp_postconv_can_draw() accepts; the scene must outlive the result. NULL
 * with *err set on failure. */
struct test_postconv *test_postconv_open(const struct test_scene *scene, unsigned threads,
                                         struct sp_error *err);
void test_postconv_close(struct test_postconv *t);

/* Draws into t->target. `cancel`: NULL = never cancelled. */
bool test_postconv_draw(struct test_postconv *t, sp_postconv_tile_fn *tile,
                        const atomic_bool *cancel, struct sp_error *err);

#endif
