/* SPDX-License-Identifier: Apache-2.0
 *
 * Popping: on an orbit through 45 degrees, the sheets switch from one axis of the volume to
 * another, and the image jumps. Slabs always face the camera and do not switch.
 *
 * The test measures the root mean square change between successive frames of an orbit with small
 * steps. The median is the change by the motion alone. The pop is the largest change minus the
 * median.
 *
 * Claims: the largest change of slabs is at most a tenth of the largest change of sheets, and the
 * pop of slabs is at most a tenth of the pop of sheets. The first claim depends on the step,
 * because motion changes slabs and sheets alike; the step is so small that the change by motion is
 * small. The second claim does not depend on the step.
 *
 * The default view interpolates values on slices. Near a switch the images of both axes are mixed.
 * Claims: beyond the change by motion, the image changes by at most 0.1 % of the range (root mean
 * square), and no pixel by more than 1 %.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "conformance/quality.h"

enum { FRAMES = 21 };
#define STEP 0.002 /* degrees per frame; 45 degrees lies in the middle of the orbit */

struct changes {
    double largest, median; /* rms */
    double worst;           /* largest change of a channel of a pixel */
};

static int by_size(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static struct changes orbit(const struct quality *q, struct test_scene *scene,
                            struct sp_volume *volume, double distance) {
    struct changes c = { 0 };
    struct test_image last = { 0 };
    double sizes[FRAMES - 1];
    for (int f = 0; f < FRAMES; f++) {
        test_scene_orbit(scene, NULL, 45 + (f - FRAMES / 2 + 0.5) * STEP, 10, distance);
        struct test_image now = quality_render(q, volume, &scene->view);
        if (f) {
            sizes[f - 1] = pow(10, -0.05 * test_image_psnr(&now, &last));
            c.worst = fmax(c.worst, test_image_difference(&now, &last).largest);
            test_image_finish(&last);
        }
        last = now;
    }
    test_image_finish(&last);
    qsort(sizes, FRAMES - 1, sizeof *sizes, by_size);
    c.median = sizes[(FRAMES - 1) / 2];
    c.largest = sizes[FRAMES - 2];
    return c;
}

static const struct {
    test_scene_fn *build;
    double distance;
} scenes[] = {
    { test_scene_blobs, 66 },
    { test_scene_thin_shells, 82 },
    { test_scene_phantom, 110 },
    { test_scene_wide_kernel, 64 },
};

static void measure(struct quality *q) {
    printf("  change from frame to frame, %g degrees per frame, 1e-6\n"
           "  scene          mode     largest   median (motion)      pop  one pixel's largest\n",
           STEP);
    for (size_t i = 0; i < sizeof scenes / sizeof *scenes; i++) {
        struct test_scene scene;
        if (!scenes[i].build(&scene))
            exit(EXIT_FAILURE);
        struct sp_volume *volume = quality_volume(&scene);
        struct changes by[2];
        for (int slab = 0; slab < 2; slab++) {
            scene.view.compositing.mode = slab ? SP_COMPOSITE_SLAB : SP_COMPOSITE_SHEET;
            by[slab] = orbit(q, &scene, volume, scenes[i].distance);
            struct changes *c = &by[slab];
            printf("  %-14s %-5s  %9.2f         %9.2f  %9.2f            %9.2f\n", scene.info.name,
                   slab ? "slab" : "sheet", 1e6 * c->largest, 1e6 * c->median,
                   1e6 * (c->largest - c->median), 1e6 * c->worst);
        }
        quality_expect(q, 10 * by[1].largest <= by[0].largest,
                       "%s: the largest change is %g for slabs, %g for sheets", scene.info.name,
                       by[1].largest, by[0].largest);
        quality_expect(q, 10 * (by[1].largest - by[1].median) <= by[0].largest - by[0].median,
                       "%s: the pop is %g for slabs, %g for sheets", scene.info.name,
                       by[1].largest - by[1].median, by[0].largest - by[0].median);
        quality_evict(q, &volume);
        test_scene_finish(&scene);
    }
}

/* A view of a volume, on its way around the vertical axis. */
static void turn_to(struct sp_view *view, double azimuth) {
    double *p = view->camera.position, *t = view->camera.target, a = azimuth * M_PI / 180;
    double x = p[0] - t[0], y = p[1] - t[1], distance = sqrt(x * x + y * y);
    p[0] = t[0] + distance * sin(a);
    p[1] = t[1] - distance * cos(a);
}

/* The changes between three frames: the axis switches after the second frame. */
static void orbit_default(const struct quality *q, struct sp_volume *volume, struct sp_view *view,
                          double rms[2], double worst[2]) {
    struct test_image last = { 0 };
    for (int f = 0; f < 3; f++) {
        turn_to(view, 45 + (f - 1.5) * STEP);
        struct test_image now = quality_render(q, volume, view);
        if (f) {
            rms[f - 1] = pow(10, -0.05 * test_image_psnr(&now, &last));
            worst[f - 1] = test_image_difference(&now, &last).largest;
            test_image_finish(&last);
        }
        last = now;
    }
    test_image_finish(&last);
}

static const char *const volumes[] = {
    "demo:phantom?size=96",          "demo:hydrogen?size=64",
    "demo:marschner-lobb",           "demo:engine",
    "engine_256x256x128_uint8.nrrd", "bonsai_256x256x256_uint8.nrrd",
    "lobster_301x324x56_uint8.nrrd"
};

static void measure_default(struct quality *q) {
    printf("  change at the switch, default view, in %% of the range, beyond the change by motion\n"
           "  volume                          shading       rms  one pixel's largest\n");
    for (size_t i = 0; i < sizeof volumes / sizeof *volumes; i++) {
        struct sp_volume *volume = quality_load(volumes[i]);
        for (int lit = 0; volume && lit < 2; lit++) {
            struct sp_view view;
            double rms[2], worst[2];
            sp_view_init(&view, sp_volume_info(volume), "popping");
            view.size[0] = view.size[1] = 256;
            view.shading.mode = lit ? SP_SHADING_PHONG : SP_SHADING_NONE;
            orbit_default(q, volume, &view, rms, worst);
            double pop = rms[1] - rms[0], most = worst[1] - worst[0];
            printf("  %-30s  %-8s   %7.3f              %7.3f\n", volumes[i], lit ? "phong" : "none",
                   100 * pop, 100 * most);
            /* Where gradients vanish, a normal may turn by any angle while the camera hardly does,
             * so single lit pixels say nothing about the switch. */
            quality_expect(q, pop <= 0.001 && (lit || most <= 0.01),
                           "%s: the image changes by %g at the switch, one pixel by %g", volumes[i],
                           pop, most);
        }
        if (volume)
            quality_evict(q, &volume);
    }
}

static void measure_all(struct quality *q) {
    measure(q);
    measure_default(q);
}

int main(void) {
    return quality_main(measure_all);
}
