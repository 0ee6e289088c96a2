/* SPDX-License-Identifier: Apache-2.0
 *
 * Slabs converge to the integral: with thinner slabs and larger cutoffs, the image comes closer to
 * the brute-force integral. In perspective, the affine approximation of the projection limits the
 * PSNR; in orthographic projection, only single precision does.
 *
 * The images use the filter ewa without a low-pass filter. The integral is taken along the rays
 * through the pixel centres.
 *
 * Claims: the PSNR rises with the cutoff and with thinner slabs, or has reached its limit; the
 * thinnest slabs are better than sheets. In orthographic projection with a cutoff of five standard
 * deviations, half the thickness gains at least 10 dB: the error within a slab is of second order,
 * which gives 12 dB.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "conformance/quality.h"

static const double slabs[] = { 4, 2, 1, 0.5, 0.25 }, cutoffs[] = { 2, 3, 4, 5 };
enum { SLABS = sizeof slabs / sizeof *slabs, CUTOFFS = sizeof cutoffs / sizeof *cutoffs };

struct table {
    double sheet[CUTOFFS], slab[CUTOFFS][SLABS]; /* dB */
};

static double compare(const struct quality *q, struct sp_volume *volume, const struct sp_view *view,
                      const struct test_image *truth) {
    struct test_image image = quality_render(q, volume, view);
    double psnr = test_image_psnr(&image, truth);
    test_image_finish(&image);
    return psnr;
}

static struct table fill(struct quality *q, struct test_scene *scene) {
    const struct test_truth_options options = { .samples = 1, .step = 0.2, .radius = 6 };
    struct sp_volume *volume = quality_volume(scene);
    struct sp_view *view = &scene->view;
    struct table table;
    view->filter.lowpass = 0;
    const struct test_image *truth = quality_integrate(q, scene, &options);
    printf("  %-12s  sheet  slab of %g      %g      %g    %g   %g\n", scene->info.name, slabs[0],
           slabs[1], slabs[2], slabs[3], slabs[4]);
    for (int c = 0; c < CUTOFFS; c++) {
        view->filter.cutoff = cutoffs[c];
        view->compositing.mode = SP_COMPOSITE_SHEET;
        table.sheet[c] = compare(q, volume, view, truth);
        printf("  cutoff %g     %6.2f  ", cutoffs[c], table.sheet[c]);
        view->compositing.mode = SP_COMPOSITE_SLAB;
        for (int s = 0; s < SLABS; s++) {
            view->compositing.slab = slabs[s];
            table.slab[c][s] = compare(q, volume, view, truth);
            printf(" %6.2f", table.slab[c][s]);
        }
        printf("\n");
    }
    quality_evict(q, &volume);
    return table;
}

/* At its limit, the PSNR may fall by this much from one step to the next [dB]. */
#define LIMIT_TOLERANCE_DB 0.1

static void expect_rising_psnr(struct quality *q, const struct test_scene *scene,
                               const struct table *t) {
    const char *name = scene->info.name;
    for (int c = 0; c < CUTOFFS; c++)
        for (int s = 0; s < SLABS; s++) {
            double got = t->slab[c][s];
            if (s)
                quality_expect(q, got > t->slab[c][s - 1] - LIMIT_TOLERANCE_DB,
                               "%s, cutoff %g: slab %g has %.2f dB, slab %g has %.2f dB", name,
                               cutoffs[c], slabs[s], got, slabs[s - 1], t->slab[c][s - 1]);
            if (c)
                quality_expect(q, got > t->slab[c - 1][s] - LIMIT_TOLERANCE_DB,
                               "%s, slab %g: cutoff %g has %.2f dB, cutoff %g has %.2f dB", name,
                               slabs[s], cutoffs[c], got, cutoffs[c - 1], t->slab[c - 1][s]);
        }
    for (int c = 0; c < CUTOFFS; c++)
        quality_expect(q, t->slab[c][SLABS - 1] > t->sheet[c],
                       "%s, cutoff %g: slab %g has %.2f dB, sheets have %.2f dB", name, cutoffs[c],
                       slabs[SLABS - 1], t->slab[c][SLABS - 1], t->sheet[c]);
}

/* A GPU computes exp2 to about two units in the last place: nothing but rounding is left here [dB].
 */
#define GPU_ROUNDING_DB 105.0

static void expect_second_order(struct quality *q, const struct table *t) {
    const double *row = t->slab[CUTOFFS - 1];
    bool is_gpu = strcmp(q->target.backend, "cpu") != 0;
    for (int s = 1; s < SLABS; s++)
        quality_expect(q, row[s] > row[s - 1] + 10 || (is_gpu && row[s] > GPU_ROUNDING_DB),
                       "slab %g has %.2f dB, slab %g has %.2f dB; expected a gain of 10 dB",
                       slabs[s], row[s], slabs[s - 1], row[s - 1]);
}

static void measure(struct quality *q) {
    static test_scene_fn *const scenes[] = { test_scene_blobs, test_scene_layers,
                                             test_scene_orthographic };
    for (size_t i = 0; i < sizeof scenes / sizeof *scenes; i++) {
        struct test_scene scene;
        if (!scenes[i](&scene))
            exit(EXIT_FAILURE);
        struct table t = fill(q, &scene);
        expect_rising_psnr(q, &scene, &t);
        if (scene.view.camera.projection == SP_ORTHOGRAPHIC)
            expect_second_order(q, &t);
        test_scene_finish(&scene);
    }
}

int main(void) {
    return quality_main(measure);
}
