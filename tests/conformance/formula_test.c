/* SPDX-License-Identifier: Apache-2.0
 *
 * Backends against the formulas in double precision (support/formula.h), on scenes drawn by a
 * seeded generator: sample types, sides from 1 voxel, spacings, rotations, shears, mirrors, both
 * projections, kernels, cutoffs, filters, backgrounds, image shapes, Phong.
 *
 *   test_conformance_formula [SEED [END]]      one scene alone, or those of seeds [SEED, END)
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sp/log.h"
#include "support/data.h"
#include "support/formula.h"
#include "support/render.h"

/* Measured over seeds 0 … 999 with the scalar CPU backend: 96 dB at least without shading, 48.7
 * with it (normals are quantised, and highlights magnify that). */
enum { SCENES = 200, FLOOR = 80, FLOOR_PHONG = 45 };

struct dice {
    uint64_t state;
};

/* [low, high); an xorshift generator, so that a seed means the same everywhere. */
static double between(struct dice *d, double low, double high) {
    d->state ^= d->state << 13;
    d->state ^= d->state >> 7;
    d->state ^= d->state << 17;
    return low + (high - low) * (double)(d->state >> 11) * 0x1p-53;
}

static bool one_in(struct dice *d, double n) {
    return between(d, 0, n) < 1;
}

static double waves(const void *user, double x, double y, double z) {
    const double *k = user;
    return 50 + 60 * sin(k[0] * x + k[1] * y + k[2] * z + 5 * k[3]) +
           40 * sin(k[4] * k[5] * x + k[1] * z) * cos(k[2] * y);
}

static void draw_view(struct dice *d, struct test_scene *s, double size) {
    struct sp_view *v = &s->view;
    double target[3];
    for (int a = 0; a < 3; a++)
        target[a] = between(d, -0.15, 0.15) * size;
    double azimuth = one_in(d, 5) ? 90 * floor(between(d, 0, 4)) : between(d, -180, 180);
    double elevation = one_in(d, 5) ? 0 : between(d, -85, 85);
    double distance = between(d, 1.0, 2.5) * size;
    test_scene_orbit(s, target, azimuth, elevation, distance);
    for (int a = 0; a < 3; a++)
        v->camera.up[a] += between(d, -0.4, 0.4);
    if (one_in(d, 3)) {
        v->camera.projection = SP_ORTHOGRAPHIC;
        v->camera.height = size * between(d, 0.3, 1.2);
    }
    v->camera.fov_y = one_in(d, 4) ? between(d, 60, 110) : between(d, 10, 55);
    v->camera.near = one_in(d, 4) ? between(d, 0.7, 1) * distance : 0.05 * size;
    v->transfer_function.reference_length = exp(between(d, -1, 1));
    v->filter.sigma = one_in(d, 4) ? between(d, 0.35, 1.6) : 0.7;
    v->filter.cutoff = one_in(d, 4) ? between(d, 1, 6) : 3;
    v->filter.lowpass = one_in(d, 4) ? between(d, 0, 4) : 1;
    if (one_in(d, 4))
        v->filter.mode = SP_FILTER_RECONSTRUCTION;
    else if (one_in(d, 5) && v->filter.lowpass > 0.2)
        v->filter.mode = SP_FILTER_LOWPASS;
    for (int c = 0; c < 4; c++)
        v->background[c] = one_in(d, 2) ? (float)between(d, 0, 1) : (float)(c == 3);
    v->size[0] = 16 + (uint32_t)between(d, 0, 80);
    v->size[1] = 16 + (uint32_t)between(d, 0, 80);
    if (one_in(d, 4))
        v->shading.mode = SP_SHADING_PHONG;
}

