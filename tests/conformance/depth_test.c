/* SPDX-License-Identifier: Apache-2.0
 *
 * Depth and spread of a frame (sp/frame.h) against the colours of its own image. Everything in the
 * scene has a colour that tells its depth z: with v = (z − near)/length, red is v and green is v².
 * So the image is the reference: Σ T α v and Σ T α v² of each pixel, by whatever composites it.
 *
 * The value of the volume is v, so the transfer function gives its colours; surfaces lie at one
 * depth, and points, Gaussians and triangles have colours of their own. Projections are grey, and
 * have no spread.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sp/elements.h"
#include "sp/log.h"
#include "support/render.h"
#include "support/sample.h"
#include "support/sanitized.h"
#include "support/scene.h"
#include "support/trained.h"

enum { SAMPLES = 36, SIDE = 96, POINTS = 400, GAUSSIANS = 150, CELLS = 24, TARGETS_MAX = 16 };

/* How the opacity depends on the depth. */
enum matter { HAZE, WALL, TWO_WALLS };

enum { CUT = 1, SLICES = 2, LIT = 4 }; /* flags */

struct row {
    const char *name;
    enum sp_projection projection;
    enum matter matter;
    unsigned layers; /* bits by enum sp_layer_type */
    enum sp_compositing compositing;
    enum sp_tf_order order;
    enum sp_filter_mode filter;
    unsigned flags;
    /* Mean and largest difference [samples] of the depth, and mean difference of the spread: a
     * fifth above the measured values. */
    double most[3];
};

#define BIT(type) (1u << SP_LAYER_##type)
#define VOLUME BIT(VOLUME)
#define ALL_SPLATS BIT(SHELL) | BIT(VECTORS) | BIT(POINTS) | BIT(GAUSSIANS)

#define BOTH VOLUME | BIT(SURFACE)
#define CHANNELS VOLUME | BIT(CHANNEL)
#define SOME VOLUME | BIT(GEOMETRY) | BIT(POINTS)
#define MANY SOME | BIT(SURFACE)
#define ALL VOLUME | BIT(GEOMETRY) | ALL_SPLATS

