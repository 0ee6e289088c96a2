/* SPDX-License-Identifier: Apache-2.0
 *
 * Compares the sheets of every instruction set with the scalar reference, on extreme volumes and
 * cameras: a single slice, a single row of voxels, spacings from 1 to 6, cameras inside the volume
 * and far away, rolled cameras, with and without lighting, all filters over their whole range,
 * optical depths from almost none to opaque. The instruction sets draw post-convolved sheets
 * (draw/postconv/postconv.h), or footprints where post-convolution does not apply.
 *
 * Footprints end at the cutoff; post-convolved kernels reach farther. The higher PSNR of two
 * counts: against the reference with the cutoff of the view, and with CUTOFF_FAR. An image that
 * consists of footprints already equals the first, so the slow second is not rendered for it.
 *
 *   test_conformance_postconv [SEED [END]]   only the scene SEED, or the scenes [SEED, END)
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sp/log.h"
#include "support/render.h"
#include "support/sanitized.h"

/* Measured lowest PSNR of sheets: 51.55 dB, with filter adaptive 61.66 dB. Over the seeds 0 … 5999
 * it is 42.06 and 38.88 dB, both for a volume of 2×2×2 voxels. */
enum { SCENES = TEST_SANITIZED ? 80 : 240, CUTOFF_FAR = 6, VARIANTS = 8 };
static const double floors[2] = { 51, 58 }; /* dB; adaptive */

/* Images that are drawn only with footprints have a higher PSNR than this [dB]. */
#define FOOTPRINTS 110

struct generator {
    uint64_t state;
};

/* Returns a random number in [0, 1). It is an xorshift generator, so that a seed gives the same
 * scene on every platform. */
static double roll(struct generator *d) {
    d->state ^= d->state << 13;
    d->state ^= d->state >> 7;
    d->state ^= d->state << 17;
    return (double)(d->state >> 11) * 0x1p-53;
}

static double between(struct generator *d, double low, double high) {
    return low + (high - low) * roll(d);
}

static double one_of(struct generator *d, const double *values, unsigned count) {
    return values[(unsigned)(roll(d) * count)];
}
#define ONE_OF(d, ...)                                                                             \
    one_of(d, (const double[]){ __VA_ARGS__ },                                                     \
           sizeof(const double[]){ __VA_ARGS__ } / sizeof(double))

static double bumps(const void *user, double x, double y, double z) {
    double rough = *(const double *)user;
    return 120 + 100 * sin(0.31 * x + 0.2 * y) * cos(0.23 * z + 0.1) +
           rough * sin(37 * x + 11 * y + 5 * z);
}

static bool make_volume(struct test_scene *s, struct generator *d) {
    static const uint32_t shapes[][3] = { { 24, 21, 18 }, { 20, 40, 8 }, { 30, 1, 27 },
                                          { 33, 25, 1 },  { 2, 2, 2 },   { 60, 1, 1 } };
    static const double spacings[][3] = { { 1, 1, 1 }, { 1, 1, 6 }, { 4, 1, 1 }, { 1, 2.5, 1 } };
    const uint32_t *shape = shapes[(unsigned)(roll(d) * 6)];
    const double *spacing = spacings[(unsigned)(roll(d) * 4)];
    double rough = ONE_OF(d, 0, 0, 30);
    return test_scene_voxels(s, "bumps", shape, spacing, SP_UINT8, bumps, &rough);
}

static double radius(const struct sp_grid *grid) {
    double sum = 0;
    for (int a = 0; a < 3; a++)
        sum += pow(grid->dims[a] * grid->spacing[a], 2);
    return 0.5 * sqrt(sum);
}

static void place_camera(struct test_scene *s, struct generator *d) {
    struct sp_view *v = &s->view;
    double size = radius(&s->info.grid), distance = size * ONE_OF(d, 0.01, 0.5, 1.2, 2, 2, 3, 20);
    double aim[3];
    for (int a = 0; a < 3; a++)
        aim[a] = between(d, -0.1, 0.1) * size;
    double elevation = between(d, -80, 80), azimuth = between(d, -180, 180);
    test_scene_orbit(s, aim, azimuth, elevation, distance);
    for (int a = 0; a < 3; a++) /* rolls the camera */
        v->camera.up[a] = between(d, -1, 1);
    v->camera.projection = roll(d) < 0.3 ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
    v->camera.fov_y = ONE_OF(d, 1, 10, 30, 40, 60, 170);
    v->camera.height = size * ONE_OF(d, 0.05, 0.5, 1, 2, 4);
    v->camera.near = ONE_OF(d, 0.1, 1e-4, 1);
    v->size[0] = (uint32_t)ONE_OF(d, 1, 3, 64, 90, 130);
    v->size[1] = (uint32_t)ONE_OF(d, 1, 2, 64, 75, 100);
}

