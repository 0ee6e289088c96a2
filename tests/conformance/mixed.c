/* SPDX-License-Identifier: Apache-2.0 */
#include "conformance/mixed.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "support/streaks.h"

enum { SIDE = TEST_MEDIUM_SIDE };
enum { VOLUME, VECTORS, TORUS, CUBE, GAUSSIANS, LAYERS };

static const char *const ids[3] = { "torus", "cube", "gaussians" };

/* A vortex about the middle of the volume, in a ball; other samples have no vector. */
static struct sp_volume *make_volume(const struct test_medium *medium) {
    const struct sp_grid *grid = &medium->grid;
    const uint32_t *dims = grid->dims;
    const double *middle = medium->view.camera.target;
    const size_t count = (size_t)dims[0] * dims[1] * dims[2];
    float(*vectors)[3] = calloc(count, sizeof *vectors);
    assert_non_null(vectors);
    for (size_t n = 0; n < count; n++) {
        const size_t at[3] = { n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1] };
        double p[3];
        for (int r = 0; r < 3; r++) {
            p[r] = grid->origin[r] - middle[r];
            for (int a = 0; a < 3; a++)
                p[r] += grid->direction[r][a] * grid->spacing[a] * (double)at[a];
        }
        if (test_dot(p, p) > 81 || (at[0] + at[1] + at[2]) % 2)
            continue;
        vectors[n][0] = (float)(-p[1] - 0.3);
        vectors[n][1] = (float)p[0];
        vectors[n][2] = 1.5f;
    }
    struct sp_volume *volume =
        sp_volume_create_vectors(grid, SP_FLOAT64, sp_volume_voxels(medium->volume),
                                 (const float(*)[3])(const void *)vectors, "medium", NULL);
    free(vectors);
    assert_non_null(volume);
    return volume;
}

static double random_in(unsigned *seed, double low, double high) {
    *seed = *seed * 1664525u + 1013904223u;
    return low + (high - low) * (*seed >> 8) / 16777216.0;
}

static void make_gaussians(struct mixed_frame *f) {
    float positions[MIXED_GAUSSIANS][3], factors[MIXED_GAUSSIANS][6];
    float opacities[MIXED_GAUSSIANS], harmonics[MIXED_GAUSSIANS * 3];
    const struct sp_elements elements = { .shape = { .kind = SP_KIND_GAUSSIANS,
                                                     .count = MIXED_GAUSSIANS },
                                          .positions = positions,
                                          .factors = factors,
                                          .opacities = opacities,
                                          .harmonics = harmonics };
    unsigned seed = 5;
    for (unsigned i = 0; i < MIXED_GAUSSIANS; i++) {
        struct test_gaussian *g = &f->gaussians[i];
        *g = (struct test_gaussian){ .opacity = random_in(&seed, 0.3, 0.95) };
        for (int a = 0; a < 3; a++) {
            g->position[a] = (float)random_in(&seed, -8, 8);
            g->scales[a] = exp(random_in(&seed, -0.7, 0.7));
            g->harmonics[0][a] = random_in(&seed, -1, 1);
        }
        for (int a = 0; a < 4; a++)
            g->rotation[a] = random_in(&seed, -1, 1);
        test_gaussian_store(g, &elements, i);
    }
    f->volumes[2] = sp_volume_create_elements(&elements, "gaussians", NULL);
}

static void add_layers(struct mixed_frame *f, const struct manifest_mixed *row) {
    static const enum sp_layer_type types[LAYERS] = { SP_LAYER_VOLUME, SP_LAYER_VECTORS,
                                                      SP_LAYER_GEOMETRY, SP_LAYER_GEOMETRY,
                                                      SP_LAYER_GAUSSIANS };
    static const double turn[9] = { 1, 0, 0, 0, 0.6, -0.8, 0, 0.8, 0.6 };
    struct sp_view *view = &f->medium.view;
    for (int i = 0; i < LAYERS; i++) {
        struct sp_layer *layer = &view->layers[i];
        *layer = sp_layer_default(types[i]);
        for (int r = 0; r < 3; r++) { /* elements lie about the middle of the volume */
            layer->transform[4 * r + 3] = view->camera.target[r];
            for (int a = 0; a < 3 && (i == TORUS || i == CUBE); a++)
                layer->transform[4 * r + a] = turn[3 * r + a];
        }
        if (i >= TORUS)
            strcpy(layer->id, ids[i - TORUS]);
    }
    view->layer_count = LAYERS;
    view->layers[VECTORS].style = row->style;
    view->layers[VECTORS].phase = 0.3;
    view->layers[VECTORS].stretch = 2;
    view->layers[VECTORS].density = row->style == SP_VECTORS_BLEND ? 0.1 : 0.4;
    view->layers[TORUS].opacity = 0.6f;
    view->layers[GAUSSIANS].opacity = 0.8f;
}

