/* SPDX-License-Identifier: Apache-2.0
 *
 * Images of shells: the digital surface against rays through cells, lower thresholds against the
 * whole volume, hidden voxels, fragments, instruction sets, threads, and what has no shell.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "backend/cpu/kernels.h"
#include "support/compare.h"
#include "support/one_thread.h"
#include "support/render.h"
#include "support/sanitized.h"
#include "support/shell.h"

enum { SIDE = TEST_SANITIZED ? 128 : 160 };

/* A ball with a dent, and a small ball apart from it. */
static double balls(const void *user, double x, double y, double z) {
    (void)user;
    double a = 8 - sqrt((x - 10) * (x - 10) + (y - 11) * (y - 11) + (z - 9) * (z - 9));
    double b = 3 - sqrt((x - 19) * (x - 19) + (y - 18) * (y - 18) + (z - 15) * (z - 15));
    double dent = sqrt((x - 10) * (x - 10) + (y - 4) * (y - 4) + (z - 5) * (z - 5)) - 4;
    double inside = fmax(fmin(a, dent), b);
    return 200 / (1 + exp(-2 * inside));
}

static void open_balls(struct test_shell *rig, const double spacing[3], unsigned threads) {
    const double points[][5] = { { 40, 0.2, 0.3, 1, 0 },
                                 { 100, 1, 0.5, 0.1, 0.3 },
                                 { 180, 0.2, 1, 0.4, 0.9 } };
    struct test_scene scene = { 0 };
    test_view_init(&scene.view);
    test_scene_points(&scene, points, 3);
    assert_true(test_scene_voxels(&scene, "balls", (const uint32_t[3]){ 24, 24, 20 }, spacing,
                                  SP_UINT8, balls, NULL));
    test_scene_orbit(&scene, NULL, 30, 25, 60 * spacing[2]);
    scene.view.size[0] = scene.view.size[1] = SIDE;
    test_shell_open(rig, &scene, threads);
}

static void draw(struct test_shell *rig, struct test_image *image) {
    struct sp_error err = { 0 };
    if (!test_shell_draw(rig, image, &err))
        fail_msg("%s: %s", err.place, err.text);
}

/* True if the pixel and all its neighbours up to `reach` px away show the surface. */
static bool is_within(const int64_t *hits, unsigned p, unsigned width, unsigned reach) {
    unsigned x = p % width, y = p / width;
    if (x < reach || y < reach || x + reach >= width || y + reach >= width)
        return false;
    for (unsigned j = y - reach; j <= y + reach; j++)
        for (unsigned i = x - reach; i <= x + reach; i++)
            if (hits[j * width + i] < 0)
                return false;
    return true;
}

/* The depth that a pixel shows: of the fragment that makes it more opaque than transparent. */
static double shown_depth(const struct sp_fragment_tile *tile, int pixel) {
    float through = 1;
    for (int i = 0; i < tile->count[pixel]; i++) {
        through *= 1 - tile->list[pixel][i].alpha;
        if (through < 0.5f)
            return (double)tile->list[pixel][i].depth;
    }
    return INFINITY;
}

/* Compares the depths in the image with the depths of the cells that rays hit first. Returns the
 * share of the pixels inside the silhouette where they differ by more than `most`, and counts the
 * pixels that show nothing. */
static double compare_depths(struct test_shell *rig, const int64_t *hits, double most,
                             unsigned *missing) {
    const uint32_t *dims = rig->scene.info.grid.dims;
    struct sp_fragment_tile *tile = malloc(sizeof *tile);
    struct sp_voxel_layer shell;
    double inside[2];
    unsigned count = 0, wrong = 0;
    assert_non_null(tile);
    assert_true(sp_voxel_prepare(test_shell_start(rig, NULL), &shell, NULL));
    *missing = 0;
    for (int t = 0; t < shell.columns * shell.rows; t++) {
        int column = t % shell.columns, row = t / shell.columns;
        sp_fragment_tile_clear(tile, column * SP_FRAGMENT_TILE, row * SP_FRAGMENT_TILE);
        sp_voxel_tile(&shell, column, row, tile);
        for (int i = 0; i < SP_FRAGMENT_PIXELS; i++) {
            unsigned x = (unsigned)(tile->x + i % SP_FRAGMENT_TILE);
            unsigned y = (unsigned)(tile->y + i / SP_FRAGMENT_TILE);
            if (x >= SIDE || y >= SIDE || !is_within(hits, y * SIDE + x, SIDE, 2))
                continue;
            uint32_t n = (uint32_t)hits[y * SIDE + x];
            struct test_ray ray = test_shell_ray(rig, x + 0.5, y + 0.5);
            const uint32_t at[3] = { n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1] };
            assert_true(test_shell_hit(rig, &ray, at, inside));
            double off = shown_depth(tile, i) - 0.5 * (inside[0] + inside[1]);
            *missing += !isfinite(off);
            wrong += fabs(off) > most;
            count++;
        }
    }
    free(tile);
    assert_in_range(count, SIDE * SIDE / 30, SIDE * SIDE);
    return (double)wrong / count;
}

