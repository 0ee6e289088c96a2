/* SPDX-License-Identifier: Apache-2.0 */
#include "quality.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sp/log.h"
#include "support/data.h"

int quality_main(void (*measure)(struct quality *q)) {
    struct quality q = { .checks = 0 };
    sp_log_init(NULL, NULL, SP_LOG_ERROR); /* refusals are printed here as skips */
    for (unsigned i = 0; test_target_at(i, &q.target); i++) {
        struct sp_error err;
        if (strcmp(q.target.backend, "gl-software") == 0) {
            printf("skipped: gl-software: too slow for these; ewa_test.c holds it to scalar\n");
            continue;
        }
        if (!test_renderer_open(&q.renderer, &q.target, 2, &err)) {
            printf("skipped: %s/%s: %s\n", q.target.backend, q.target.isa, err.text);
            continue;
        }
        printf("%s/%s\n", q.target.backend, q.target.isa);
        measure(&q);
        test_renderer_close(&q.renderer);
    }
    printf("%u of %u claims failed\n", q.failed, q.checks);
    return q.failed ? EXIT_FAILURE : q.checks ? EXIT_SUCCESS : TEST_SKIPPED;
}

void quality_expect(struct quality *q, bool holds, const char *format, ...) {
    q->checks++;
    if (holds)
        return;
    q->failed++;
    va_list arguments;
    va_start(arguments, format);
    printf("FAILED ");
    vprintf(format, arguments);
    printf("\n");
    va_end(arguments);
}

static void stop(const char *what, const struct sp_error *err) {
    printf("FAILED %s: %s: %s\n", what, err->place, err->text);
    exit(EXIT_FAILURE);
}

struct test_image quality_render(const struct quality *q, struct sp_volume *volume,
                                 const struct sp_view *view) {
    struct test_image image;
    struct sp_error err;
    if (!test_render(&q->renderer, volume, view, &image, &err))
        stop(sp_volume_info(volume)->name, &err);
    return image;
}

struct sp_volume *quality_volume(const struct test_scene *scene) {
    struct sp_error err;
    struct sp_volume *volume = test_scene_volume(scene, &err);
    if (!volume)
        stop(scene->info.name, &err);
    return volume;
}

struct sp_volume *quality_load(const char *source) {
    struct sp_load_options options = { .importer = SPLATD_BIN_DIR "/splat-import" };
    struct sp_error err;
    char path[1024];
    if (strncmp(source, "demo:", 5) == 0)
        snprintf(path, sizeof path, "%s", source);
    else if (!test_data_path(SPLATD_DATA_DIR, source, path, sizeof path))
        return NULL;
    struct sp_volume *volume = sp_volume_load(path, &options, &err);
    if (!volume)
        stop(path, &err);
    return volume;
}

void quality_turn(struct sp_view *view, int n) {
    double *p = view->camera.position, *t = view->camera.target, angle = 0.7 * n;
    double x = p[0] - t[0], y = p[1] - t[1], z = p[2] - t[2];
    p[0] = t[0] + x * cos(angle) + y * sin(angle);
    p[1] = t[1] - x * sin(angle) + y * cos(angle);
    p[2] = t[2] + z + 0.2 * n * sqrt(x * x + y * y);
}

static int by_size(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double quality_median(double *found, size_t count) {
    qsort(found, count, sizeof *found, by_size);
    return found[count / 2];
}

void quality_forget(const struct quality *q, struct sp_volume **volume) {
    sp_renderer_forget(q->renderer.renderer, *volume);
    sp_volume_unref(volume);
}

const char *quality_filter_name(enum sp_filter_mode mode) {
    switch (mode) {
    case SP_FILTER_ADAPTIVE:
        return "adaptive";
    case SP_FILTER_EWA:
        return "ewa";
    case SP_FILTER_RECONSTRUCTION:
        return "reconstruction";
    case SP_FILTER_LOWPASS:
        return "lowpass";
    case SP_FILTER_SWAN:
        return "swan";
    case SP_FILTER_NONE:
        return "none";
    }
    return "";
}