static void choose_filter(struct sp_view *v, struct generator *d) {
    v->filter.mode = (enum sp_filter_mode)(int)(roll(d) * 5); /* all except none */
    v->filter.sigma = ONE_OF(d, 0.3, 0.5, 0.7, 0.7, 1, 2);
    v->filter.lowpass = ONE_OF(d, 0, 0.3, 1, 1, 2, 8);
    v->filter.cutoff = ONE_OF(d, 2, 3, 3, 3, 3, 4, 6);
}

/* A surface and a shell inside of the volume. Neither depends on the cutoff. */
static void add_layers(struct sp_view *v) {
    v->layers[1] = sp_layer_default(SP_LAYER_SURFACE);
    v->layers[1].value = 130;
    v->layers[1].opacity = 0.6f;
    v->layers[2] = sp_layer_default(SP_LAYER_SHELL);
    v->layers[2].low = 0.2;
    v->layers[2].high = 0.8;
    v->layers[2].detail = SP_SHELL_FAST;
    v->layer_count = 3;
}

static bool make_scene(struct test_scene *s, unsigned seed) {
    struct generator d = { UINT64_C(0x9e3779b97f4a7c15) * (seed + 1) };
    struct sp_view *v = &s->view;
    for (int i = 0; i < 8; i++)
        roll(&d);
    test_view_init(v);
    if (!make_volume(s, &d))
        return false;
    test_scene_points(s,
                      (const double[][5]){ { 60, 0.9, 0.3, 0.1, 0 },
                                           { 120, 0.9, 0.8, 0.3, 0.1 },
                                           { 220, 1, 1, 1, 0.7 } },
                      3);
    v->transfer_function.reference_length = ONE_OF(&d, 1, 1, 1, 1, 1, 100, 0.01);
    place_camera(s, &d);
    choose_filter(v, &d);
    v->compositing.attenuation =
        roll(&d) < 0.5 ? SP_ATTENUATION_LINEAR : SP_ATTENUATION_EXPONENTIAL;
    v->level_of_detail = roll(&d) < 0.5 ? SP_LOD_OFF : SP_LOD_AUTO;
    v->shading.mode = roll(&d) < 0.5 ? SP_SHADING_PHONG : SP_SHADING_NONE;
    v->background[3] = 1;
    if (seed % 4 == 1)
        add_layers(v);
    return true;
}

/* The images of the scalar reference: with the cutoff of the view, and with CUTOFF_FAR (rendered on
 * demand; rgba is NULL until then). */
struct wanted {
    const struct test_renderer *reference;
    struct test_image near, far;
};

/* Returns the PSNR against the nearer of the wanted images [dB]; NAN on failure. */
static double compute_psnr(struct wanted *wanted, const struct test_scene *scene,
                           const struct test_image *image, struct sp_error *err) {
    double psnr = test_image_psnr(image, &wanted->near);
    /* Kernels end at a cutoff below 3 in both renderers. */
    if (psnr >= FOOTPRINTS || scene->view.filter.cutoff < 3)
        return psnr;
    struct test_scene far = *scene;
    far.view.filter.cutoff = CUTOFF_FAR;
    if (!wanted->far.rgba && !test_render_scene(wanted->reference, &far, &wanted->far, err))
        return NAN;
    return fmax(psnr, test_image_psnr(image, &wanted->far));
}

struct tally {
    double lowest[2];  /* dB */
    unsigned filtered; /* images drawn without footprints */
    unsigned failed, ran;
};

/* An instruction set with its results. */
struct variant {
    struct test_renderer renderer;
    const char *isa;
    struct tally tally;
};

/* Returns the PSNR between the image of `r` and the nearest wanted one [dB]; NAN on failure. */
static double compare(const struct test_renderer *r, const struct test_scene *scene,
                      struct wanted *wanted) {
    struct test_image image;
    struct sp_error err = { .text = "a value is not finite" };
    double psnr = NAN;
    if (test_render_scene(r, scene, &image, &err)) {
        psnr = compute_psnr(wanted, scene, &image, &err);
        test_image_finish(&image);
    }
    if (isnan(psnr))
        printf("%s: %s\n", err.place, err.text);
    return psnr;
}