#define P SP_PERSPECTIVE
#define O SP_ORTHOGRAPHIC
#define SHEET SP_COMPOSITE_SHEET
#define SLAB SP_COMPOSITE_SLAB
#define SPLAT SP_COMPOSITE_SPLAT
#define POST SP_TF_POST
#define PRE SP_TF_PRE
#define MOST SP_COMPOSITE_MAXIMUM
#define LEAST SP_COMPOSITE_MINIMUM
#define ADAPTIVE SP_FILTER_ADAPTIVE
#define EWA SP_FILTER_EWA
static const struct row rows[] = {
    /* Sheets of interpolated values. */
    { "haze", P, HAZE, VOLUME, SHEET, POST, ADAPTIVE, CUT, { 0.010, 0.02, 0.010 } },
    { "haze flat", O, HAZE, VOLUME, SHEET, POST, ADAPTIVE, CUT, { 0.010, 0.02, 0.026 } },
    { "wall", P, WALL, VOLUME, SHEET, POST, ADAPTIVE, CUT, { 0.232, 0.47, 0.042 } },
    { "walls", P, TWO_WALLS, VOLUME, SHEET, POST, ADAPTIVE, CUT, { 0.171, 0.47, 0.094 } },
    { "walls slab", P, TWO_WALLS, VOLUME, SLAB, POST, ADAPTIVE, CUT, { 0.076, 0.26, 0.045 } },
    { "haze lit", P, HAZE, VOLUME, SHEET, POST, ADAPTIVE, CUT | LIT, { 0.010, 0.02, 0.011 } },
    { "walls lit", P, TWO_WALLS, VOLUME, SHEET, POST, ADAPTIVE, CUT | LIT, { 0.094, 0.30, 0.070 } },
    { "maximum", P, HAZE, VOLUME, MOST, POST, ADAPTIVE, CUT, { 0.010, 0.02, 0.010 } },
    { "minimum", O, HAZE, VOLUME, LEAST, POST, ADAPTIVE, CUT, { 0.010, 0.02, 0.010 } },
    { "channel", P, HAZE, CHANNELS, SHEET, POST, ADAPTIVE, CUT, { 0.010, 0.03, 0.084 } },
    { "slices", P, HAZE, VOLUME, SHEET, POST, ADAPTIVE, SLICES, { 0.010, 0.27, 0.014 } },
    { "slices flat", O, TWO_WALLS, VOLUME, SHEET, POST, ADAPTIVE, SLICES, { 0.316, 0.57, 0.148 } },
    /* Classified voxels: post-convolved, or footprints. */
    { "haze pre", P, HAZE, VOLUME, SHEET, PRE, ADAPTIVE, 0, { 0.060, 0.62, 0.054 } },
    { "walls pre", P, TWO_WALLS, VOLUME, SHEET, PRE, EWA, 0, { 0.308, 1.48, 0.183 } },
    { "haze pre flat", O, HAZE, VOLUME, SHEET, PRE, EWA, 0, { 0.068, 0.39, 0.078 } },
    { "haze pre cut", P, HAZE, VOLUME, SHEET, PRE, EWA, CUT, { 0.023, 0.26, 0.054 } },
    { "slabs pre", P, HAZE, VOLUME, SLAB, PRE, EWA, CUT, { 0.028, 0.39, 0.063 } },
    { "slabs pre flat", O, HAZE, VOLUME, SLAB, PRE, EWA, CUT, { 0.044, 0.24, 0.023 } },
    { "slabs of values", P, HAZE, VOLUME, SLAB, POST, EWA, CUT, { 0.028, 0.39, 0.036 } },
    { "splats", P, TWO_WALLS, VOLUME, SPLAT, PRE, EWA, CUT, { 0.045, 0.38, 0.027 } },
    { "splats flat", O, HAZE, VOLUME, SPLAT, PRE, EWA, CUT, { 0.010, 0.02, 0.010 } },
    /* Layers alone. */
    { "surface", P, HAZE, BIT(SURFACE), SHEET, POST, ADAPTIVE, 0, { 0.010, 0.02, 0.010 } },
    { "shell", P, WALL, BIT(SHELL), SHEET, POST, ADAPTIVE, 0, { 0.010, 0.02, 0.016 } },
    { "vectors", P, HAZE, BIT(VECTORS), SHEET, POST, ADAPTIVE, 0, { 0.010, 0.02, 0.010 } },
    { "points", P, HAZE, BIT(POINTS), SHEET, POST, ADAPTIVE, 0, { 0.010, 0.02, 0.010 } },
    { "gaussians", O, HAZE, BIT(GAUSSIANS), SHEET, POST, ADAPTIVE, 0, { 0.010, 0.02, 0.010 } },
    { "triangles", P, HAZE, BIT(GEOMETRY), SHEET, POST, ADAPTIVE, 0, { 0.010, 0.02, 0.152 } },
    /* Several layers, without and with the volume. */
    { "all splats", P, WALL, ALL_SPLATS, SHEET, POST, ADAPTIVE, 0, { 0.010, 0.02, 0.090 } },
    { "surface in haze", P, HAZE, BOTH, SHEET, POST, ADAPTIVE, CUT, { 0.010, 0.02, 0.010 } },
    { "all in sheets", P, HAZE, ALL, SHEET, POST, ADAPTIVE, CUT, { 0.012, 0.09, 0.093 } },
    { "all in slices", P, HAZE, SOME, SHEET, POST, ADAPTIVE, SLICES, { 0.010, 0.27, 0.046 } },
    { "all in voxels", P, HAZE, ALL, SHEET, PRE, ADAPTIVE, 0, { 0.042, 0.30, 0.077 } },
    { "all in slabs", P, HAZE, MANY, SLAB, PRE, EWA, CUT, { 0.048, 0.41, 0.090 } },
    { "all in splats", O, HAZE, MANY, SPLAT, PRE, EWA, CUT, { 0.058, 0.46, 0.065 } },
};

