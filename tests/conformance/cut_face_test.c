/* SPDX-License-Identifier: Apache-2.0
 *
 * Light of faces that clipping cuts into a volume (draw/resample/cut_face.h). The volume is opaque
 * and has a little noise, so its gradients have any direction. A cut through it is lit by
 * Blinn-Phong for the normal of the plane: the whole face has the colour of a closed form. Where a
 * cut goes through transparent material, it changes nothing.
 */
#include <math.h>
#include <stdio.h>

#include "sp/log.h"
#include "support/render.h"

enum { SIDE = 40, PIXELS = 96 };

static const double middle = (SIDE - 1) / 2.0;

struct row {
    const char *name;
    double normal[3]; /* of the plane through the middle; 0 = the clip box cuts the face z = 0.35 */
    double opacity;   /* of a sample */
    double share;     /* of the noise, of the whole range */
    bool is_perspective;
    double most, rms; /* differences: half a decibel above the measured value, or rounding */
};

static const struct row rows[] = {
    { "oblique plane", { 0.3, 0.2, 0.93 }, 0.95, 0.02, false, 0.0003, 0.00003 },
    { "steep plane", { -0.5, 0.45, 0.74 }, 0.95, 0.02, false, 0.0003, 0.00003 },
    { "perspective", { 0.25, -0.4, 0.88 }, 0.95, 0.02, true, 0.0003, 0.00003 },
    { "along slices", { 0, 0, 1 }, 0.95, 0.02, false, 0.0003, 0.00003 },
    { "clip box", { 0, 0, 0 }, 0.95, 0.02, true, 0.0003, 0.00003 },
    { "much noise", { 0.3, 0.2, 0.93 }, 0.95, 0.2, false, 0.0025, 0.00034 },
    { "translucent", { 0.3, 0.2, 0.93 }, 0.6, 0.02, false, 0.0135, 0.00266 },
};

/* A number in [0, 1] that is different for each sample. */
static double noise(double x, double y, double z) {
    uint32_t h = (uint32_t)x * 73856093u ^ (uint32_t)y * 19349663u ^ (uint32_t)z * 83492791u;
    h = (h ^ h >> 13) * 0x5bd1e995u;
    return ((h ^ h >> 15) % 1024) / 1023.0;
}

/* Noise in air. `user`: the row. */
static double noisy(const void *user, double x, double y, double z) {
    const struct row *row = user;
    const bool is_air =
        fmax(fmax(fabs(x - middle), fabs(y - middle)), fabs(z - middle)) > middle - 1;
    return is_air ? 0 : 180 + 255 * row->share * (noise(x, y, z) - 0.5);
}

/* A ball around the middle of the volume. */
static double ball(const void *user, double x, double y, double z) {
    const double a = x - middle, b = y - middle, c = z - middle;
    (void)user;
    return fmin(fmax(128 - 40 * (sqrt(a * a + b * b + c * c) - 9), 0), 255);
}

static bool make(const struct row *row, test_value_fn *value, struct test_scene *scene) {
    const double points[][5] = { { 80, 0.9, 0.6, 0.4, 0 }, { 90, 0.9, 0.6, 0.4, row->opacity } };
    const double unit[3] = { 1, 1, 1 };
    struct sp_view *view = &scene->view;
    test_view_init(view);
    view->size[0] = view->size[1] = PIXELS;
    test_scene_points(scene, points, 2);
    if (!test_scene_voxels(scene, "cut", (uint32_t[]){ SIDE, SIDE, SIDE }, unit, SP_UINT8, value,
                           row))
        return false;
    test_scene_orbit(scene, NULL, 190, 10, 100); /* from the side that the planes remove */
    view->camera.projection = row->is_perspective ? SP_PERSPECTIVE : SP_ORTHOGRAPHIC;
    view->camera.height = SIDE;
    view->camera.fov_y = 22;
    view->filter.mode = SP_FILTER_ADAPTIVE;
    view->compositing.mode = SP_COMPOSITE_SHEET;
    view->transfer_function.order = SP_TF_POST;
    struct sp_shading *s = &view->shading;
    s->mode = SP_SHADING_PHONG;
    s->ambient = 0.1;
    s->diffuse = 0.7;
    s->specular = 0.3;
    s->exponent = 20;
    s->light_count = 1;
    s->lights[0] = (struct sp_light){ { 0.3, 0.5, -0.8 }, SP_LIGHT_WORLD, { 1, 1, 1 } };
    return true;
}

static void cut(const struct row *row, struct test_scene *scene) {
    if (row->normal[2] > 0)
        test_scene_cut(scene, row->normal, (double[]){ 0, 0, 0 });
    else
        scene->view.clip.box[0][2] = 0.35;
}

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void scale_to_one(double v[3]) {
    const double length = sqrt(dot(v, v));
    for (int a = 0; a < 3; a++)
        v[a] /= length;
}