/* One threshold for both gives the digital surface: no holes, and the depths of the first opaque
 * cells that rays meet. Splats reach beyond cells, so that steps of the surface move a little. */
static void test_digital_surface(void **state) {
    (void)state;
    static const double spacings[][3] = { { 1, 1, 1 }, { 1, 1, 2.5 } };
    for (int i = 0; i < 16; i++) {
        const double *spacing = spacings[i & 1];
        bool is_flat = i & 2, is_parallel = i & 4;
        double most = (is_flat ? 1.1 : 2.2) * spacing[2]; /* a Gaussian ends after 2.1 voxels */
        struct test_shell rig;
        unsigned missing;
        if (TEST_SANITIZED && i % 5)
            continue;
        open_balls(&rig, spacing, 2);
        struct sp_camera *camera = &rig.scene.view.camera;
        rig.layer.low = rig.layer.high = 0.3;
        rig.layer.detail = is_flat ? SP_SHELL_FAST : SP_SHELL_HIGH;
        test_scene_orbit(&rig.scene, NULL, 47 * i, 20 * i - 70, (i & 8 ? 26 : 60) * spacing[2]);
        camera->projection = is_parallel ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
        camera->height = 34 * spacing[2];
        rig.scene.view.filter.lowpass = is_flat ? 0 : 0.5;
        test_shell_start(&rig, NULL);
        int *codes = test_shell_codes(&rig);
        int64_t *hits = test_shell_march(&rig, codes);
        double wrong = compare_depths(&rig, hits, most, &missing);
        printf("spacing %g, %s, %s: %.1f %% of the depths differ by more than %.1f\n", spacing[2],
               is_flat ? "fast" : "high", is_parallel ? "parallel" : "perspective", 100 * wrong,
               most);
        assert_int_equal(missing, 0);
        assert_compare(wrong, <, 0.1);
        free(codes);
        free(hits);
        test_shell_close(&rig);
    }
}

static void test_hidden_voxels(void **state) {
    (void)state;
    for (int i = 0; i < 6; i++) {
        struct test_shell rig;
        struct test_image all, seen;
        open_balls(&rig, (const double[3]){ 1, 1, 1 }, 2);
        rig.layer.low = i % 3 ? 0.05 : 0.5;
        rig.layer.high = 0.5;
        rig.layer.detail = i % 2 ? SP_SHELL_FAST : SP_SHELL_HIGH;
        test_scene_orbit(&rig.scene, NULL, 70 * i, 15 * i - 40, 50);
        draw(&rig, &seen);
        rig.input.keeps_hidden = true;
        draw(&rig, &all);
        double psnr = test_image_psnr(&all, &seen);
        printf("view %d: %.1f dB without hidden voxels\n", i, psnr);
        assert_compare(psnr, >, i % 2 ? 40 : 30); /* tails of Gaussians are seen beside edges */
        test_image_finish(&all);
        test_image_finish(&seen);
        test_shell_close(&rig);
    }
}