/* The scene of a row. */
struct setting {
    struct test_scene scene;
    double eye[3], forward[3], near, length;
    struct sp_volume *volume, *channel, *elements[3]; /* points, Gaussians, triangles */
};

static const char *const ids[4] = { "points", "gaussians", "triangles", "channel" };

/* v of a point. */
static double place_of(const struct setting *s, const double world[3]) {
    double z = 0;
    for (int r = 0; r < 3; r++)
        z += s->forward[r] * (world[r] - s->eye[r]);
    return (z - s->near) / s->length;
}

static void set_transfer_function(struct setting *s, enum matter matter) {
    struct sp_transfer_function *tf = &s->scene.view.transfer_function;
    tf->point_count = SP_TF_POINTS_MAX;
    for (uint32_t i = 0; i < tf->point_count; i++) {
        const double v = i / (SP_TF_POINTS_MAX - 1.0);
        const bool is_thin = fabs(v - 0.35)<0.02, is_solid = v> 0.6;
        const double opacity = matter == HAZE   ? 0.05
                               : matter == WALL ? (v > 0.45 ? 0.9 : 0)
                               : is_thin        ? 0.1
                               : is_solid       ? 0.95
                                                : 0;
        tf->points[i] = (struct sp_tf_point){ .value = v,
                                              .color = { (float)v, (float)(v * v), 0 },
                                              .opacity = (float)opacity };
    }
}

static bool make_volume(struct setting *s) {
    struct test_scene *scene = &s->scene;
    const uint32_t *dims = scene->info.grid.dims;
    float *voxels = scene->voxels;
    float(*vectors)[3] = malloc((size_t)dims[0] * dims[1] * dims[2] * sizeof *vectors);
    struct sp_error err;
    if (!vectors)
        return false;
    for (uint32_t k = 0; k < dims[2]; k++)
        for (uint32_t j = 0; j < dims[1]; j++)
            for (uint32_t i = 0; i < dims[0]; i++) {
                const uint32_t at[3] = { i, j, k };
                const size_t n = test_sample_index(&scene->info.grid, at);
                double world[3];
                test_sample_place(&scene->info.grid, at, world);
                voxels[n] = (float)place_of(s, world);
                for (int r = 0; r < 3; r++)
                    vectors[n][r] = r == 1 ? 1 : 0.3f;
            }
    s->volume = sp_volume_create_vectors(&scene->info.grid, SP_FLOAT32, voxels,
                                         (const float(*)[3])(const void *)vectors, "depth", &err);
    s->channel = sp_volume_create(&scene->info.grid, SP_FLOAT32, voxels, "channel", &err);
    free(vectors);
    return s->volume && s->channel;
}

/* make_volume() sets the values. */
static double no_value(const void *user, double x, double y, double z) {
    (void)user;
    return 0 * (x + y + z);
}

static double random_in(unsigned *seed, double low, double high) {
    *seed = *seed * 1664525u + 1013904223u;
    return low + (high - low) * (*seed >> 8) / 16777216.0;
}

static bool make_points(struct setting *s) {
    float positions[POINTS][3], factors[POINTS][6] = { { 0 } }, values[POINTS], volumes[POINTS];
    const struct sp_elements elements = { .shape = { .kind = SP_KIND_POINTS, .count = POINTS },
                                          .positions = positions,
                                          .factors = factors,
                                          .values = values,
                                          .volumes = volumes };
    struct sp_error err;
    unsigned seed = 7;
    for (unsigned i = 0; i < POINTS; i++) {
        double world[3];
        for (int r = 0; r < 3; r++)
            positions[i][r] = (float)(world[r] = random_in(&seed, -14, 14));
        factors[i][0] = factors[i][2] = factors[i][5] = 0.8f;
        values[i] = (float)place_of(s, world);
        volumes[i] = 60;
    }
    return (s->elements[0] = sp_volume_create_elements(&elements, ids[0], &err));
}

