/* SPDX-License-Identifier: Apache-2.0 */
#include "conformance/quality.h"

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
        /* ewa_test.c compares the instruction sets of the CPU with each other; the best one is
         * enough here. */
        if (strcmp(q.target.backend, "cpu") == 0 && i > 0)
            continue;
        if (i == 0)
            q.target.isa = "auto";
        if (strcmp(q.target.backend, "gl-software") == 0) {
            printf("skipped: gl-software: too slow; ewa_test.c compares it with scalar\n");
            continue;
        }
        if (!test_renderer_open(&q.renderer, &q.target, 2, &err)) {
            printf("skipped: %s/%s: %s\n", q.target.backend, q.target.isa, err.text);
            continue;
        }
        printf("%s/%s\n", q.target.backend, q.target.isa);
        q.truth_next = 0;
        measure(&q);
        test_renderer_close(&q.renderer);
    }
    for (unsigned i = 0; i < q.truth_count; i++)
        test_image_finish(&q.truths[i].image);
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

static bool is_same_camera(const struct sp_camera *a, const struct sp_camera *b) {
    bool is_same = a->fov_y == b->fov_y && a->projection == b->projection;
    for (int i = 0; i < 3; i++)
        is_same = is_same && a->position[i] == b->position[i] && a->target[i] == b->target[i];
    return is_same;
}

static bool is_same_task(const struct quality_truth *truth, const struct test_scene *scene) {
    return strcmp(truth->scene, scene->info.name) == 0 &&
           truth->image.width == scene->view.size[0] &&
           truth->image.height == scene->view.size[1] &&
           truth->lowpass == scene->view.filter.lowpass &&
           is_same_camera(&truth->camera, &scene->view.camera);
}

static void integrate(struct quality_truth *truth, const struct test_scene *scene,
                      const struct test_truth_options *options) {
    struct test_rays rays;
    struct sp_error err = { .text = "out of memory" };
    snprintf(truth->scene, sizeof truth->scene, "%s", scene->info.name);
    truth->camera = scene->view.camera;
    truth->lowpass = scene->view.filter.lowpass;
    if (!test_truth_integrate(&scene->info, scene->voxels, &scene->view, options, &rays, &err) ||
        !test_truth_image(&rays, truth->lowpass, scene->view.background, &truth->image))
        stop(truth->scene, &err);
    test_rays_finish(&rays);
}

const struct test_image *quality_integrate(struct quality *q, const struct test_scene *scene,
                                           const struct test_truth_options *options) {
    const struct sp_error other = { .text = "the first target requested another integral here" };
    const struct sp_error full = { .text = "more integrals than QUALITY_TRUTHS" };
    struct quality_truth *truth = &q->truths[q->truth_next++];
    if (q->truth_next > QUALITY_TRUTHS)
        stop(scene->info.name, &full);
    if (q->truth_next > q->truth_count) {
        integrate(truth, scene, options);
        q->truth_count = q->truth_next;
    }
    if (!is_same_task(truth, scene))
        stop(truth->scene, &other);
    return &truth->image;
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

double quality_median(double *values, size_t count) {
    qsort(values, count, sizeof *values, by_size);
    return values[count / 2];
}

void quality_evict(const struct quality *q, struct sp_volume **volume) {
    sp_renderer_evict(q->renderer.renderer, *volume);
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