void mixed_open(struct mixed_frame *f, const struct manifest_mixed *row) {
    struct sp_view *view = &f->medium.view;
    memset(f, 0, sizeof *f);
    test_medium_init(&f->medium, row->projection);
    assert_non_null(f->medium.volume);
    struct sp_volume *volume = make_volume(&f->medium);
    sp_volume_unref(&f->medium.volume);
    f->medium.volume = volume;
    assert_true(test_mesh_torus(&f->torus, 20, 7, 2));
    assert_true(test_mesh_cube(&f->cube, 6));
    f->volumes[0] = sp_volume_create_elements(&f->torus, ids[0], NULL);
    f->volumes[1] = sp_volume_create_elements(&f->cube, ids[1], NULL);
    make_gaussians(f);
    assert_true(f->volumes[0] && f->volumes[1] && f->volumes[2]);
    add_layers(f, row);
    view->transfer_function.order = row->order;
    view->compositing.mode = row->compositing;
    view->compositing.slab = 2;
    view->camera.fov_y = 15; /* the elements fill the image */
    view->camera.height = 20;
    view->clip.box[0][0] = 0.3;
    view->clip.box[1][1] = 0.75;
    view->background[0] = 0.1f;
    view->background[3] = 1;
}

void mixed_close(struct mixed_frame *f) {
    for (int i = 0; i < 3; i++)
        sp_volume_unref(&f->volumes[i]);
    sp_volume_unref(&f->medium.volume);
    test_mesh_finish(&f->torus);
    test_mesh_finish(&f->cube);
}

struct sp_volume *mixed_find(void *user, const char *id) {
    const struct mixed_frame *f = user;
    for (int i = 0; i < 3; i++)
        if (strcmp(id, ids[i]) == 0)
            return sp_volume_ref(f->volumes[i]);
    return NULL;
}

/* Everything that the references need, and a list of hits. */
struct truth {
    const struct mixed_frame *frame;
    struct test_mesh_rays *meshes[2];
    struct test_trained *trained;
    struct test_streaks *streaks;
    struct test_hit *hits; /* hits of splats at the pixel's centre, then hits of a ray */
};

/* The Gaussians whose centres the clip box keeps. */
static struct test_trained *create_trained(const struct mixed_frame *f) {
    static struct test_gaussian kept[MIXED_GAUSSIANS];
    const struct sp_view *view = &f->medium.view;
    unsigned count = 0;
    for (unsigned i = 0; i < MIXED_GAUSSIANS; i++) {
        double from[3];
        bool is_inside = true;
        for (int r = 0; r < 3; r++)
            from[r] =
                f->gaussians[i].position[r] + view->camera.target[r] - f->medium.grid.origin[r];
        for (int a = 0; a < 3; a++) {
            double axis[3], range[2];
            test_medium_axis(&f->medium.grid, a, axis, range);
            const double share = (test_dot(axis, from) - range[0]) / (range[1] - range[0]);
            is_inside &= (view->clip.box[0][a] <= 0 || share >= view->clip.box[0][a]) &&
                         (view->clip.box[1][a] >= 1 || share <= view->clip.box[1][a]);
        }
        if (is_inside)
            kept[count++] = f->gaussians[i];
    }
    return test_trained_create(kept, count, 0, view, &view->layers[GAUSSIANS]);
}

static int compare_depths(const void *a, const void *b) {
    const double x = ((const struct test_hit *)a)->depth, y = ((const struct test_hit *)b)->depth;
    return (x > y) - (x < y);
}

/* Composites the hits and, between the depths `ends`, the medium; `slant`: length of a ray per
 * depth. */