/* Lower thresholds tend to the whole volume, drawn splat by splat. */
static void test_convergence(void **state) {
    (void)state;
    static const double lows[] = { 0.3, 0.1, 0.03, 0 };
    static const struct test_target scalar = { "cpu", "scalar" };
    for (int m = 0; m < 2; m++) {
        struct test_renderer renderer;
        struct test_shell rig;
        struct test_image volume, shell;
        double last = 0;
        open_balls(&rig, (const double[3]){ 1, 1, 1.5 }, 2);
        struct sp_view *view = &rig.scene.view;
        view->transfer_function.order = SP_TF_PRE;
        view->compositing.mode = m ? SP_COMPOSITE_SHEET : SP_COMPOSITE_SPLAT;
        view->level_of_detail = SP_LOD_OFF;
        rig.layer.high = 1;
        assert_true(test_renderer_open(&renderer, &scalar, 2, NULL));
        assert_true(test_render(&renderer, rig.volume, view, &volume, NULL));
        for (int i = 0; i < 4; i++) {
            rig.layer.low = lows[i];
            draw(&rig, &shell);
            double psnr = test_image_psnr(&volume, &shell);
            printf("%s, low %g: %.1f dB\n", m ? "sheet" : "splat", lows[i], psnr);
            assert_compare(psnr, >, last);
            last = psnr;
            test_image_finish(&shell);
        }
        assert_compare(last, >, m ? 40 : 47);
        test_image_finish(&volume);
        test_renderer_close(&renderer);
        test_shell_close(&rig);
    }
}

static void test_fragments(void **state) {
    (void)state;
    for (int i = 0; i < 4; i++) {
        struct test_shell rig;
        struct test_image direct, merged;
        open_balls(&rig, (const double[3]){ 1, 1, 1 }, 2);
        rig.layer.low = i < 2 ? 0.5 : 0.1;
        rig.layer.high = i < 2 ? 0.5 : 0.8;
        rig.layer.detail = i % 2 ? SP_SHELL_FAST : SP_SHELL_HIGH;
        draw(&rig, &direct);
        assert_true(test_shell_draw_fragments(&rig, &merged, NULL));
        double psnr = test_image_psnr(&direct, &merged);
        printf("%s, low %g: fragments %.1f dB\n", i % 2 ? "fast" : "high", rig.layer.low, psnr);
        assert_compare(psnr, >, 80);
        test_image_finish(&direct);
        test_image_finish(&merged);
        test_shell_close(&rig);
    }
}

static void light(struct sp_view *view) {
    view->shading.mode = SP_SHADING_PHONG;
    view->shading.light_count = 1;
    view->shading.lights[0] = (struct sp_light){ { 0.5, 0.7, 1 }, SP_LIGHT_CAMERA, { 1, 1, 1 } };
}

/* Splats of one pixel in fog: fragments let the fog show as much of them as if each was composited
 * on its own, however many there are. */
static void test_fragments_in_fog(void **state) {
    (void)state;
    enum { SPLATS = 200 };
    struct sp_fragment_tile *tile = malloc(sizeof *tile);
    struct sp_voxel_record records[SPLATS] = { 0 };
    uint32_t entries[SPLATS];
    const struct sp_voxel_frame frame = { .mode = SP_FILTER_EWA,
                                          .apart = 1,
                                          .ewa = { .unit = 1, .cut = 1, .size = { 32, 32 } } };
    const double fog = 0.02;
    double worst = 0;
    assert_non_null(tile);
    srand(5);
    for (int round = 0; round < 40; round++) {
        double exact = 0, through = 1, shown = 0, u2 = 0;
        for (uint32_t i = 0; i < SPLATS; i++) {
            u2 += rand() % 4 ? 0.1 : 0.5 * rand() / RAND_MAX;
            records[i] = (struct sp_voxel_record){ .x1 = 32, .y1 = 32, .u2 = (float)u2 };
            records[i].depth = (float)(pow(2, -round % 8) * rand() / RAND_MAX);
            records[i].color[0] = 1;
            entries[i] = i;
            double opacity = through < 1.0 / 512 ? 0 : -expm1(-(double)records[i].depth);
            exact += exp(-fog * u2) * through * opacity;
            through *= 1 - opacity;
        }
        sp_fragment_tile_clear(tile, 0, 0);
        cpu_table.voxels.merge(tile, &frame, records, entries, SPLATS);
        through = 1;
        for (int i = 0; i < tile->count[77]; i++) {
            const struct sp_fragment *f = &tile->list[77][i];
            shown += exp(-fog * (double)f->depth) * through * (double)f->color[0];
            through *= 1 - (double)f->alpha;
        }
        worst = fmax(worst, fabs(shown - exact));
    }
    printf("in fog: %.5f at most\n", worst);
    assert_compare(worst, <, 1e-3);
    free(tile);
}

