/* SPDX-License-Identifier: Apache-2.0
 *
 * Renderers of the GPU backend on several threads, like the workers of the daemon: they draw at the
 * same time, are created on one thread and used on another, and end while others draw.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sp/log.h"
#include "sp/renderer.h"
#include "support/gl.h"

enum { SIZE = 40, FRAMES = 4, WORKERS = 3, ROUNDS = 2, SKIPPED = 77 };

static struct sp_renderer *create_renderer(struct sp_error *err) {
    const struct sp_renderer_options options = { .backend = test_gl(), .threads = 1 };
    return sp_renderer_create(&options, err);
}

/* A frame that fails is drawn again with another context: the image is the same, and the log
 * reports the failure. */
static void count_warning(void *user, enum sp_log_level level, const char *kind,
                          const struct sp_log_field *fields, const char *line) {
    (void)kind;
    (void)fields;
    (void)level;
    atomic_fetch_add((atomic_uint *)user, 1);
    fprintf(stderr, "%s\n", line);
}

struct images {
    unsigned char pixels[FRAMES][SIZE][SIZE][4];
};

/* Draws some views of the volume. Runs on several threads, so it asserts nothing. */
static bool draw(struct sp_renderer *renderer, struct sp_volume *volume, struct images *out) {
    struct sp_frame_pool *pool = sp_frame_pool_create(0, NULL);
    struct sp_view view;
    sp_view_init(&view, sp_volume_info(volume), "v");
    view.size[0] = view.size[1] = SIZE;
    view.compositing.mode = SP_COMPOSITE_SHEET;
    bool ok = pool != NULL;
    for (int i = 0; ok && i < FRAMES; i++) {
        view.camera.position[i % 3] += 5;
        view.transfer_function.order = i % 2 ? SP_TF_POST : SP_TF_PRE;
        struct sp_frame *frame = sp_renderer_render(renderer, volume, &view, pool, NULL, NULL);
        ok = frame != NULL;
        for (int y = 0; ok && y < SIZE; y++)
            memcpy(out->pixels[i][y], (char *)frame->pixels + frame->stride_bytes * y, 4 * SIZE);
        sp_frame_unref(&frame);
    }
    sp_frame_pool_destroy(&pool);
    return ok;
}

struct worker {
    struct sp_volume *volume;
    struct sp_renderer *first; /* created on the main thread, the other renderers here */
    const struct images *wanted;
    unsigned right;
    pthread_t thread;
};

static void *run_worker(void *user) {
    struct worker *worker = user;
    struct images *got = malloc(sizeof *got);
    for (int i = 0; got && i < ROUNDS; i++) {
        if (!worker->first)
            worker->first = create_renderer(NULL);
        if (worker->first && draw(worker->first, worker->volume, got))
            worker->right += memcmp(got, worker->wanted, sizeof *got) == 0;
        sp_renderer_destroy(&worker->first);
    }
    free(got);
    return NULL;
}

static void threads_draw_the_same_images_as_one_thread(void **state) {
    atomic_uint *warnings = *state;
    static const char *const sources[WORKERS] = { "demo:phantom?size=16", "demo:vessels?size=20",
                                                  "demo:phantom?size=16" };
    static struct images wanted[WORKERS];
    struct worker workers[WORKERS] = { { 0 } };
    for (int i = 0; i < WORKERS; i++) {
        workers[i].volume = sp_volume_load(sources[i], NULL, NULL);
        workers[i].first = create_renderer(NULL);
        workers[i].wanted = &wanted[i];
        assert_non_null(workers[i].first);
        assert_true(draw(workers[i].first, workers[i].volume, &wanted[i]));
    }
    assert_memory_equal(&wanted[0], &wanted[2], sizeof wanted[0]);
    assert_memory_not_equal(&wanted[0], &wanted[1], sizeof wanted[0]);
    assert_memory_not_equal(wanted[0].pixels[0], wanted[0].pixels[1], sizeof wanted[0].pixels[0]);
    for (int i = 0; i < WORKERS; i++)
        assert_int_equal(pthread_create(&workers[i].thread, NULL, run_worker, &workers[i]), 0);
    for (int i = 0; i < WORKERS; i++)
        assert_int_equal(pthread_join(workers[i].thread, NULL), 0);
    for (int i = 0; i < WORKERS; i++) {
        assert_int_equal(workers[i].right, ROUNDS);
        sp_volume_unref(&workers[i].volume);
    }
    assert_int_equal(atomic_load(warnings), 0);
}

int main(void) {
    static atomic_uint warnings;
    const struct CMUnitTest tests[] = { cmocka_unit_test_prestate(
        threads_draw_the_same_images_as_one_thread, &warnings) };
    struct sp_error err;
    sp_log_init(count_warning, &warnings, SP_LOG_WARN);
    struct sp_renderer *renderer = create_renderer(&err);
    if (!renderer) {
        printf("skipped: %s\n", err.text);
        return SKIPPED;
    }
    sp_renderer_destroy(&renderer);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
