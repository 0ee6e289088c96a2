/* SPDX-License-Identifier: Apache-2.0
 *
 * Compares every row of every scene of the manifest, drawn by every backend and instruction set,
 * with the integral (support/truth.h).
 *
 *   test_conformance_ewa [SCENE]      SCENE: only this scene
 *
 * An image below its floor is written to a file (support/image.h: test_image_dump).
 */
#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "conformance/manifest.h"
#include "sp/log.h"
#include "support/data.h"
#include "support/render.h"
#include "support/truth.h"

enum { TARGETS_MAX = 16, LOWPASSES_MAX = 8, ROWS_MAX = 64, GL_STEP = 16 };

struct run {
    struct test_target targets[TARGETS_MAX];
    struct test_renderer renderers[TARGETS_MAX];
    unsigned count;
    bool is_single; /* only one scene was requested */
    unsigned checks, failed, skipped;
};

/* The integral of a scene, convolved with each low-pass filter that the rows use. */
struct truth {
    double lowpass[LOWPASSES_MAX];
    struct test_image image[LOWPASSES_MAX];
    int count;
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

static void choose(struct sp_view *view, const struct manifest_row *row,
                   const struct sp_view *own) {
    view->filter.mode = row->filter;
    view->filter.lowpass = row->lowpass;
    view->filter.cutoff = row->cutoff > 0 ? row->cutoff : own->filter.cutoff;
    view->compositing.mode = row->compositing;
    view->compositing.slab = row->slab > 0 ? row->slab : 1;
    view->compositing.attenuation = row->attenuation;
}

static void name_row(const struct manifest_row *row, char *name, size_t size) {
    static const char *const filters[] = { "adaptive", "ewa",  "reconstruction",
                                           "lowpass",  "swan", "none" };
    static const char *const compositings[] = { "splat", "sheet", "slab" };
    char slab[32] = "", cutoff[32] = "";
    if (row->slab > 0)
        snprintf(slab, sizeof slab, "-%g", row->slab);
    if (row->cutoff > 0)
        snprintf(cutoff, sizeof cutoff, "-cutoff-%g", row->cutoff);
    snprintf(name, size, "%s-%g-%s%s%s%s", filters[row->filter], row->lowpass,
             compositings[row->compositing], slab, cutoff,
             row->attenuation == SP_ATTENUATION_LINEAR ? "-linear" : "");
}

/* Images of one row that the images of later targets are compared with. rgba is NULL until the
 * image is rendered. */
struct references {
    struct test_image scalar; /* by the scalar CPU reference */
    struct test_image simd;   /* by the first other instruction set of the CPU */
};

/* Compares the images of two instruction sets of the CPU. */
static void check_isa(struct run *run, const char *name, const char *other, double floor,
                      const struct test_image *image, const struct test_image *reference) {
    if (!reference->rgba)
        return;
    double psnr = test_image_psnr(image, reference);
    run->checks++;
    if (psnr >= floor)
        return;
    struct test_difference d = test_image_difference(image, reference);
    printf("FAILED %-50s %6.2f dB against %s, floor %.1f; largest difference %.4f at (%u,%u) "
           "channel %u: %.4f, expected %.4f\n",
           name, psnr, other, floor, d.largest, d.x, d.y, d.channel, d.a, d.b);
    test_image_dump(name, image, reference, 8);
    run->failed++;
}

/* Compares the image with the reference images of other instruction sets. If it is the first scalar
 * or the first SIMD image, moves it to `to` as a reference and returns true. */
static bool check_isas(struct run *run, unsigned t, const char *name,
                       const struct manifest_row *row, const struct test_image *image,
                       struct references *to) {
    bool is_scalar = strcmp(run->targets[t].isa, "scalar") == 0;
    if (!is_scalar) {
        check_isa(run, name, "scalar", row->isa_floor > 0 ? row->isa_floor : MANIFEST_ISA_FLOOR,
                  image, &to->scalar);
        check_isa(run, name, "the first SIMD instruction set", MANIFEST_ISA_FLOOR, image,
                  &to->simd);
    }
    struct test_image *reference = is_scalar ? &to->scalar : &to->simd;
    if (reference->rgba)
        return false;
    *reference = *image;
    return true;
}

static bool is_cpu(const struct run *run, unsigned t) {
    return strcmp(run->targets[t].backend, "cpu") == 0;
}

/* Checks the PSNR of another backend against the scalar CPU reference. */
static void check_backend(struct run *run, const char *name, double scalar_psnr) {
    run->checks++;
    if (scalar_psnr >= MANIFEST_BACKEND_FLOOR)
        return;
    printf("FAILED %-50s %6.2f dB against scalar, floor %.1f\n", name, scalar_psnr,
           MANIFEST_BACKEND_FLOOR);
    run->failed++;
}

/* True if the backend does not support the view; prints and counts the skip. */
static bool is_unsupported(struct run *run, unsigned t, const struct test_scene *scene,
                           const char *name) {
    struct sp_error err;
    if (sp_renderer_supports(run->renderers[t].renderer, &scene->view, &err) ||
        err.code != SP_ERR_UNSUPPORTED)
        return false;
    printf("skipped: %s: %s: %s\n", name, err.place, err.text);
    run->skipped++;
    return true;
}

/* Compares one image with the truth and with the scalar CPU reference, which is rendered first.
 * Returns the PSNR against the truth, or NAN if nothing was rendered. */
static double check(struct run *run, unsigned t, const struct test_scene *scene,
                    const struct manifest_row *row, const struct test_image *truth,
                    struct references *references) {
    struct test_image image;
    struct sp_error err;
    char choice[128], name[400];
    name_row(row, choice, sizeof choice);
    snprintf(name, sizeof name, "%s-%s-%s-%s", scene->info.name, choice, run->targets[t].backend,
             run->targets[t].isa);
    if (is_unsupported(run, t, scene, name))
        return NAN;
    run->checks++;
    if (!test_render_scene(&run->renderers[t], scene, &image, &err)) {
        printf("FAILED %-50s %s: %s\n", name, err.place, err.text);
        run->failed++;
        return NAN;
    }
    double psnr = test_image_psnr(&image, truth), scalar_psnr = INFINITY;
    bool ok = psnr >= row->floor;
    if (references->scalar.rgba)
        scalar_psnr = test_image_psnr(&image, &references->scalar);
    struct test_difference d = test_image_difference(&image, truth);
    printf("%-6s %-50s %6.2f dB, floor %.1f, recorded %.2f, %.2f against scalar; largest "
           "difference %.4f at (%u,%u) channel %u: %.4f, expected %.4f\n",
           ok ? "ok" : "FAILED", name, psnr, row->floor, row->measured, scalar_psnr, d.largest, d.x,
           d.y, d.channel, d.a, d.b);
    if (!ok || getenv("SPLATD_TEST_DUMP"))
        test_image_dump(name, &image, truth, 8);
    run->failed += !ok;
    if (!is_cpu(run, t) && references->scalar.rgba)
        check_backend(run, name, scalar_psnr);
    if (!is_cpu(run, t) || !check_isas(run, t, name, row, &image, references))
        test_image_finish(&image);
    return psnr;
}

/* Compares the PSNR of each adaptive row with the PSNR of the ewa row whose other settings are
 * equal. */
static void compare_adaptive(struct run *run, const struct manifest_scene *entry,
                             const double *psnr) {
    for (size_t i = 0; i < entry->count; i++)
        for (size_t j = 0; j < entry->count; j++) {
            struct manifest_row a = entry->rows[i], b = entry->rows[j];
            if (a.filter != SP_FILTER_ADAPTIVE || b.filter != SP_FILTER_EWA ||
                a.lowpass != b.lowpass || a.compositing != b.compositing || a.slab != b.slab ||
                a.cutoff != b.cutoff || a.attenuation != b.attenuation || isnan(psnr[i]) ||
                isnan(psnr[j]))
                continue;
            if (psnr[i] >= fmin(psnr[j] - MANIFEST_ADAPTIVE_LOSS, MANIFEST_ADAPTIVE_ENOUGH))
                continue;
            printf("FAILED %s: adaptive has %.2f dB, ewa has %.2f dB\n", entry->name, psnr[i],
                   psnr[j]);
            run->failed++;
        }
}

static bool compute_truth(const struct test_scene *scene, const struct manifest_scene *entry,
                          struct truth *truth, struct sp_error *err) {
    struct test_rays rays;
    *truth = (struct truth){ .count = 0 };
    if (!test_truth_integrate(&scene->info, scene->voxels, &scene->view, NULL, &rays, err))
        return false;
    bool ok = true;
    for (size_t i = 0; i < entry->count && ok; i++) {
        double h = entry->rows[i].lowpass;
        int k = 0;
        while (k < truth->count && truth->lowpass[k] != h)
            k++;
        if (k < truth->count)
            continue;
        assert(k < LOWPASSES_MAX);
        truth->lowpass[truth->count++] = h;
        ok = test_truth_image(&rays, h, scene->view.background, &truth->image[k]) ||
             sp_fail(err, SP_ERR_MEMORY, "", "the convolved integral");
    }
    test_rays_finish(&rays);
    return ok;
}

/* Software GL takes most of the time. It draws every sixteenth row of a scene, starting at another
 * row in each scene, unless only one scene was requested. */
static bool is_drawn(const struct run *run, unsigned t, const struct manifest_scene *entry,
                     size_t row) {
    return run->is_single || strcmp(run->targets[t].backend, "gl-software") != 0 ||
           (row + (size_t)(entry - manifest)) % GL_STEP == 0;
}

static bool run_scene(struct run *run, const struct manifest_scene *entry) {
    struct test_scene scene;
    struct truth truth;
    struct sp_error err = { .text = "out of memory" };
    bool ok = entry->build(&scene) && compute_truth(&scene, entry, &truth, &err);
    if (!ok) {
        printf("FAILED %s: %s\n", entry->name, err.text);
        return false;
    }
    const struct sp_view own = scene.view;
    assert(entry->count <= ROWS_MAX);
    double psnr[TARGETS_MAX][ROWS_MAX];
    for (size_t i = 0; i < entry->count; i++) {
        struct references references = { 0 };
        int k = 0;
        while (truth.lowpass[k] != entry->rows[i].lowpass)
            k++;
        choose(&scene.view, &entry->rows[i], &own);
        for (unsigned t = 0; t < run->count; t++)
            psnr[t][i] = is_drawn(run, t, entry, i)
                             ? check(run, t, &scene, &entry->rows[i], &truth.image[k], &references)
                             : NAN;
        if (references.scalar.rgba)
            test_image_finish(&references.scalar);
        if (references.simd.rgba)
            test_image_finish(&references.simd);
    }
    for (unsigned t = 0; t < run->count; t++)
        compare_adaptive(run, entry, psnr[t]);
    fflush(stdout);
    for (int k = 0; k < truth.count; k++)
        test_image_finish(&truth.image[k]);
    test_scene_finish(&scene);
    return true;
}

int main(int argc, char **argv) {
    struct run run = { .is_single = argc > 1 };
    sp_log_init(NULL, NULL, SP_LOG_ERROR); /* refusals are printed here as skips */
    open_all(&run);
    if (!run.count) {
        printf("skipped: no backend except null starts on this machine\n");
        return TEST_SKIPPED;
    }
    if (!run.is_single)
        printf("reduced: gl-software draws one of every %d rows of each scene\n", GL_STEP);
    for (size_t i = 0; i < manifest_count; i++)
        if (argc < 2 || strcmp(argv[1], manifest[i].name) == 0)
            run.failed += !run_scene(&run, &manifest[i]);
    for (unsigned t = 0; t < run.count; t++)
        test_renderer_close(&run.renderers[t]);
    printf("%u of %u checks failed, %u images skipped\n", run.failed, run.checks, run.skipped);
    return run.failed || !run.checks;
}