static void test_instruction_sets(void **state) {
    (void)state;
    const char *isa;
    for (int is_flat = 0; is_flat < 2; is_flat++) {
        struct test_shell rig;
        struct test_image wanted, merged, got;
        open_balls(&rig, (const double[3]){ 1, 1, 1 }, 2);
        light(&rig.scene.view);
        rig.layer.low = 0.1;
        rig.layer.detail = is_flat ? SP_SHELL_FAST : SP_SHELL_HIGH;
        draw(&rig, &wanted);
        assert_true(test_shell_draw_fragments(&rig, &merged, NULL));
        for (unsigned i = 1; (isa = cpu_isa_at(i)); i++) {
            struct cpu_kernels kernels;
            if (!cpu_kernels_init(&kernels, isa, NULL)) {
                printf("skipped: %s\n", isa);
                continue;
            }
            rig.kernels = kernels.voxels;
            draw(&rig, &got);
            double psnr = test_image_psnr(&wanted, &got);
            test_image_finish(&got);
            assert_true(test_shell_draw_fragments(&rig, &got, NULL));
            printf("%s: %.1f dB, fragments %.1f dB\n", isa, psnr, test_image_psnr(&merged, &got));
            assert_compare(psnr, >, 90);
            assert_compare(test_image_psnr(&merged, &got), >, 60);
            test_image_finish(&got);
        }
        test_image_finish(&wanted);
        test_image_finish(&merged);
        test_shell_close(&rig);
    }
}

static void test_threads(void **state) {
    (void)state;
    struct test_image first = { 0 };
    for (unsigned threads = 1; threads <= 5; threads += 2) {
        struct test_shell rig;
        struct test_image image;
        open_balls(&rig, (const double[3]){ 1, 1, 1 }, threads);
        light(&rig.scene.view);
        rig.layer.low = 0.02;
        test_scene_orbit(&rig.scene, NULL, 80, 5, 50);
        draw(&rig, threads == 1 ? &first : &image);
        if (threads > 1) {
            assert_int_equal(test_image_difference(&first, &image).largest > 0, 0);
            test_image_finish(&image);
        }
        test_shell_close(&rig);
    }
    test_image_finish(&first);
}

/* Splats that touch more tiles than one part of a batch has entries for: the image of twice the
 * size, averaged over squares of four pixels, is the image of one part. */
static void test_parts(void **state) {
    (void)state;
    struct test_image images[2];
    double most = 0;
    for (unsigned i = 0; i < 2; i++) {
        struct test_shell rig;
        open_balls(&rig, (const double[3]){ 1, 1, 1 }, 2);
        rig.layer.low = 0.02;
        rig.layer.high = 1;
        rig.scene.view.filter.sigma = 2;
        rig.scene.view.size[0] = rig.scene.view.size[1] = 352U << i;
        test_scene_orbit(&rig.scene, NULL, 30, 25, 30);
        draw(&rig, &images[i]);
        test_shell_close(&rig);
    }
    for (unsigned y = 0; y < 352; y++)
        for (unsigned x = 0; x < 1408; x++) { /* four channels */
            const double *at = images[1].rgba + (size_t)5632 * y + 8 * (x / 4) + x % 4;
            double mean = 0.25 * (at[0] + at[4] + at[2816] + at[2820]);
            most = fmax(most, fabs(mean - images[0].rgba[(size_t)1408 * y + x]));
        }
    printf("most that twice the size differs: %g\n", most);
    assert_compare(most, <, 0.02);
    test_image_finish(&images[0]);
    test_image_finish(&images[1]);
}

