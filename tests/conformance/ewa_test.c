/* SPDX-License-Identifier: Apache-2.0
 *
 * Every scene of the manifest, by every backend and instruction set, against the integral.
 *
 *   test_conformance_ewa [SCENE]      one scene alone
 *
 * What falls below its floor is written as a picture (support/image.h: test_image_dump).
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "manifest.h"
#include "sp/log.h"
#include "support/data.h"
#include "support/render.h"
#include "support/truth.h"

enum { TARGETS_MAX = 16 };

struct run {
    struct test_target targets[TARGETS_MAX];
    struct test_renderer renderers[TARGETS_MAX];
    unsigned count;
    unsigned checks, failed;
};

static void open_all(struct run *run) {
    struct test_target target;
    for (unsigned i = 0; test_target_at(i, &target) && run->count < TARGETS_MAX; i++) {
        struct sp_error err;
        if (test_renderer_open(&run->renderers[run->count], &target, 2, &err))
            run->targets[run->count++] = target;
        else
            printf("skipped: %s/%s: %s\n", target.backend, target.isa, err.text);
    }
}

/* One render against one image of the truth; the PSNR, or NAN when nothing was rendered. */
static double check(struct run *run, unsigned t, const struct test_scene *scene, const char *what,
                    const struct manifest_floor *floor, const struct test_image *truth) {
    struct test_image image;
    struct sp_error err;
    char name[256];
    snprintf(name, sizeof name, "%s-%s-%s-%s", scene->info.name, what, run->targets[t].backend,
             run->targets[t].isa);
    run->checks++;
    if (!test_render_scene(&run->renderers[t], scene, &image, &err)) {
        printf("FAILED %-40s %s: %s\n", name, err.place, err.text);
        run->failed++;
        return NAN;
    }
    double psnr = test_image_psnr(&image, truth);
    bool ok = psnr >= floor->floor;
    struct test_difference d = test_image_difference(&image, truth);
    printf("%-6s %-40s %6.2f dB, floor %.1f, measured %.1f; worst %.4f at (%u,%u) channel %u: "
           "%.4f for %.4f\n",
           ok ? "ok" : "FAILED", name, psnr, floor->floor, floor->measured, d.largest, d.x, d.y,
           d.channel, d.a, d.b);
    if (!ok || getenv("SPLATD_TEST_DUMP"))
        test_image_dump(name, &image, truth, 8);
    run->failed += !ok;
    test_image_finish(&image);
    return psnr;
}

static bool run_scene(struct run *run, const struct manifest_entry *entry) {
    struct test_scene scene;
    struct test_rays rays;
    struct test_image exact, convolved;
    struct sp_error err;
    if (!entry->build(&scene)) {
        printf("FAILED %s: out of memory\n", entry->name);
        return false;
    }
    if (!test_truth_integrate(&scene.info, scene.voxels, &scene.view, NULL, &rays, &err) ||
        !test_truth_image(&rays, 0, scene.view.background, &exact) ||
        !test_truth_image(&rays, 1, scene.view.background, &convolved)) {
        printf("FAILED %s: %s\n", entry->name, err.text);
        return false;
    }
    for (unsigned t = 0; t < run->count; t++) {
        scene.view.filter.mode = SP_FILTER_EWA;
        scene.view.filter.lowpass = 0;
        check(run, t, &scene, "exact", &entry->exact, &exact);
        scene.view.filter.lowpass = 1;
        double ewa = check(run, t, &scene, "lowpass", &entry->lowpass, &convolved);
        scene.view.filter.mode = SP_FILTER_ADAPTIVE;
        double adaptive = check(run, t, &scene, "adaptive", &entry->adaptive, &convolved);
        if (!(adaptive >= fmin(ewa - MANIFEST_ADAPTIVE_LOSS, MANIFEST_ALIKE))) {
            printf("FAILED %s: adaptive %.2f dB, ewa %.2f dB\n", entry->name, adaptive, ewa);
            run->failed++;
        }
        fflush(stdout);
    }
    test_image_finish(&exact);
    test_image_finish(&convolved);
    test_rays_finish(&rays);
    test_scene_finish(&scene);
    return true;
}

int main(int argc, char **argv) {
    struct run run = { .count = 0 };
    sp_log_init(NULL, NULL, SP_LOG_ERROR); /* refusals are printed here as skips */
    open_all(&run);
    if (!run.count) {
        printf("skipped: no backend but null starts here\n");
        return TEST_SKIPPED;
    }
    for (size_t i = 0; i < manifest_count; i++)
        if (argc < 2 || strcmp(argv[1], manifest[i].name) == 0)
            run.failed += !run_scene(&run, &manifest[i]);
    for (unsigned t = 0; t < run.count; t++)
        test_renderer_close(&run.renderers[t]);
    printf("%u of %u checks failed\n", run.failed, run.checks);
    return run.failed || !run.checks;
}