static bool make_gaussians(struct setting *s) {
    static const double harmonic = 0.28209479177387814; /* of degree 0 */
    float positions[GAUSSIANS][3], factors[GAUSSIANS][6], opacities[GAUSSIANS];
    float harmonics[GAUSSIANS * 3];
    const struct sp_elements elements = { .shape = { .kind = SP_KIND_GAUSSIANS,
                                                     .count = GAUSSIANS },
                                          .positions = positions,
                                          .factors = factors,
                                          .opacities = opacities,
                                          .harmonics = harmonics };
    struct sp_error err;
    unsigned seed = 5;
    for (unsigned i = 0; i < GAUSSIANS; i++) {
        struct test_gaussian g = { .opacity = random_in(&seed, 0.3, 0.9), .rotation = { 1 } };
        double world[3];
        for (int r = 0; r < 3; r++) {
            g.position[r] = (float)(world[r] = random_in(&seed, -14, 14));
            g.scales[r] = 0.8;
        }
        const double v = place_of(s, world);
        g.harmonics[0][0] = (v - 0.5) / harmonic;
        g.harmonics[0][1] = (v * v - 0.5) / harmonic;
        g.harmonics[0][2] = -0.5 / harmonic;
        test_gaussian_store(&g, &elements, i);
    }
    return (s->elements[1] = sp_volume_create_elements(&elements, ids[1], &err));
}

/* Two bent sheets of small triangles, one behind the other. */
static bool make_triangles(struct setting *s) {
    enum { ACROSS = CELLS + 1, VERTICES = ACROSS * ACROSS, SHEETS = 2 };
    static float positions[SHEETS * VERTICES][3], colors[SHEETS * VERTICES][4];
    static uint32_t triangles[SHEETS * CELLS * CELLS * 2][3];
    const struct sp_elements elements = { .shape = { .kind = SP_KIND_MESH,
                                                     .count = SHEETS * CELLS * CELLS * 2,
                                                     .vertex_count = SHEETS * VERTICES },
                                          .positions = positions,
                                          .colors = colors,
                                          .normals =
                                              calloc(SHEETS * VERTICES, sizeof *elements.normals),
                                          .triangles = triangles };
    struct sp_error err;
    uint32_t n = 0;
    if (!elements.normals)
        return false;
    for (uint32_t i = 0; i < SHEETS * VERTICES; i++) {
        const double x = i % ACROSS * 24.0 / CELLS - 12,
                     y = i / ACROSS % ACROSS * 24.0 / CELLS - 12;
        const double world[3] = { x, y, (i < VERTICES ? -6 : 5) + 0.02 * x * y };
        const double v = place_of(s, world);
        for (int r = 0; r < 3; r++)
            positions[i][r] = (float)world[r];
        memcpy(colors[i], (const float[4]){ (float)v, (float)(v * v), 0, 0.5f }, sizeof colors[i]);
    }
    for (uint32_t i = 0; i < SHEETS * CELLS * CELLS; i++) {
        const uint32_t sheet = i / (CELLS * CELLS), cell = i % (CELLS * CELLS);
        const uint32_t at = sheet * VERTICES + cell / CELLS * ACROSS + cell % CELLS;
        memcpy(triangles[n++], (const uint32_t[3]){ at, at + 1, at + ACROSS }, 12);
        memcpy(triangles[n++], (const uint32_t[3]){ at + 1, at + ACROSS + 1, at + ACROSS }, 12);
    }
    s->elements[2] = sp_volume_create_elements(&elements, ids[2], &err);
    free(elements.normals);
    return s->elements[2];
}

static struct sp_volume *find_volume(void *user, const char *id) {
    const struct setting *s = user;
    for (int i = 0; i < 3; i++)
        if (strcmp(id, ids[i]) == 0)
            return sp_volume_ref(s->elements[i]);
    return strcmp(id, ids[3]) == 0 ? sp_volume_ref(s->channel) : NULL;
}

