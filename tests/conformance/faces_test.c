/* SPDX-License-Identifier: Apache-2.0
 *
 * The outlines of the volume's box, of the clip box and of clip planes in matter: every backend and
 * instruction set against means of 16 × 16 rays per pixel through the same block. With one ray per
 * pixel the outlines are jagged; with coverage (draw/resample/silhouette.h) they are smooth. A
 * sanitizer build draws 8 × 8 rays per pixel and has the same floors.
 * Samples are wide enough that the low-pass filter of pixels (frame/antialias.h) is off.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "sp/log.h"
#include "support/mesh.h"
#include "support/render.h"
#include "support/sanitized.h"

enum {
    SIDE = 24,
    PIXELS = 112,
    RAYS = TEST_SANITIZED ? 8 : 16,
    LIT = 1,
    FLAT = 2,
    BOX = 4,
    PLANE = 8,
    SURFACE = 16,
    INSIDE = 32,
    THIN = 64,
    MAXIMUM = 128,
    SLICES = 256,
    MESH = 512
};

struct row {
    const char *name;
    double opacity; /* of a sample */
    int what;       /* FLAT: orthographic; THIN: between two planes, narrower than a pixel */
    double floor;   /* PSNR to the means, dB */
    double gain;    /* over one ray per pixel, at least, dB */
};

static const struct row rows[] = {
    { "opaque", 0.97, FLAT, 47.6, 8.0 },
    { "opaque, perspective", 0.97, 0, 46.5, 6.0 },
    { "half transparent", 0.04, 0, 79.3, 6.3 },
    { "opaque, lit, oblique plane", 0.97, LIT | PLANE, 45.4, 4.5 },
    { "half transparent, lit, oblique plane", 0.04, FLAT | LIT | PLANE, 69.7, 3.4 },
    { "opaque, clip box and plane", 0.97, BOX | PLANE, 48.9, 9.1 },
    { "half transparent, clip box", 0.04, BOX, 79.0, 5.0 },
    { "surface in it, clip box", 0.5, LIT | BOX | SURFACE, 46.5, 0.1 },
    { "opaque, in a mesh", 0.97, MESH, 44.8, 1.5 },
    { "from inside, oblique plane", 0.3, INSIDE | PLANE, 58.0, 5.9 },
    { "thin", 0.97, FLAT | THIN, 48.9, 10.5 },
    { "slices, one edge on", 0.97, FLAT | SLICES, 44.0, 2.4 },
    { "maximum, clip box", 0.97, BOX | MAXIMUM, 69.5, 15.3 },
};

/* Falls from the middle outwards. */
static double field(const void *user, double x, double y, double z) {
    const double c = (SIDE - 1) / 2.0, a = x - c, b = y - c, d = z - c;
    (void)user;
    return 230 - 5 * sqrt(a * a + b * b + d * d);
}

static void place_camera(const struct row *row, struct sp_camera *camera) {
    camera->projection = row->what & FLAT ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
    camera->height = 1.6 * SIDE;
    camera->fov_y = row->what & INSIDE ? 60 : 29;
    if (row->what & INSIDE)
        for (int a = 0; a < 3; a++)
            camera->position[a] *= 0.1;
}

static bool make(const struct row *row, struct test_scene *scene) {
    const double opacity = row->opacity;
    const double points[][5] = { { 100, 0.9, 0.3, 0.1, opacity }, { 230, 0.3, 0.7, 1, opacity } };
    const double normal[3] = { 0.5, 0.3, -0.4 };
    struct sp_view *view = &scene->view;
    test_view_init(view);
    test_scene_points(scene, points, 2);
    if (!test_scene_voxels(scene, "block", (uint32_t[]){ SIDE, SIDE, SIDE }, (double[]){ 1, 1, 1 },
                           SP_UINT8, field, NULL))
        return false;
    test_scene_orbit(scene, NULL, 33, 22, 80);
    place_camera(row, &view->camera);
    view->background[3] = 1;
    view->compositing.mode = row->what & MAXIMUM ? SP_COMPOSITE_MAXIMUM : SP_COMPOSITE_SHEET;
    view->transfer_function.order = SP_TF_POST;
    view->shading.mode = row->what & LIT ? SP_SHADING_PHONG : SP_SHADING_NONE;
    for (int a = 0; a < 3 && row->what & BOX; a++) {
        view->clip.box[0][a] = 0.07 + 0.04 * a;
        view->clip.box[1][a] = 0.96 - 0.07 * a;
    }
    if (row->what & PLANE)
        test_scene_cut(scene, normal, (double[]){ 2, 1, 0 });
    if (row->what & THIN) {
        test_scene_cut(scene, (double[]){ 0.1, 1, 0.05 }, (double[]){ 0, 0, 0 });
        test_scene_cut(scene, (double[]){ -0.1, -1, -0.05 }, (double[]){ 0, 0.3, 0 });
        view->camera.position[1] = 0;
    }
    if (row->what & SLICES) {
        test_scene_orbit(scene, NULL, 0, 22, 80);
        view->slices.mode = SP_SLICES_ORTHOGONAL;
        view->slices.in_3d = true;
        view->slices.planes[0] = view->slices.planes[1] = true;
        view->slices.normal[2] = 1;
        view->slices.position[0] = 0.2;
        view->slices.center = 150;
        view->slices.width = 100;
    }
    if (row->what & SURFACE) {
        struct sp_layer *layer = &view->layers[view->layer_count++];
        *layer = sp_layer_default(SP_LAYER_SURFACE);
        layer->value = 160;
    }
    return true;
}

