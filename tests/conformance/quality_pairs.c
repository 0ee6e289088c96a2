/* SPDX-License-Identifier: Apache-2.0
 *
 * Pairs of sheets: the filter adaptive composites sheets in pairs where there are many sheets and
 * voxels are a few pixels wide (draw/postconv/postconv.h). The test compares adaptive with ewa on
 * whole volumes without lighting. It limits the opacity to a value at which pairs are still used.
 *
 * Claims: the lowest PSNR of three views is at least 48 dB (measured: 48.6); the median of the
 * scenes is at least 58 dB (measured: 61).
 */
#include <math.h>
#include <stdio.h>

#include "conformance/quality.h"

enum { VIEWS = 3 };

/* Real volumes are files of the data folder, which may not exist. */
static const char *const scenes[] = {
    "demo:engine?size=96",           "demo:phantom?size=128",
    "demo:galaxy?size=128",          "demo:vessels?size=128",
    "demo:marschner-lobb?size=96",   "engine_256x256x128_uint8.nrrd",
    "bonsai_256x256x256_uint8.nrrd", "cthead_256x256x113_uint16.nrrd",
};
enum { SCENES = sizeof scenes / sizeof *scenes };
static const uint32_t sizes[] = { 192, 384 };
enum { SIZES = sizeof sizes / sizeof *sizes };

/* Returns the lowest PSNR of the views. */
static double compare(const struct quality *q, struct sp_volume *volume, uint32_t size) {
    double worst = INFINITY;
    for (int n = 0; n < VIEWS; n++) {
        struct sp_view view;
        sp_view_init(&view, sp_volume_info(volume), "v");
        view.transfer_function.order = SP_TF_PRE;
        view.size[0] = view.size[1] = size;
        view.shading.mode = SP_SHADING_NONE;
        for (uint32_t i = 0; i < view.transfer_function.point_count; i++)
            if (view.transfer_function.points[i].opacity > 0.6f)
                view.transfer_function.points[i].opacity = 0.6f;
        quality_turn(&view, n);
        struct test_image by[2];
        for (int k = 0; k < 2; k++) {
            view.filter.mode = k ? SP_FILTER_ADAPTIVE : SP_FILTER_EWA;
            by[k] = quality_render(q, volume, &view);
        }
        worst = fmin(worst, test_image_psnr(&by[0], &by[1]));
        test_image_finish(&by[0]);
        test_image_finish(&by[1]);
    }
    return worst;
}

static void measure(struct quality *q) {
    double psnr[SIZES][SCENES];
    size_t count = 0;
    printf("  adaptive against ewa, dB            %5u px  %u px\n", sizes[0], sizes[1]);
    for (size_t i = 0; i < SCENES; i++) {
        struct sp_volume *volume = quality_load(scenes[i]);
        if (!volume)
            continue;
        printf("  %-38s", scenes[i]);
        for (int k = 0; k < SIZES; k++) {
            double db = psnr[k][count] = compare(q, volume, sizes[k]);
            printf("  %6.1f", db);
            quality_expect(q, db >= 48, "%s at %u px: %.1f dB, floor 48 dB", scenes[i], sizes[k],
                           db);
        }
        printf("\n");
        count++;
        quality_evict(q, &volume);
    }
    for (int k = 0; k < SIZES; k++) {
        double median = quality_median(psnr[k], count);
        quality_expect(q, median >= 58, "the median at %u px is %.1f dB, floor 58 dB", sizes[k],
                       median);
    }
}

int main(void) {
    return quality_main(measure);
}