static void add_layers(struct setting *s, unsigned layers) {
    struct sp_view *view = &s->scene.view;
    view->layer_count = 0;
    for (int type = 0; type < SP_LAYER_TYPES; type++) {
        struct sp_layer *layer = &view->layers[view->layer_count];
        if (!(layers >> type & 1))
            continue;
        *layer = sp_layer_default((enum sp_layer_type)type);
        layer->opacity = type == SP_LAYER_SURFACE ? 0.6f : 1;
        layer->value = 0.4;
        layer->color[0] = 0.4f;
        layer->color[1] = 0.16f;
        layer->color[2] = 0;
        layer->density = 0.3;
        if (type >= SP_LAYER_POINTS && type <= SP_LAYER_CHANNEL)
            strcpy(layer->id, ids[type - SP_LAYER_POINTS]);
        if (type == SP_LAYER_CHANNEL) {
            layer->point_count = SP_CHANNEL_POINTS_MAX;
            for (uint32_t i = 0; i < layer->point_count; i++) {
                const float v = (float)i / (SP_CHANNEL_POINTS_MAX - 1);
                layer->points[i] =
                    (struct sp_tf_point){ (double)v, { v, v * v, 0 }, v > 0.5f ? 0.1f : 0.03f };
            }
        }
        view->layer_count++;
    }
}

static bool open_setting(const struct row *row, struct setting *s) {
    const uint32_t dims[3] = { SAMPLES, SAMPLES, SAMPLES };
    const double unit[3] = { 1, 1, 1 };
    struct sp_view *view = &s->scene.view;
    double w[3][3];
    memset(s, 0, sizeof *s);
    test_view_init(view);
    if (!test_scene_voxels(&s->scene, "depth", dims, unit, SP_FLOAT32, no_value, NULL))
        return false;
    test_scene_direction(&s->scene, (const double[3]){ 10, 20, 5 }, 1, 0);
    test_scene_orbit(&s->scene, NULL, 32, 21, 70);
    view->camera.projection = row->projection;
    view->camera.fov_y = 36;
    view->camera.height = 46;
    view->size[0] = view->size[1] = SIDE;
    test_camera_axes(&view->camera, w);
    memcpy(s->forward, w[2], sizeof s->forward);
    memcpy(s->eye, view->camera.position, sizeof s->eye);
    s->near = 34; /* the volume lies between 34 and 106 */
    s->length = 72;
    set_transfer_function(s, row->matter);
    add_layers(s, row->layers);
    view->transfer_function.order = row->order;
    view->compositing.mode = row->compositing;
    view->compositing.center = 0.5;
    view->compositing.width = 1;
    view->filter.mode = row->filter;
    view->level_of_detail = SP_LOD_OFF;
    for (int a = 0; (row->flags & CUT) && a < 3; a++) { /* values hold beyond the last samples */
        view->clip.box[0][a] = 0.06;
        view->clip.box[1][a] = 0.94;
    }
    if (row->flags & LIT) { /* colours stay as they are */
        view->shading.mode = SP_SHADING_PHONG;
        view->shading.ambient = 1;
        view->shading.diffuse = view->shading.specular = 0;
    }
    view->slices.mode = row->flags & SLICES ? SP_SLICES_ORTHOGONAL : SP_SLICES_NONE;
    view->slices.in_3d = row->flags & SLICES;
    view->slices.colors = SP_SLICE_TRANSFER_FUNCTION;
    view->slices.planes[2] = false;
    return make_volume(s) && make_points(s) && make_gaussians(s) && make_triangles(s);
}

static void close_setting(struct setting *s) {
    for (int i = 0; i < 3; i++)
        sp_volume_unref(&s->elements[i]);
    sp_volume_unref(&s->volume);
    sp_volume_unref(&s->channel);
    test_scene_finish(&s->scene);
}