/* A square across z through the block, and wider than the block. */
static struct sp_volume *make_square(struct sp_error *err) {
    struct sp_elements mesh;
    if (!test_mesh_init(&mesh, 4, 2))
        return NULL;
    for (int k = 0; k < 4; k++) {
        mesh.positions[k][0] = k & 1 ? 2 * SIDE : -2 * SIDE;
        mesh.positions[k][1] = k & 2 ? 2 * SIDE : -2 * SIDE;
        mesh.positions[k][2] = 1;
        mesh.colors[k][2] = 0.2f;
    }
    memcpy(mesh.triangles[0], (uint32_t[]){ 0, 1, 3 }, sizeof mesh.triangles[0]);
    memcpy(mesh.triangles[1], (uint32_t[]){ 0, 3, 2 }, sizeof mesh.triangles[1]);
    struct sp_volume *volume = sp_volume_create_elements(&mesh, "square", err);
    test_mesh_finish(&mesh);
    return volume;
}

static struct sp_volume *find_square(void *user, const char *id) {
    (void)id;
    return sp_volume_ref(user);
}

/* Draws the block with the square. */
static bool draw_with_square(const struct test_renderer *renderer, struct test_scene *scene,
                             struct test_image *image, struct sp_error *err) {
    struct sp_layer *layer = &scene->view.layers[scene->view.layer_count++];
    struct sp_volume *square = make_square(err), *block = test_scene_volume(scene, err);
    const struct sp_render_options options = { .format = SP_RGBAF32,
                                               .find = find_square,
                                               .user = square };
    *layer = sp_layer_default(SP_LAYER_GEOMETRY);
    snprintf(layer->id, sizeof layer->id, "square");
    struct sp_frame *frame = NULL;
    if (square && block)
        frame = sp_renderer_render(renderer->renderer, block, &scene->view, renderer->pool,
                                   &options, err);
    const bool ok = frame && test_image_from_frame(image, frame);
    sp_frame_unref(&frame);
    if (block)
        sp_renderer_evict(renderer->renderer, block);
    if (square)
        sp_renderer_evict(renderer->renderer, square);
    sp_volume_unref(&block);
    sp_volume_unref(&square);
    return ok;
}

static bool draw(const struct test_renderer *renderer, const struct row *row, unsigned side,
                 enum sp_lod lod, struct test_image *image) {
    struct sp_error err = { .text = "out of memory" };
    struct test_scene scene;
    if (!make(row, &scene))
        return false;
    scene.view.size[0] = scene.view.size[1] = side;
    scene.view.level_of_detail = lod;
    const bool ok = row->what & MESH ? draw_with_square(renderer, &scene, image, &err)
                                     : test_render_scene(renderer, &scene, image, &err);
    if (!ok)
        printf(" %s", err.text);
    test_scene_finish(&scene);
    return ok;
}

/* The means of 16 × 16 rays, by the CPU. */
static bool draw_mean(const struct row *row, struct test_image *mean) {
    const struct test_target target = { "cpu", "auto" };
    struct test_renderer renderer;
    struct test_image fine;
    struct sp_error err;
    if (!test_image_init(mean, PIXELS, PIXELS) || !test_renderer_open(&renderer, &target, 1, &err))
        return false;
    const bool ok = draw(&renderer, row, RAYS * PIXELS, SP_LOD_OFF, &fine);
    test_renderer_close(&renderer);
    for (unsigned y = 0; ok && y < fine.height; y++)
        for (unsigned x = 0; x < fine.width; x++)
            for (int c = 0; c < 4; c++)
                test_image_at(mean, x / RAYS, y / RAYS)[c] +=
                    test_image_at(&fine, x, y)[c] / (RAYS * RAYS);
    if (ok)
        test_image_finish(&fine);
    return ok;
}

static struct test_image means[sizeof rows / sizeof rows[0]];

static unsigned check_target(const struct test_target *target,
                             const struct test_renderer *renderer) {
    unsigned failed = 0;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        const struct row *row = &rows[i];
        struct test_image smooth, jagged;
        printf("%s %s, %s:", target->backend, target->isa, row->name);
        if (!draw(renderer, row, PIXELS, SP_LOD_AUTO, &smooth) ||
            !draw(renderer, row, PIXELS, SP_LOD_OFF, &jagged)) {
            printf(" FAILED\n");
            return failed + 1;
        }
        const double db = test_image_psnr(&smooth, &means[i]);
        const double before = test_image_psnr(&jagged, &means[i]);
        const bool is_good = db >= row->floor && db >= before + row->gain;
        printf(" %.1f dB, one ray per pixel %.1f%s\n", db, before, is_good ? "" : " FAILED");
        failed += !is_good;
        test_image_finish(&smooth);
        test_image_finish(&jagged);
    }
    return failed;
}

int main(void) {
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        if (!draw_mean(&rows[i], &means[i])) {
            printf("the means of row %s FAILED\n", rows[i].name);
            return 1;
        }
    const unsigned failed = test_check_targets(1, check_target);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        test_image_finish(&means[i]);
    return failed > 0;
}