/* Sums of squares are invariant: the image of a mirrored grid is the image of the grid. */
static void test_grids(void **state) {
    (void)state;
    for (int is_flat = 0; is_flat < 2; is_flat++) {
        struct test_shell rig;
        struct test_image even, graded, mirrored;
        double at[3][24];
        const double *coordinates[3] = { at[0], at[1], at[2] };
        const uint32_t dims[3] = { 24, 24, 20 };
        open_balls(&rig, (const double[3]){ 1, 1, 1 }, 2);
        rig.layer.detail = is_flat ? SP_SHELL_FAST : SP_SHELL_HIGH;
        rig.layer.low = 0.2;
        draw(&rig, &even);
        struct sp_view view = rig.scene.view;
        test_shell_close(&rig);
        for (int a = 0; a < 3; a++) /* a rectilinear grid that is even */
            for (uint32_t i = 0; i < dims[a]; i++)
                at[a][i] = i;
        struct test_scene scene = { .view = view };
        assert_true(test_scene_voxels(&scene, "balls", dims, (const double[3]){ 1, 1, 1 }, SP_UINT8,
                                      balls, NULL));
        for (int a = 0; a < 3; a++)
            scene.info.grid.coordinates[a] = coordinates[a];
        test_shell_open(&rig, &scene, 2);
        rig.layer.detail = is_flat ? SP_SHELL_FAST : SP_SHELL_HIGH;
        rig.layer.low = 0.2;
        draw(&rig, &graded);
        assert_compare(test_image_psnr(&even, &graded), >, 100);
        rig.scene.info.grid.coordinates[0] = rig.scene.info.grid.coordinates[1] =
            rig.scene.info.grid.coordinates[2] = NULL;
        test_shell_close(&rig);
        scene = (struct test_scene){ .view = view };
        assert_true(test_scene_voxels(&scene, "balls", dims, (const double[3]){ 1, 1, 1 }, SP_UINT8,
                                      balls, NULL));
        test_scene_direction(&scene, (const double[3]){ 0, 0, 0 }, -1, 0);
        for (int i = 0; i < 3; i++) /* z is mirrored: so is the camera */
            scene.view.camera.position[2] =
                i == 2 ? -view.camera.position[2] : scene.view.camera.position[2];
        scene.view.camera.target[2] = -view.camera.target[2];
        scene.view.camera.up[2] = -view.camera.up[2];
        test_shell_open(&rig, &scene, 2);
        rig.layer.detail = is_flat ? SP_SHELL_FAST : SP_SHELL_HIGH;
        rig.layer.low = 0.2;
        draw(&rig, &mirrored);
        test_image_mirror(&mirrored);
        double psnr = test_image_psnr(&even, &mirrored);
        printf("mirrored grid: %.1f dB\n", psnr);
        assert_true(psnr >
                    (is_flat ? 25 : 45)); /* edges of squares fall on either side of pixels */
        test_image_finish(&even);
        test_image_finish(&graded);
        test_image_finish(&mirrored);
        test_shell_close(&rig);
    }
}

/* If no voxel is in the shell, the image shows the background. */
static void test_empty(void **state) {
    (void)state;
    for (int i = 0; i < 4; i++) {
        struct test_shell rig;
        struct test_image image;
        open_balls(&rig, (const double[3]){ 1, 1, 1 }, 1);
        struct sp_view *view = &rig.scene.view;
        const float background[4] = { 0.25f, 0.5f, 0.75f, 1 };
        for (int c = 0; c < 4; c++)
            view->background[c] = background[c];
        if (i == 0) /* transparent */
            for (uint32_t p = 0; p < view->transfer_function.point_count; p++)
                view->transfer_function.points[p].opacity = 0;
        else if (i == 1)
            rig.layer.low = rig.layer.high = 1; /* nothing is opaque enough */
        else if (i == 2)
            rig.layer.low = rig.layer.high = 0; /* everything hides its neighbours */
        else
            view->clip.box[0][0] = view->clip.box[1][0] = 0; /* nothing is left */
        draw(&rig, &image);
        for (unsigned p = 0; p < image.width * image.height; p++)
            for (int c = 0; c < 4; c++)
                assert_float_equal((float)image.rgba[4 * p + c], background[c], 1e-6f);
        test_image_finish(&image);
        test_shell_close(&rig);
    }
}