static struct sp_frame *render(const struct test_renderer *r, const struct setting *s,
                               bool wants_depth, enum sp_pixel_format format,
                               struct sp_error *err) {
    const struct sp_render_options options = { .format = format,
                                               .wants_depth = wants_depth,
                                               .find = find_volume,
                                               .user = (void *)(uintptr_t)s };
    return sp_renderer_render(r->renderer, s->volume, &s->scene.view, r->pool, &options, err);
}

static const float *row_of(const struct sp_frame *frame, const float *plane, uint32_t y) {
    return (const float *)(const void *)((const char *)plane + y * frame->depth_stride_bytes);
}

struct errors {
    double mean, largest, spread;
    unsigned count, wrong; /* pixels compared; pixels that have a depth and should not, or v. v. */
};

/* Compares depth and spread with the colours of the frame. */
static struct errors compare(const struct setting *s, const struct sp_frame *frame) {
    const double clear = 0.1; /* opacity of pixels that are compared */
    struct errors e = { 0 };
    for (uint32_t y = 0; y < frame->height; y++)
        for (uint32_t x = 0; x < frame->width; x++) {
            const float *px = (const float *)(const void *)((const char *)frame->pixels +
                                                            y * frame->stride_bytes) +
                              4 * (size_t)x;
            const double alpha = (double)px[3], depth = (double)row_of(frame, frame->depth, y)[x];
            const double spread = (double)row_of(frame, frame->spread, y)[x];
            const double least = (double)SP_DEPTH_ALPHA_MIN;
            e.wrong += (alpha > 1.01 * least && !isfinite(depth)) ||
                       (alpha < 0.99 * least && (depth != INFINITY || spread != 0)) ||
                       !(spread >= 0);
            if (!(alpha >= clear))
                continue;
            const double v = (double)px[0] / alpha, square = (double)px[1] / alpha;
            const bool is_value = sp_compositing_is_projection(s->scene.view.compositing.mode);
            const double wanted = is_value ? 0 : sqrt(fmax(square - v * v, 0)) * s->length;
            const double off = fabs(depth - (s->near + v * s->length));
            e.largest = fmax(e.largest, off);
            e.mean += off;
            e.spread += fabs(spread - wanted);
            e.count++;
        }
    e.mean /= fmax(e.count, 1);
    e.spread /= fmax(e.count, 1);
    return e;
}

static bool depths_equal(const struct sp_frame *a, const struct sp_frame *b) {
    for (uint32_t y = 0; y < a->height; y++)
        if (memcmp(row_of(a, a->depth, y), row_of(b, b->depth, y), a->width * sizeof(float)) ||
            memcmp(row_of(a, a->spread, y), row_of(b, b->spread, y), a->width * sizeof(float)))
            return false;
    return true;
}

/* The pixels do not depend on the depth. `with`: a frame with depth. */
static bool keeps_pixels(const struct test_renderer *r, const struct setting *s,
                         const struct sp_frame *with) {
    struct sp_error err;
    struct sp_frame *without = with ? render(r, s, false, with->format, &err) : NULL;
    const bool same = without && !without->depth && test_frames_equal(with, without);
    sp_frame_unref(&without);
    return same;
}

static bool keeps_bytes(const struct test_renderer *r, const struct setting *s) {
    struct sp_error err;
    struct sp_frame *with = render(r, s, true, SP_RGBA8, &err);
    const bool same = keeps_pixels(r, s, with);
    sp_frame_unref(&with);
    return same;
}

struct run {
    struct test_target targets[TARGETS_MAX];
    struct test_renderer renderers[TARGETS_MAX];
    struct test_renderer threads; /* the last CPU target with several threads */
    unsigned count, cpu;          /* targets; of the CPU, which come first */
};

