/* SPDX-License-Identifier: Apache-2.0
 *
 * Level of detail: compares images of minified volumes with and without it, in three lightings, and
 * translucent ones in two.
 *
 * Claims: the lowest PSNR of three views is at least 40 dB for each scene and lighting, 45 dB for a
 * translucent one; the median of the scenes is at least 45 dB in each lighting. Two synthetic
 * scenes have lower floors when they are lit, for two reasons: an ellipsoid approximates faces that
 * are all parallel to the axes badly; and in a thick opaque wall the bright front of a coarse cell
 * hides the darker rest.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "conformance/quality.h"

enum { VIEWS = 3 };

/* Real volumes are files of the data folder, which may not exist. */
static const struct {
    const char *source;
    uint32_t size; /* px */
    double floor;  /* of lit images, dB; 0 = 40 */
} scenes[] = {
    { "demo:engine?size=96", 32, 0 },           { "demo:engine?size=192", 24, 39 },
    { "demo:phantom?size=128", 32, 0 },         { "demo:phantom?size=160", 40, 0 },
    { "demo:galaxy?size=128", 32, 0 },          { "demo:vessels?size=128", 40, 0 },
    { "demo:checkerboard?size=128", 32, 35 },   { "engine_256x256x128_uint8.nrrd", 64, 0 },
    { "bonsai_256x256x256_uint8.nrrd", 64, 0 }, { "cthead_256x256x113_uint16.nrrd", 32, 0 },
};
enum { SCENES = sizeof scenes / sizeof *scenes };

/* TWO_LIGHTS: broad highlights, one light fixed in the world, one fixed to the camera. THIN: a
 * tenth of the extinction, so that the cells that are drawn may be larger (splat/detail.h). */
enum lighting { UNLIT, DEFAULT_LIGHT, TWO_LIGHTS, THIN, THIN_LIT, LIGHTINGS };

static bool is_unlit(enum lighting lighting) {
    return lighting == UNLIT || lighting == THIN;
}

static bool is_thin(enum lighting lighting) {
    return lighting >= THIN;
}

static void set_lighting(struct sp_view *view, enum lighting lighting) {
    if (is_thin(lighting))
        view->transfer_function.reference_length *= 10;
    if (is_unlit(lighting))
        view->shading.mode = SP_SHADING_NONE;
    if (lighting != TWO_LIGHTS)
        return;
    view->shading = (struct sp_shading){
        .mode = SP_SHADING_PHONG,
        .ambient = 0.1,
        .diffuse = 0.6,
        .specular = 0.4,
        .exponent = 8,
        .reach = 0.2,
        .light_count = 2,
        .lights = { { { 1, -0.4, 0.3 }, SP_LIGHT_WORLD, { 1, 0.7f, 0.4f } },
                    { { -0.6, 0.8, 0.5 }, SP_LIGHT_CAMERA, { 0.2f, 0.4f, 0.8f } } },
    };
}

/* Returns the lowest PSNR of the views, with against without level of detail. */
static double compare(const struct quality *q, struct sp_volume *volume, uint32_t size,
                      enum lighting lighting) {
    double worst = INFINITY;
    for (int n = 0; n < VIEWS; n++) {
        struct sp_view view;
        sp_view_init(&view, sp_volume_info(volume), "v");
        view.transfer_function.order = SP_TF_PRE;
        view.size[0] = view.size[1] = size;
        set_lighting(&view, lighting);
        quality_turn(&view, n);
        struct test_image by[2];
        for (int lod = 0; lod < 2; lod++) {
            view.level_of_detail = lod ? SP_LOD_AUTO : SP_LOD_OFF;
            by[lod] = quality_render(q, volume, &view);
        }
        worst = fmin(worst, test_image_psnr(&by[0], &by[1]));
        test_image_finish(&by[0]);
        test_image_finish(&by[1]);
    }
    return worst;
}

static void measure(struct quality *q) {
    double psnr[LIGHTINGS][SCENES];
    size_t count = 0;
    printf("  with against without level of detail, dB    px   unlit     lit     two    thin    "
           "both\n");
    for (size_t i = 0; i < SCENES; i++) {
        struct sp_volume *volume = quality_load(scenes[i].source);
        if (!volume)
            continue;
        printf("  %-42s %4u", scenes[i].source, scenes[i].size);
        for (int l = 0; l < LIGHTINGS; l++) {
            double db = compare(q, volume, scenes[i].size, (enum lighting)l);
            printf("  %6.1f", db);
            double floor = is_thin((enum lighting)l)           ? 45
                           : l != UNLIT && scenes[i].floor > 0 ? scenes[i].floor
                                                               : 40;
            quality_expect(q, db >= floor, "%s, lighting %d: %.1f dB, floor %.0f dB",
                           scenes[i].source, l, db, floor);
            psnr[l][count] = db;
        }
        printf("\n");
        count++;
        quality_evict(q, &volume);
    }
    for (int l = 0; l < LIGHTINGS; l++) {
        double median = quality_median(psnr[l], count);
        quality_expect(q, median >= 45, "lighting %d: the median is %.1f dB, floor 45 dB", l,
                       median);
        quality_expect(q, psnr[l][0] < 120,
                       "lighting %d: level of detail does not change the image of any scene", l);
    }
}

int main(void) {
    return quality_main(measure);
}