/* The cut through an opaque ball is filled. */
static void test_cut(void **state) {
    (void)state;
    for (int is_flat = 0; is_flat < 2; is_flat++) {
        struct test_shell rig;
        struct test_image image;
        open_balls(&rig, (const double[3]){ 1, 1, 1 }, 2);
        rig.layer.low = rig.layer.high = 0.3;
        rig.layer.detail = is_flat ? SP_SHELL_FAST : SP_SHELL_HIGH;
        test_scene_orbit(&rig.scene, NULL, 0, 0, 60);
        const double *eye = rig.scene.view.camera.position;
        test_scene_cut(&rig.scene, (const double[3]){ -eye[0], -eye[1], -eye[2] },
                       (const double[3]){ 0, 0, 0 });
        draw(&rig, &image);
        int *codes = test_shell_codes(&rig);
        int64_t *hits = test_shell_march(&rig, codes);
        unsigned filled = 0;
        for (unsigned p = 0; p < image.width * image.height; p++) {
            if (!is_within(hits, p, SIDE, SIDE / 20))
                continue;
            filled++;
            assert_compare(image.rgba[4 * p + 3], >, 0.998);
        }
        assert_in_range(filled, SIDE * SIDE / 20, SIDE * SIDE);
        free(codes);
        free(hits);
        test_image_finish(&image);
        test_shell_close(&rig);
    }
}

/* True if a pixel of the splat's box lies on an open tile. */
static bool touches_open(const struct sp_voxel_frame *frame, const struct sp_voxel_record *r) {
    for (int y = r->y0; y < r->y1; y++)
        for (int x = r->x0; x < r->x1; x++)
            if (!frame->closed[y / SP_VOXEL_TILE * frame->columns + x / SP_VOXEL_TILE])
                return true;
    return false;
}

/* Where tiles are opaque already, set-up leaves out the splats that touch no other tile, and does
 * not change the other splats. */
static void test_closed_tiles(void **state) {
    (void)state;
    for (int is_flat = 0; is_flat < 2; is_flat++) {
        struct test_shell rig;
        struct sp_voxel_layer shell;
        bool closed[SIDE / SP_VOXEL_TILE * (SIDE / SP_VOXEL_TILE)];
        open_balls(&rig, (const double[3]){ 1, 1, 1 }, 2);
        rig.layer.detail = is_flat ? SP_SHELL_FAST : SP_SHELL_HIGH;
        assert_true(sp_voxel_source_acquire(test_shell_start(&rig, NULL), &shell, NULL));
        uint32_t count = shell.source.order.count, kept = 0;
        struct sp_voxel_record *all = calloc(count, sizeof *all),
                               *some = calloc(count, sizeof *some);
        assert_non_null(all);
        assert_non_null(some);
        count = rig.kernels.set_up(&shell.source.frame, shell.source.from,
                                   shell.source.order.voxels, count, all);
        for (unsigned t = 0; t < sizeof closed; t++)
            closed[t] = t % 3 != 0;
        shell.source.frame.closed = closed;
        shell.source.frame.columns = SIDE / SP_VOXEL_TILE;
        uint32_t got =
            rig.kernels.set_up(&shell.source.frame, shell.source.from, shell.source.order.voxels,
                               shell.source.order.count, some);
        for (uint32_t i = 0; i < count; i++) {
            if (!touches_open(&shell.source.frame, &all[i]))
                continue;
            assert_true(kept < got);
            assert_memory_equal(&all[i], &some[kept++], sizeof *all);
        }
        assert_int_equal(kept, got);
        assert_in_range(kept, count / 8, count - count / 8);
        free(all);
        free(some);
        test_shell_close(&rig);
    }
}

static void test_cancel(void **state) {
    (void)state;
    struct test_shell rig;
    struct test_image image;
    struct sp_error err = { 0 };
    struct sp_voxel_layer shell;
    atomic_bool cancel = false;
    open_balls(&rig, (const double[3]){ 1, 1, 1 }, 2);
    draw(&rig, &image); /* the list is cached now */
    test_image_finish(&image);
    cancel = true;
    rig.input.interrupt.cancel = &cancel;
    assert_false(test_shell_draw(&rig, &image, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    assert_false(sp_voxel_prepare(test_shell_start(&rig, NULL), &shell, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    cancel = false;
    draw(&rig, &image);
    test_image_finish(&image);
    test_shell_close(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        one_thread_test(test_digital_surface),
        one_thread_test(test_hidden_voxels),
        one_thread_test(test_convergence),
        cmocka_unit_test(test_fragments),
        one_thread_test(test_fragments_in_fog),
        one_thread_test(test_instruction_sets),
        cmocka_unit_test(test_threads),
        one_thread_test(test_parts),
        one_thread_test(test_grids),
        one_thread_test(test_empty),
        one_thread_test(test_cut),
        one_thread_test(test_closed_tiles),
        cmocka_unit_test(test_cancel),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