static bool draw(struct test_scene *s, unsigned seed) {
    struct dice dice = { UINT64_C(0x9e3779b97f4a7c15) * (seed + 1) }, *d = &dice;
    uint32_t dims[3];
    double k[6], spacing[3], size = 0, points[4][5] = { { 20 }, { 60 }, { 80 }, { 120 } };
    for (int i = 0; i < 6; i++)
        k[i] = between(d, -0.6, 0.6);
    for (int a = 0; a < 3; a++) {
        dims[a] = (uint32_t)(one_in(d, 6) ? between(d, 1, 4) : between(d, 4, 29));
        spacing[a] = exp(between(d, -1.2, 1.2));
        size += pow(dims[a] * spacing[a], 2);
    }
    double dense = one_in(d, 3) ? between(d, 0.5, 0.995) : between(d, 0.01, 0.4);
    enum sp_type type = (enum sp_type)between(d, 0, SP_TYPE_COUNT);
    for (int i = 0; i < 4; i++) {
        for (int c = 1; c < 4; c++)
            points[i][c] = between(d, 0, 1);
        points[i][4] = i == 3 ? dense : i == 1 ? 0.3 * dense : 0;
    }
    test_view_init(&s->view);
    test_scene_points(s, points, 4);
    if (!test_scene_voxels(s, "random", dims, spacing, type, waves, k))
        return false;
    if (one_in(d, 2)) {
        double degrees[3] = { between(d, -180, 180), between(d, -180, 180), between(d, -180, 180) };
        double mirror = one_in(d, 2) ? 1 : -1;
        test_scene_direction(s, degrees, mirror, one_in(d, 2) ? between(d, -0.7, 0.7) : 0);
    }
    draw_view(d, s, sqrt(size));
    return true;
}

/* Lowest PSNR goes to worst[shaded]. */
static bool check(const struct test_renderer *r, const char *name, unsigned seed, double worst[2]) {
    struct test_scene scene;
    struct test_image image, wanted;
    struct sp_error err;
    if (!draw(&scene, seed) || !test_formula_render(&scene, 0, &wanted))
        return false;
    if (!test_render_scene(r, &scene, &image, &err)) {
        printf("FAILED %s seed %u: %s: %s\n", name, seed, err.place, err.text);
        return false;
    }
    bool shaded = scene.view.shading.mode == SP_SHADING_PHONG;
    double psnr = test_image_psnr(&image, &wanted);
    bool ok = psnr >= (shaded ? FLOOR_PHONG : FLOOR);
    worst[shaded] = fmin(worst[shaded], psnr);
    if (!ok) {
        struct test_difference d = test_image_difference(&image, &wanted);
        const uint32_t *dims = scene.info.grid.dims;
        char dump[128];
        printf("FAILED %s seed %u: %.1f dB; worst at (%u,%u) channel %u: %.5f for %.5f; "
               "%u×%u×%u voxels, filter %d, projection %d\n",
               name, seed, psnr, d.x, d.y, d.channel, d.a, d.b, dims[0], dims[1], dims[2],
               (int)scene.view.filter.mode, (int)scene.view.camera.projection);
        snprintf(dump, sizeof dump, "formula-%u", seed);
        test_image_dump(dump, &image, &wanted, 20);
    }
    test_image_finish(&image);
    test_image_finish(&wanted);
    test_scene_finish(&scene);
    return ok;
}

int main(int argc, char **argv) {
    struct test_target target;
    unsigned ran = 0, failed = 0, first = 0, end = SCENES;
    if (argc > 1) {
        first = (unsigned)strtoul(argv[1], NULL, 10);
        end = argc > 2 ? (unsigned)strtoul(argv[2], NULL, 10) : first + 1;
    }
    sp_log_init(NULL, NULL, SP_LOG_ERROR); /* refusals are printed here as skips */
    for (unsigned i = 0; test_target_at(i, &target); i++) {
        struct test_renderer r;
        struct sp_error err;
        char name[64];
        double worst[2] = { INFINITY, INFINITY };
        snprintf(name, sizeof name, "%s/%s", target.backend, target.isa);
        if (!test_renderer_open(&r, &target, 2, &err)) {
            printf("skipped: %s: %s\n", name, err.text);
            continue;
        }
        for (unsigned seed = first; seed < end; seed++, ran++)
            failed += !check(&r, name, seed, worst);
        printf("%s: lowest %.1f dB, with Phong %.1f dB\n", name, worst[0], worst[1]);
        test_renderer_close(&r);
    }
    printf("%u of %u scenes failed\n", failed, ran);
    return failed ? EXIT_FAILURE : ran ? EXIT_SUCCESS : TEST_SKIPPED;
}