static void composite(const struct test_medium *medium, const struct test_hit *hits, unsigned count,
                      const double ends[2], double slant, double weight, double rgb[3]) {
    double light = weight, at = ends[0];
    for (unsigned i = 0; i <= count; i++) {
        const double next = i < count ? fmin(fmax(hits[i].depth, ends[0]), ends[1]) : ends[1];
        const double pass = exp(-medium->sigma * slant * fmax(next - at, 0));
        for (int c = 0; c < 3; c++)
            rgb[c] += light * (1 - pass) * (double)test_medium_color[c];
        light *= pass;
        at = fmax(at, next);
        if (i == count)
            break;
        for (int c = 0; c < 3; c++)
            rgb[c] += light * hits[i].alpha * hits[i].color[c];
        light *= 1 - hits[i].alpha;
    }
    for (int c = 0; c < 3; c++)
        rgb[c] += light * (double)medium->view.background[c];
}

static void trace(struct truth *t, unsigned splats, double x, double y, double rgb[3]) {
    struct test_hit hits[2 * TEST_HITS_MAX + MIXED_GAUSSIANS + 4096];
    const struct sp_camera *camera = &t->frame->medium.view.camera;
    double from[3], along[3], ahead[3], ends[2] = { 0, 0 };
    unsigned count = splats;
    memcpy(hits, t->hits, splats * sizeof *hits);
    for (int i = 0; i < 2; i++)
        count += (unsigned)test_mesh_rays_hits(t->meshes[i], x, y, hits + count);
    qsort(hits, count, sizeof *hits, compare_depths);
    test_medium_ray(camera, x, y, from, along);
    for (int a = 0; a < 3; a++)
        ahead[a] = camera->target[a] - camera->position[a];
    const double cosine = test_dot(along, ahead) / sqrt(test_dot(ahead, ahead));
    if (!test_medium_cut(&t->frame->medium, from, along, true, ends))
        ends[0] = ends[1] = 0;
    for (int e = 0; e < 2; e++)
        ends[e] *= cosine;
    composite(&t->frame->medium, hits, count, ends, 1 / cosine, 1.0 / (MIXED_RAYS * MIXED_RAYS),
              rgb);
}

static void render_pixel(struct truth *t, unsigned x, unsigned y, double rgba[4]) {
    unsigned splats = test_trained_hits(t->trained, x + 0.5, y + 0.5, t->hits);
    splats += test_streaks_hits(t->streaks, x + 0.5, y + 0.5, t->hits + splats);
    assert_true(splats < MIXED_GAUSSIANS + 4096);
    for (int i = 0; i < 2; i++)
        test_mesh_rays_pixel(t->meshes[i], x, y);
    for (int j = 0; j < MIXED_RAYS; j++)
        for (int i = 0; i < MIXED_RAYS; i++)
            trace(t, splats, x + (i + 0.5) / MIXED_RAYS, y + (j + 0.5) / MIXED_RAYS, rgba);
    rgba[3] = 1;
}

bool mixed_truth(const struct mixed_frame *f, struct test_image *image) {
    const struct sp_view *view = &f->medium.view;
    struct truth t = { .frame = f };
    t.meshes[0] = test_mesh_rays_create(&f->torus, &view->layers[TORUS], view, &f->medium.grid);
    t.meshes[1] = test_mesh_rays_create(&f->cube, &view->layers[CUBE], view, &f->medium.grid);
    t.trained = create_trained(f);
    t.streaks = test_streaks_create(f->medium.volume, view, &view->layers[VECTORS], f->medium.sigma,
                                    test_medium_color);
    bool ok = t.meshes[0] && t.meshes[1] && t.trained && t.streaks;
    if (ok) {
        t.hits = malloc((MIXED_GAUSSIANS + test_streaks_count(t.streaks)) * sizeof *t.hits);
        ok = t.hits && test_image_init(image, SIDE, SIDE);
    }
    for (unsigned y = 0; ok && y < SIDE; y++)
        for (unsigned x = 0; x < SIDE; x++)
            render_pixel(&t, x, y, test_image_at(image, x, y));
    free(t.hits);
    for (int i = 0; i < 2; i++)
        test_mesh_rays_destroy(&t.meshes[i]);
    test_trained_destroy(&t.trained);
    if (t.streaks)
        test_streaks_destroy(&t.streaks);
    return ok;
}