/* Computes where the ray through the middle of pixel (x, y) starts, and its direction. */
static void compute_ray(const struct sp_view *view, double x, double y, double start[3],
                        double ray[3]) {
    const struct sp_camera *c = &view->camera;
    double forward[3], right[3], up[3], along;
    for (int a = 0; a < 3; a++)
        forward[a] = c->target[a] - c->position[a];
    scale_to_one(forward);
    along = dot(c->up, forward);
    for (int a = 0; a < 3; a++)
        up[a] = c->up[a] - along * forward[a];
    scale_to_one(up);
    for (int a = 0; a < 3; a++)
        right[a] = forward[(a + 1) % 3] * up[(a + 2) % 3] - forward[(a + 2) % 3] * up[(a + 1) % 3];
    const bool is_perspective = c->projection == SP_PERSPECTIVE;
    const double half = is_perspective ? tan(c->fov_y * M_PI / 360) : c->height / 2;
    const double u = (2 * (x + 0.5) / PIXELS - 1) * half, v = (1 - 2 * (y + 0.5) / PIXELS) * half;
    for (int a = 0; a < 3; a++) {
        const double aside = u * right[a] + v * up[a];
        start[a] = c->position[a] + (is_perspective ? 0 : aside);
        ray[a] = forward[a] + (is_perspective ? aside : 0);
    }
    scale_to_one(ray);
}

/* Computes the colour that a pixel of the face must have. Returns false if the pixel is outside of
 * the face or close to its border. */
static bool find_color(const struct row *row, const struct test_scene *scene, unsigned x,
                       unsigned y, double color[3]) {
    const struct sp_shading *s = &scene->view.shading;
    double start[3], ray[3], normal[3] = { 0, 0, 1 }, light[3], halfway[3], offset = 0;
    compute_ray(&scene->view, x, y, start, ray);
    if (row->normal[2] > 0)
        for (int a = 0; a < 3; a++)
            normal[a] = row->normal[a];
    else
        offset = (0.35 - 0.5) * SIDE;
    scale_to_one(normal);
    const double t = (offset - dot(normal, start)) / dot(normal, ray);
    for (int a = 0; a < 3; a++) {
        if (fabs(start[a] + t * ray[a]) > SIDE / 2.0 - 5)
            return false;
        light[a] = s->lights[0].direction[a];
    }
    scale_to_one(light);
    for (int a = 0; a < 3; a++)
        halfway[a] = light[a] - ray[a];
    scale_to_one(halfway);
    const double matt = s->ambient + s->diffuse * fabs(dot(normal, light));
    const double shine = s->specular * pow(fabs(dot(normal, halfway)), s->exponent);
    for (int c = 0; c < 3; c++)
        color[c] = (double)scene->view.transfer_function.points[0].color[c] * matt + shine;
    return true;
}

static bool check(const struct row *row, const struct test_scene *scene,
                  const struct test_image *image) {
    double most = 0, sum = 0, wanted[3];
    unsigned count = 0;
    for (unsigned y = 0; y < PIXELS; y++)
        for (unsigned x = 0; x < PIXELS; x++) {
            const double *got = test_image_at(image, x, y);
            if (!find_color(row, scene, x, y, wanted))
                continue;
            for (int c = 0; c < 3; c++, count++) {
                double d = fabs(got[c] / got[3] - wanted[c]);
                most = fmax(most, d);
                sum += d * d;
            }
        }
    double rms = sqrt(sum / count);
    printf(" %.4f %.5f of %u", most, rms, count / 3);
    return most <= row->most && rms <= row->rms && count > 3 * 500;
}

static bool render(const struct test_renderer *renderer, const struct test_scene *scene,
                   struct test_image *image) {
    struct sp_error err = { .text = "out of memory" };
    if (test_render_scene(renderer, scene, image, &err))
        return true;
    printf(" %s", err.text);
    return false;
}

static bool check_face(const struct row *row, const struct test_renderer *renderer) {
    struct test_scene scene;
    struct test_image image;
    if (!make(row, noisy, &scene))
        return false;
    cut(row, &scene);
    bool is_good = render(renderer, &scene, &image);
    if (is_good) {
        is_good = check(row, &scene, &image);
        test_image_finish(&image);
    }
    test_scene_finish(&scene);
    return is_good;
}

/* The plane passes before a ball, through transparent material. */
static bool check_transparent(const struct test_renderer *renderer) {
    static const double normal[3] = { 0.3, 0.2, 0.93 };
    struct test_scene scene;
    struct test_image whole, clipped;
    double most = 0;
    if (!make(&rows[0], ball, &scene) || !render(renderer, &scene, &whole))
        return false;
    test_scene_cut(&scene, normal, (double[]){ 0, 0, -12 });
    if (!render(renderer, &scene, &clipped))
        return false;
    for (size_t i = 0; i < (size_t)PIXELS * PIXELS * 4; i++)
        most = fmax(most, fabs(whole.rgba[i] - clipped.rgba[i]));
    printf(" %.5f", most);
    test_image_finish(&whole);
    test_image_finish(&clipped);
    test_scene_finish(&scene);
    return most <= 1e-4;
}

static unsigned check_target(const struct test_target *target,
                             const struct test_renderer *renderer) {
    unsigned failed = 0;
    for (size_t i = 0; i <= sizeof rows / sizeof rows[0]; i++) {
        const bool is_face = i < sizeof rows / sizeof rows[0];
        printf("%s %s, %s:", target->backend, target->isa,
               is_face ? rows[i].name : "through transparent material");
        const bool is_good = is_face ? check_face(&rows[i], renderer) : check_transparent(renderer);
        printf(is_good ? "\n" : " FAILED\n");
        failed += !is_good;
    }
    return failed;
}

int main(void) {
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    printf("largest and rms difference from the plane's colour\n");
    return test_check_targets(1, check_target) > 0;
}
