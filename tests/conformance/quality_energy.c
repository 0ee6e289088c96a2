/* SPDX-License-Identifier: Apache-2.0
 *
 * Filters conserve energy: a filter may spread the absorption of a voxel over the image, but must
 * not change its sum, at any distance.
 *
 * The test measures the sum of the optical depth over the image, Σ -ln(1 - α) [px²], for blobs so
 * thin that compositing is a sum. In perspective, a voxel at u contributes g v |det J| = g v f² |u|
 * / u2³ (mathematics page: Footprint), which falls with the square of the distance. The expected
 * value is the sum over all voxels. The table shows the measured over the expected sum.
 *
 * Claim: this ratio is 1 within 1 %, from four pixels per voxel down to a sixteenth of a pixel per
 * voxel. There is no claim for the reconstruction filter alone: pixel centres miss or hit a kernel
 * smaller than a pixel by chance, which the other filters prevent.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "conformance/quality.h"
#include "support/sample.h"

static const struct {
    const char *name;
    enum sp_filter_mode mode;
    enum sp_kernel kernel;
    bool is_claimed;
} filters[] = {
    { "ewa", SP_FILTER_EWA, SP_KERNEL_GAUSSIAN, true },
    { "adaptive", SP_FILTER_ADAPTIVE, SP_KERNEL_GAUSSIAN, true },
    { "lowpass", SP_FILTER_LOWPASS, SP_KERNEL_GAUSSIAN, true },
    { "swan", SP_FILTER_SWAN, SP_KERNEL_GAUSSIAN, true },
    { "none", SP_FILTER_NONE, SP_KERNEL_GAUSSIAN, true },
    { "ewa cubic", SP_FILTER_EWA, SP_KERNEL_CUBIC, true },
    { "swan cubic", SP_FILTER_SWAN, SP_KERNEL_CUBIC, true },
    { "reconstr.", SP_FILTER_RECONSTRUCTION, SP_KERNEL_GAUSSIAN, false },
};
enum { FILTERS = sizeof filters / sizeof *filters };

static void place(struct test_scene *scene, double scale) {
    const double focal = 800; /* px */
    unsigned size = (unsigned)fmax(40 * scale + 16, 20);
    scene->view.size[0] = scene->view.size[1] = size;
    scene->view.camera.fov_y = 360 / M_PI * atan(0.5 * size / focal);
    test_scene_orbit(scene, NULL, -30, 20, focal / scale);
}

/* Returns the expected sum of depths, Σ g v |det J| over all voxels [px²]. */
static double expected_depth(const struct test_scene *scene) {
    const struct sp_view *view = &scene->view;
    const struct sp_grid *grid = &scene->info.grid;
    double w[3][3], f = test_camera_scale(view), sum = 0;
    test_camera_axes(&view->camera, w);
    uint32_t i[3];
    for (i[2] = 0; i[2] < grid->dims[2]; i[2]++)
        for (i[1] = 0; i[1] < grid->dims[1]; i[1]++)
            for (i[0] = 0; i[0] < grid->dims[0]; i[0]++) {
                double at[3], colour[3], opacity, square = 0, ahead = 0;
                test_sample_place(grid, i, at);
                for (int a = 0; a < 3; a++) {
                    double d = at[a] - view->camera.position[a];
                    square += d * d;
                    ahead += w[2][a] * d;
                }
                double value =
                    test_sample(scene->voxels, scene->info.type, test_sample_index(grid, i));
                test_classify(&view->transfer_function, value, 0, colour, &opacity);
                sum -= log1p(-opacity) * f * f * sqrt(square) / (ahead * ahead * ahead);
            }
    return sum / view->transfer_function.reference_length; /* the volume v of a cell is 1 */
}

static double summed_depth(const struct test_image *image) {
    double sum = 0;
    for (size_t p = 0; p < (size_t)image->width * image->height; p++)
        sum -= log1p(-image->rgba[p * 4 + 3]);
    return sum;
}

static void measure(struct quality *q) {
    struct test_scene scene;
    if (!test_scene_blobs(&scene))
        exit(EXIT_FAILURE);
    struct sp_transfer_function *tf = &scene.view.transfer_function;
    for (uint32_t i = 0; i < tf->point_count; i++)
        tf->points[i].opacity *= 0.003F;
    struct sp_volume *volume = quality_volume(&scene);
    printf("  measured over expected sum of depths\n  px/vox");
    for (int k = 0; k < FILTERS; k++)
        printf("  %10s", filters[k].name);
    printf("\n");
    for (double scale = 4; scale >= 0.0625; scale /= 2) {
        place(&scene, scale);
        double expected = expected_depth(&scene);
        printf("  %6.4f", scale);
        for (int k = 0; k < FILTERS; k++) {
            scene.view.filter.mode = filters[k].mode;
            scene.view.filter.kernel = filters[k].kernel;
            struct test_image image = quality_render(q, volume, &scene.view);
            double ratio = summed_depth(&image) / expected;
            printf("  %10.5f", ratio);
            test_image_finish(&image);
            if (filters[k].is_claimed)
                quality_expect(q, fabs(ratio - 1) < 0.01,
                               "%s at %.4f px per voxel: measured over expected depth is %.5f",
                               filters[k].name, scale, ratio);
        }
        printf("\n");
    }
    quality_evict(q, &volume);
    test_scene_finish(&scene);
}

int main(void) {
    return quality_main(measure);
}