/* Does the GPU backend compute depth for the row? sp/renderer.h */
static bool is_on_gpu(const struct row *row) {
    return row->order == POST && row->filter == ADAPTIVE && (row->layers & VOLUME) &&
           !(row->layers & BIT(CHANNEL)) && !sp_compositing_is_projection(row->compositing);
}

/* Returns the number of targets that fail. */
static unsigned check_row(const struct run *run, const struct row *row) {
    struct setting s;
    unsigned failed = 0;
    if (!open_setting(row, &s)) {
        printf("%s: out of memory\n", row->name);
        return 1;
    }
    printf("%-18s", row->name);
    for (unsigned t = 0; t < run->count; t++) {
        struct sp_error err = { .code = SP_OK };
        if (t >= run->cpu && !is_on_gpu(row))
            continue;
        if (TEST_SANITIZED && t >= run->cpu && __builtin_popcount(row->layers) > 3)
            continue; /* software GL takes far longer for them */
        if (TEST_SANITIZED && t > 0 && t + 1 < run->cpu)
            continue; /* the same code, compiled for other instruction sets */
        struct sp_frame *frame = render(&run->renderers[t], &s, true, SP_RGBAF32, &err);
        if (!frame || !frame->depth) {
            printf("  %s: no depth: %s", run->targets[t].isa, frame ? "" : err.text);
            failed++;
            sp_frame_unref(&frame);
            continue;
        }
        const struct errors e = compare(&s, frame);
        bool ok = e.mean <= row->most[0] && e.largest <= row->most[1] && e.spread <= row->most[2] &&
                  e.wrong == 0 && e.count >= 500;
        if (!keeps_pixels(&run->renderers[t], &s, frame) ||
            (t + 1 == run->cpu && !keeps_bytes(&run->renderers[t], &s))) {
            printf(" pixels differ");
            ok = false;
        }
        if (t + 1 == run->cpu) {
            struct sp_frame *other = render(&run->threads, &s, true, SP_RGBAF32, &err);
            if (!other || !depths_equal(frame, other)) {
                printf(" threads differ");
                ok = false;
            }
            sp_frame_unref(&other);
        }
        printf("  %s %.3f %.2f %.3f", run->targets[t].isa, e.mean, e.largest, e.spread);
        if (e.wrong || e.count < 500)
            printf(" (%u of %u)", e.wrong, e.count);
        printf(ok ? "" : " FAILED");
        failed += !ok;
        sp_frame_unref(&frame);
    }
    printf("\n");
    close_setting(&s);
    return failed;
}

static bool open_all(struct run *run) {
    struct test_target target;
    struct sp_error err;
    for (unsigned t = 0; run->count < TARGETS_MAX && test_target_at(t, &target); t++) {
        struct sp_renderer_info info = { .has_depth = false };
        struct test_renderer *r = &run->renderers[run->count];
        if (!test_renderer_open(r, &target, 1, &err)) {
            printf("skipped: %s %s: %s\n", target.backend, target.isa, err.text);
            continue;
        }
        sp_renderer_info(r->renderer, &info);
        if (!info.has_depth) {
            printf("skipped: %s has no depth\n", target.backend);
            test_renderer_close(r);
            continue;
        }
        run->targets[run->count++] = target;
        run->cpu += strcmp(target.backend, "cpu") == 0;
    }
    return run->cpu > 0 && test_renderer_open(&run->threads, &run->targets[run->cpu - 1], 3, &err);
}

int main(int argc, char **argv) {
    struct run run = { .count = 0 };
    unsigned failed = 0;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    if (!open_all(&run)) {
        printf("FAILED: the CPU backend does not start\n");
        return 1;
    }
    printf("Differences [samples]: depth mean, largest; spread mean\n");
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        if (argc < 2 || strcmp(argv[1], rows[i].name) == 0)
            failed += check_row(&run, &rows[i]);
    for (unsigned t = 0; t < run.count; t++)
        test_renderer_close(&run.renderers[t]);
    test_renderer_close(&run.threads);
    if (failed)
        printf("%u images FAILED\n", failed);
    return failed > 0;
}
