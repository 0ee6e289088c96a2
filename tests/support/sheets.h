/* SPDX-License-Identifier: Apache-2.0
 *
 * The CPU backend's sheets without footprints (backend/cpu/sheets.h) on their own: a scene, made
 * ready as the backend does, and any function in place of a kernel that draws its tiles.
 */
#ifndef TESTS_SUPPORT_SHEETS_H
#define TESTS_SUPPORT_SHEETS_H

#include "backend/cpu/sheets.h"
#include "support/scene.h"

typedef void test_tile_fn(const struct sheets *sheets, struct sheets_scratch *scratch,
                          uint32_t tile);

struct test_sheets {
    struct sp_backend_job job; /* the first: what a tile's function gets leads to all of this */
    struct sp_frame *frame;
    struct sp_frame_pool *frames;
    struct sp_pool *pool;
    struct sp_arena arena;
    struct sp_volume *volume;
    struct sp_classification classification;
    struct sp_camera_frame camera;
    struct sp_shade shade;
    struct sp_ewa_frame ewa;
    struct cpu_part parts[SP_LEVELS];
    struct sp_detail detail;
    struct sheets_tables tables;
    unsigned axis;
    uint8_t *modes; /* adaptive; else NULL */
    void *user;     /* the test's */
};

static inline struct test_sheets *test_sheets_of(const struct sheets *sheets) {
    return (struct test_sheets *)(uintptr_t)sheets->job;
}

/* The scene is one that sheets_can() draws, and stays where it is. NULL with *err set on failure.
 */
struct test_sheets *test_sheets_open(const struct test_scene *scene, unsigned threads,
                                     struct sp_error *err);
void test_sheets_close(struct test_sheets *t);

/* Draws into t->frame (RGBAF32). `cancel`: NULL = never. */
bool test_sheets_draw(struct test_sheets *t, test_tile_fn *tile, const atomic_bool *cancel,
                      struct sp_error *err);

#endif