static void check_variant(struct variant *variant, const struct test_scene *scene,
                          struct wanted *wanted, unsigned seed) {
    struct tally *t = &variant->tally;
    const struct sp_view *v = &scene->view;
    const uint32_t *dims = scene->info.grid.dims;
    bool is_adaptive = v->filter.mode == SP_FILTER_ADAPTIVE;
    double psnr = compare(&variant->renderer, scene, wanted);
    bool ok = psnr >= floors[is_adaptive];
    t->lowest[is_adaptive] = fmin(t->lowest[is_adaptive], psnr);
    t->filtered += psnr < FOOTPRINTS;
    t->failed += !ok;
    t->ran++;
    if (!ok)
        printf("FAILED %s seed %u: %.2f dB; %u×%u×%u voxels, %u×%u px, filter %d, sigma %g, "
               "low-pass "
               "%g, cutoff %g\n",
               variant->isa, seed, psnr, dims[0], dims[1], dims[2], v->size[0], v->size[1],
               (int)v->filter.mode, v->filter.sigma, v->filter.lowpass, v->filter.cutoff);
}

/* Renders the scene `seed` once with the reference and once with each instruction set. */
static void check(const struct test_renderer *reference, struct variant *variants, unsigned count,
                  unsigned seed) {
    struct test_scene scene;
    struct wanted wanted = { .reference = reference };
    struct sp_error err;
    if (!make_scene(&scene, seed))
        exit(EXIT_FAILURE);
    if (!test_render_scene(reference, &scene, &wanted.near, &err)) {
        printf("FAILED scalar seed %u: %s\n", seed, err.text);
        exit(EXIT_FAILURE);
    }
    for (unsigned i = 0; i < count; i++)
        check_variant(&variants[i], &scene, &wanted, seed);
    test_image_finish(&wanted.near);
    if (wanted.far.rgba)
        test_image_finish(&wanted.far);
    test_scene_finish(&scene);
}

/* Opens all instruction sets of this machine except the reference. Returns their number. */
static unsigned open_variants(struct variant *variants) {
    struct test_target target;
    struct sp_error err;
    unsigned count = 0;
    for (unsigned i = 0; test_target_at(i, &target); i++) {
        struct variant *variant = &variants[count];
        if (strcmp(target.backend, "cpu") != 0 || strcmp(target.isa, "scalar") == 0)
            continue;
        if (count == VARIANTS || !test_renderer_open(&variant->renderer, &target, 2, &err)) {
            printf("skipped: %s: %s\n", target.isa, count == VARIANTS ? "too many" : err.text);
            continue;
        }
        variant->isa = target.isa;
        variant->tally = (struct tally){ .lowest = { INFINITY, INFINITY } };
        count++;
    }
    return count;
}

int main(int argc, char **argv) {
    unsigned first = argc > 1 ? (unsigned)strtoul(argv[1], NULL, 10) : 0;
    unsigned end = argc > 2 ? (unsigned)strtoul(argv[2], NULL, 10) : argc > 1 ? first + 1 : SCENES;
    struct test_target scalar = { "cpu", "scalar" };
    struct test_renderer reference;
    struct variant variants[VARIANTS];
    struct sp_error err;
    unsigned failed = 0, ran = 0;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    if (!test_renderer_open(&reference, &scalar, 2, &err)) {
        printf("FAILED scalar: %s\n", err.text);
        return EXIT_FAILURE;
    }
    unsigned count = open_variants(variants);
    if (TEST_SANITIZED)
        printf("reduced: a third of the scenes under a sanitizer\n");
    for (unsigned seed = first; seed < end; seed++)
        check(&reference, variants, count, seed);
    for (unsigned i = 0; i < count; i++) {
        const struct tally *t = &variants[i].tally;
        printf("%s: lowest PSNR %.2f dB, adaptive %.2f dB; %u images without footprints\n",
               variants[i].isa, t->lowest[0], t->lowest[1], t->filtered);
        failed += t->failed + (argc == 1 && t->filtered < SCENES / 8);
        ran += t->ran;
        test_renderer_close(&variants[i].renderer);
    }
    test_renderer_close(&reference);
    printf("%u of %u scenes failed\n", failed, ran);
    return failed ? EXIT_FAILURE : EXIT_SUCCESS;
}
