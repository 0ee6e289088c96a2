/* SPDX-License-Identifier: Apache-2.0
 *
 * Whole images with ambient occlusion and shadows against a reference that marches rays of light
 * through the interpolated volume (support/lit.h), and both against closed forms.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "sp/log.h"
#include "support/interpolated.h"
#include "support/render.h"
#include "support/sanitized.h"

struct row {
    const char *name;
    test_scene_fn *scene;
    double occlusion, shadow;
    double light[3]; /* world; zero: the light of the scene */
    double floor;    /* dB, half a decibel below the measured value */
    double most;     /* largest difference of a channel, half a decibel above */
};

/* 255 inside of a surface, 0 outside; linear over three units. `distance`: outwards. */
static double solid(double distance) {
    return 255 * fmin(fmax(0.5 - 0.33 * distance, 0), 1);
}

static double ball(double x, double y, double z, double radius) {
    return solid(sqrt(x * x + y * y + z * z) - radius);
}

static bool make(struct test_scene *scene, const char *name, const uint32_t dims[3],
                 const double spacing[3], test_value_fn *value, double opacity) {
    const double points[][5] = { { 60, 0.9, 0.85, 0.7, 0 }, { 200, 0.9, 0.85, 0.7, opacity } };
    test_view_init(&scene->view);
    scene->view.size[0] = scene->view.size[1] = 48;
    test_scene_points(scene, points, 2);
    return test_scene_voxels(scene, name, dims, spacing, SP_UINT8, value, NULL);
}

static const double unit[3] = { 1, 1, 1 };

/* Two walls and a floor. */
static double corner_value(const void *user, double x, double y, double z) {
    (void)user;
    double inside = fmax(fmax(fabs(x - 18), fabs(y - 18)), fabs(z - 18)) - 13;
    return solid(fmax(inside, fmin(fmin(x, y), z) - 11));
}

static bool corner(struct test_scene *scene) {
    if (!make(scene, "corner", (uint32_t[]){ 36, 36, 36 }, unit, corner_value, 0.95))
        return false;
    test_scene_orbit(scene, NULL, 40, 30, 90);
    return true;
}

/* A ball that floats above a floor, y is up. */
static double ball_value(const void *user, double x, double y, double z) {
    (void)user;
    double floor = fmax(fabs(y - 6) - 3, fmax(fabs(x - 20), fabs(z - 20)) - 17);
    return fmax(ball(x - 20, y - 24, z - 20, 6), solid(floor));
}

static bool ball_above(struct test_scene *scene) {
    if (!make(scene, "ball", (uint32_t[]){ 40, 34, 40 }, unit, ball_value, 0.95))
        return false;
    test_scene_orbit(scene, NULL, 30, 50, 95);
    return true;
}

static bool ball_parallel(struct test_scene *scene) {
    if (!ball_above(scene))
        return false;
    scene->view.camera.projection = SP_ORTHOGRAPHIC;
    scene->view.camera.height = 46;
    return true;
}

/* The same in slices two units thick, turned. */
static double flat_ball_value(const void *user, double x, double y, double z) {
    return ball_value(user, x, y, 2 * z);
}

static bool ball_anisotropic(struct test_scene *scene) {
    const double spacing[3] = { 1, 1, 2 }, degrees[3] = { 20, 15, 30 };
    if (!make(scene, "thick-ball", (uint32_t[]){ 40, 34, 20 }, spacing, flat_ball_value, 0.95))
        return false;
    test_scene_direction(scene, degrees, 1, 0);
    test_scene_orbit(scene, NULL, 30, 40, 95);
    return true;
}

/* A translucent cloud around a denser core. */
static double cloud_value(const void *user, double x, double y, double z) {
    (void)user;
    double a = (x - 20) * (x - 20) + (y - 20) * (y - 20) + (z - 20) * (z - 20);
    double b = (x - 12) * (x - 12) + (y - 26) * (y - 26) + (z - 16) * (z - 16);
    return 90 + 110 * exp(-a / 60) + 60 * exp(-b / 20) - 20 * exp(-b / 300) - 0.05 * a;
}

static bool cloud(struct test_scene *scene) {
    if (!make(scene, "cloud", (uint32_t[]){ 40, 40, 40 }, unit, cloud_value, 0.12))
        return false;
    scene->view.size[0] = scene->view.size[1] = 32;
    test_scene_orbit(scene, NULL, 30, 20, 90);
    return true;
}

/* A glass block with a solid rod in it. */
static double rod_value(const void *user, double x, double y, double z) {
    (void)user;
    double block = fmax(fmax(fabs(x - 18), fabs(y - 18)), fabs(z - 18)) - 13;
    double rod = hypot(x - 18, z - 18) - 3;
    return 0.4 * solid(block) + 0.6 * solid(rod);
}

static bool rod(struct test_scene *scene) {
    const double points[][5] = { { 60, 0.3, 0.5, 1, 0 },
                                 { 100, 0.3, 0.5, 1, 0.02 },
                                 { 150, 1, 0.6, 0.3, 0.1 },
                                 { 250, 1, 0.6, 0.3, 0.9 } };
    if (!make(scene, "rod", (uint32_t[]){ 36, 36, 36 }, unit, rod_value, 0.9))
        return false;
    test_scene_points(scene, points, 4);
    test_scene_orbit(scene, NULL, 25, 30, 90);
    return true;
}

static const double reach = 0.1; /* of the volume's diagonal */

/* Rows with occlusion are held to the cosine hemisphere. */
static const struct row rows[] = {
    { "corner", corner, 1, 0, { 0.4, 0.8, 0.3 }, 42.6, 0.0650 },
    { "corner", corner, 0, 1, { 0.6, 0.7, 0.2 }, 46.0, 0.0462 },
    { "ball", ball_above, 0, 1, { 0.5, 1, 0.2 }, 40.4, 0.1227 },
    { "ball", ball_above, 1, 1, { -0.8, 0.7, -0.6 }, 41.8, 0.0738 },
    { "ball, parallel", ball_parallel, 1, 1, { 0, 1, 0 }, 38.5, 0.1016 },
    { "ball, anisotropic", ball_anisotropic, 1, 1, { 0.7, 0.9, -0.3 }, 38.2, 0.2430 },
    { "cloud", cloud, 1, 1, { 0.9, 0.3, 0.2 }, 58.0, 0.0083 },
    { "cloud, from behind", cloud, 0, 1, { -0.4, -0.1, 0.9 }, 61.0, 0.0061 },
    { "rod", rod, 0.7, 1, { 0.7, 0.6, -0.2 }, 42.3, 0.0925 },
    { "lit shell", test_scene_lit_shell, 1, 0.8, { 0, 0, 0 }, 44.9, 0.0408 },
};

static void light(struct test_scene *scene, const struct row *row) {
    struct sp_shading *s = &scene->view.shading;
    scene->view.compositing.mode = SP_COMPOSITE_SHEET;
    scene->view.filter.mode = SP_FILTER_ADAPTIVE;
    scene->view.transfer_function.order = SP_TF_POST;
    scene->view.level_of_detail = SP_LOD_OFF;
    s->mode = SP_SHADING_PHONG;
    s->occlusion = row->occlusion;
    s->shadow = row->shadow;
    s->reach = reach;
    if (row->light[0] != 0 || row->light[1] != 0 || row->light[2] != 0) {
        *s = (struct sp_shading){
            .mode = SP_SHADING_PHONG,
            .ambient = 0.35,
            .diffuse = 0.65,
            .specular = 0.2,
            .exponent = 24,
            .smoothing = NAN,
            .occlusion = row->occlusion,
            .shadow = row->shadow,
            .reach = reach,
            .light_count = 1,
            .lights = { { .space = SP_LIGHT_WORLD, .color = { 1, 1, 1 } } },
        };
        memcpy(s->lights[0].direction, row->light, sizeof row->light);
    }
}

static bool check(const struct row *row) {
    struct test_scene scene;
    struct test_target target;
    struct test_renderer r;
    struct test_image image, truth;
    struct sp_error err = { 0 };
    if (!row->scene(&scene) || !test_target_at(1, &target))
        return false;
    light(&scene, row);
    bool ok = test_renderer_open(&r, &target, 2, &err) &&
              test_render_scene(&r, &scene, &image, &err) && test_interpolated(&scene, 8, &truth);
    if (!ok) {
        printf("%s: %s\n", row->name, err.text);
        return false;
    }
    double psnr = test_image_psnr(&image, &truth);
    struct test_difference worst = test_image_difference(&image, &truth);
    ok = psnr >= row->floor && worst.largest <= row->most;
    printf("%-20s occlusion %.1f, shadow %.1f: %6.2f dB, %.4f at (%u, %u)%s\n", row->name,
           row->occlusion, row->shadow, psnr, worst.largest, worst.x, worst.y, ok ? "" : " FAILED");
    if (!ok) {
        char name[64];
        snprintf(name, sizeof name, "lit-%s-%.0f%.0f", row->name, row->occlusion, row->shadow);
        test_image_dump(name, &image, &truth, 8);
    }
    test_image_finish(&image);
    test_image_finish(&truth);
    test_renderer_close(&r);
    test_scene_finish(&scene);
    return ok;
}

/* A view straight down, where a world unit is as wide as PER_UNIT px. */
enum { PER_UNIT = 2, SIDE = 80 };

static void look_down(struct test_scene *scene, const struct row *row) {
    struct sp_camera *camera = &scene->view.camera;
    light(scene, row);
    scene->view.size[0] = scene->view.size[1] = SIDE;
    *camera = (struct sp_camera){ .projection = SP_ORTHOGRAPHIC,
                                  .position = { 0, 100, 0 },
                                  .up = { 0, 0, 1 },
                                  .height = (double)SIDE / PER_UNIT,
                                  .fov_y = 30,
                                  .near = 0.1 };
}

/* Returns the red value at sample coordinates x and z, divided by `lit`, the red value of a surface
 * that all light reaches. */
static double look_at(const struct test_image *image, const struct test_scene *scene, double x,
                      double z, double lit) {
    const uint32_t *dims = scene->info.grid.dims;
    double at[2] = { (dims[0] - 1) / 2.0 - x, (dims[2] - 1) / 2.0 - z }, sum = 0;
    for (int a = 0; a < 2; a++)
        at[a] = fmin(fmax(at[a] * PER_UNIT + SIDE / 2.0 - 0.5, 0), SIDE - 2);
    for (int k = 0; k < 4; k++) {
        double part[2] = { at[0] - floor(at[0]), at[1] - floor(at[1]) };
        unsigned column = (unsigned)at[0] + (k & 1), line = (unsigned)at[1] + (k >> 1);
        sum += (k & 1 ? part[0] : 1 - part[0]) * (k >> 1 ? part[1] : 1 - part[1]) *
               *test_image_at(image, column, line);
    }
    return sum / lit;
}

/* The occlusion of a floor by an endless wall at a distance of x·R: 1/π ∫∫ e^−x/(sin θ cos φ)
 * cos θ sin θ dθ dφ over the half of the cosine hemisphere in which the wall stands. */
static double occlude_by_wall(double x) {
    enum { PARTS = 300 };
    const double quarter = 1.5707963267948966;
    double sum = 0;
    for (int i = 0; i < PARTS; i++)
        for (int j = 0; j < PARTS; j++) {
            double theta = quarter * (i + 0.5) / PARTS, phi = quarter * (j + 0.5) / PARTS;
            sum += exp(-x / (sin(theta) * cos(phi))) * cos(theta) * sin(theta);
        }
    return sum * quarter / (PARTS * PARTS);
}

static bool draw_both(const struct test_scene *scene, struct test_image images[2]) {
    struct test_target target;
    struct test_renderer r;
    struct sp_error err = { 0 };
    if (!test_target_at(1, &target) || !test_renderer_open(&r, &target, 2, &err))
        return false;
    bool ok =
        test_render_scene(&r, scene, &images[0], &err) && test_interpolated(scene, 8, &images[1]);
    if (!ok)
        printf("%s\n", err.text);
    test_renderer_close(&r);
    return ok;
}

static bool is_near(const char *what, double got, double wanted, double most) {
    bool ok = fabs(got - wanted) <= most;
    if (!ok)
        printf("FAILED %s: %.3f instead of %.3f\n", what, got, wanted);
    return ok;
}

/* Two walls stand on a floor. */
static bool check_corner(void) {
    const struct row row = { .occlusion = 1, .light = { 0, 1, 0 } };
    struct test_scene scene;
    struct test_image images[2];
    if (!corner(&scene))
        return false;
    look_down(&scene, &row);
    scene.view.shading.light_count = 0;
    scene.view.shading.ambient = 1;
    if (!draw_both(&scene, images))
        return false;
    bool ok = true;
    const double fading = reach * sqrt(3) * 36, edge = 11.2;
    printf("a floor before a wall: distance, openness of the image, the reference and formula\n");
    for (int d = 1; d <= 13; d += 2) {
        double z = 26,
               formula = 1 - occlude_by_wall(d / fading) - occlude_by_wall((z - edge) / fading);
        double got[2];
        for (int k = 0; k < 2; k++)
            got[k] = look_at(&images[k], &scene, edge + d, z, 0.9);
        printf("  %2d  %.3f %.3f %.3f\n", d, got[0], got[1], formula);
        ok = is_near("the image", got[0], formula, 0.05) && ok;
        ok = is_near("the reference", got[1], formula, 0.04) && ok;
    }
    test_image_finish(&images[0]);
    test_image_finish(&images[1]);
    test_scene_finish(&scene);
    return ok;
}

/* A ball above a floor, in coordinates of samples, y is up. */
static const double ball_middle[3] = { 32, 28, 32 }, ball_radius = 12, floor_top = 8;
static const double floor_box[2][3] = { { 3, 3, 3 }, { 61, 8, 61 } };

static double large_ball_value(const void *user, double x, double y, double z) {
    (void)user;
    const double at[3] = { x, y, z };
    double outside = -INFINITY;
    for (int a = 0; a < 3; a++)
        outside = fmax(outside, fmax(floor_box[0][a] - at[a], at[a] - floor_box[1][a]));
    return fmax(solid(outside),
                ball(x - ball_middle[0], y - ball_middle[1], z - ball_middle[2], ball_radius));
}

/* Returns the distance from a point to the ball or the floor; INFINITY = neither is hit. */
static double trace(const double from[3], const double towards[3]) {
    double b = 0, c = -ball_radius * ball_radius, enter = 1e-6, leave = INFINITY, hit = INFINITY;
    for (int a = 0; a < 3; a++) {
        double apart = from[a] - ball_middle[a];
        b += apart * towards[a];
        c += apart * apart;
        double near = (floor_box[towards[a] < 0][a] - from[a]) / towards[a];
        double far = (floor_box[towards[a] >= 0][a] - from[a]) / towards[a];
        enter = fmax(enter, near);
        leave = fmin(leave, far);
    }
    if (enter < leave)
        hit = enter;
    if (b < 0 && b * b > c && -b - sqrt(b * b - c) > 1e-6)
        hit = fmin(hit, -b - sqrt(b * b - c));
    return hit;
}

/* The occlusion of a surface: the cosine hemisphere around its normal, evenly filled with rays. */
static double occlude_by_rays(const double at[3], const double normal[3], double fading) {
    enum { COUNT = 20000 };
    double sum = 0;
    for (int i = 0; i < COUNT; i++) {
        double z = (2 * i + 1.0) / COUNT - 1, r = sqrt(1 - z * z), turn = i * 2.399963229728653;
        const double d[3] = { r * cos(turn), r * sin(turn), z };
        double slant = normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2];
        if (slant > 0)
            sum += 4 * slant * exp(-trace(at, d) / fading) / COUNT;
    }
    return sum;
}

/* Places of the surfaces: distances from the place on the floor below the ball; and angles from the
 * top of the ball, on the side of the camera. */
static const double floor_places[] = { 0, 4, 8, 12, 16, 20, 24 };
static const double ball_places[] = { 15, 45, 75, 90, 105, 120 };
enum { FLOOR_PLACES = 7, BALL_PLACES = 6 };

/* Place k of the surfaces and its normal. */
static void locate(int k, double at[3], double normal[3]) {
    memset(normal, 0, 3 * sizeof *normal);
    if (k < FLOOR_PLACES) {
        at[0] = ball_middle[0] + floor_places[k] * 0.8;
        at[1] = floor_top;
        at[2] = ball_middle[2] + floor_places[k] * 0.6;
        normal[1] = 1;
        return;
    }
    double angle = ball_places[k - FLOOR_PLACES] * 3.14159265358979323846 / 180;
    normal[0] = 0.28 * sin(angle);
    normal[1] = cos(angle);
    normal[2] = 0.96 * sin(angle);
    for (int a = 0; a < 3; a++)
        at[a] = ball_middle[a] + ball_radius * normal[a];
}

/* Occlusion alone, seen from z and a height of 30°. */
static void look_aslant(struct test_scene *scene, double occlusion_reach) {
    const struct row row = { .occlusion = 1, .light = { 0, 1, 0 } };
    look_down(scene, &row);
    scene->view.size[0] = scene->view.size[1] = 2 * SIDE;
    scene->view.shading.reach = occlusion_reach;
    scene->view.shading.light_count = 0;
    scene->view.shading.ambient = 1;
    scene->view.camera.height = 2.0 * SIDE / PER_UNIT;
    memcpy(scene->view.camera.position, (double[]){ 0, 50, 86.602540378443865 },
           sizeof scene->view.camera.position);
    memcpy(scene->view.camera.up, (double[]){ 0, 1, 0 }, sizeof scene->view.camera.up);
}

/* The red value where the view from aslant shows a place, divided by that of full light. */
static double look_at_place(const struct test_image *image, const struct test_scene *scene,
                            const double at[3]) {
    const uint32_t *dims = scene->info.grid.dims;
    double world[3];
    for (int a = 0; a < 3; a++)
        world[a] = at[a] - (dims[a] - 1) / 2.0;
    double x = world[0], y = 0.866025403784 * world[1] - 0.5 * world[2];
    unsigned column = (unsigned)(SIDE + PER_UNIT * x), line = (unsigned)(SIDE - PER_UNIT * y);
    return *test_image_at(image, column, line) / 0.9;
}

/* A ball 8 samples above a floor darkens the floor, and the floor darkens the ball, as the cosine
 * hemisphere does. Light is read up to 2.5 samples before a surface, and so nearer to the ball:
 * right below the ball the occlusion is that of this place, which is larger by up to 0.14. */
static bool check_ball(double occlusion_reach) {
    struct test_scene scene;
    struct test_target target;
    struct test_renderer r;
    struct test_image image;
    struct sp_error err = { 0 };
    const uint32_t dims[3] = { 65, 48, 65 };
    if (!make(&scene, "large-ball", dims, unit, large_ball_value, 0.95))
        return false;
    look_aslant(&scene, occlusion_reach);
    double fading = occlusion_reach * sqrt(65.0 * 65 * 2 + 48 * 48), square = 0;
    if (!test_target_at(1, &target) || !test_renderer_open(&r, &target, 2, &err) ||
        !test_render_scene(&r, &scene, &image, &err)) {
        printf("%s\n", err.text);
        return false;
    }
    bool ok = true;
    printf("a ball above a floor, reach %.2f: occlusion of the image and the cosine hemisphere\n",
           occlusion_reach);
    for (int k = 0; k < FLOOR_PLACES + BALL_PLACES; k++) {
        double at[3], normal[3];
        locate(k, at, normal);
        double got = 1 - look_at_place(&image, &scene, at);
        double wanted = occlude_by_rays(at, normal, fading);
        printf("  %s %3.0f: %.3f %.3f\n", k < FLOOR_PLACES ? "floor" : "ball",
               k < FLOOR_PLACES ? floor_places[k] : ball_places[k - FLOOR_PLACES], got, wanted);
        double most = k < FLOOR_PLACES && floor_places[k] < ball_radius ? 0.14 : 0.04;
        ok = is_near("occlusion", got, wanted, most) && ok;
        square += (got - wanted) * (got - wanted) / (FLOOR_PLACES + BALL_PLACES);
    }
    printf("  RMS %.4f\n", sqrt(square));
    ok = is_near("RMS", sqrt(square), 0, 0.05) && ok;
    test_image_finish(&image);
    test_renderer_close(&r);
    test_scene_finish(&scene);
    return ok;
}

/* A light, and the length of its rays per unit of height. */
static const double shadow_light[3] = { 0.7, 1, 0.3 }, slant = 1.257;

/* Finds where a profile across the shadow passes a share of the light, from the middle on. */
static double measure_edge(const struct test_image *image, const struct test_scene *scene,
                           const double middle[2], const double across[2], double share) {
    const double diffuse = 0.65 / slant, lit = 0.9 * (0.35 + diffuse);
    const double dark = 0.35 / (0.35 + diffuse);
    double last = 0;
    for (double t = 0; t < 12; t += 0.05) {
        double seen =
            look_at(image, scene, middle[0] + t * across[0], middle[1] + t * across[1], lit);
        double light = (seen - dark) / (1 - dark);
        if (light >= share)
            return last;
        last = t;
    }
    return last;
}

/* The shadow of the ball lies 15 units of height away, along the light. Its edges are as wide as
 * the disc of the light is from there: of its width of 2·0.07·15·slant, 69 % lie between a tenth
 * and nine tenths of the light. */
static bool check_shadow(void) {
    const struct row row = { .shadow = 1, .light = { shadow_light[0], 1, shadow_light[2] } };
    struct test_scene scene;
    struct test_image images[2];
    if (!ball_above(&scene))
        return false;
    look_down(&scene, &row);
    scene.view.shading.specular = 0;
    if (!draw_both(&scene, images))
        return false;
    bool ok = true;
    const double *l = shadow_light, aside = hypot(l[0], l[2]);
    const double middle[2] = { 20 - 15 * l[0], 20 - 15 * l[2] };
    const double width = 0.69 * 2 * 0.07 * 15 * slant;
    printf("a ball's shadow: distance of its edges from its middle, and their width\n");
    for (int side = 0; side < 2; side++)
        for (int k = 0; k < 2; k++) {
            const double across[2] = { (side ? l[2] : -l[2]) / aside,
                                       (side ? -l[0] : l[0]) / aside };
            double edge = measure_edge(&images[k], &scene, middle, across, 0.5);
            double soft = measure_edge(&images[k], &scene, middle, across, 0.9) -
                          measure_edge(&images[k], &scene, middle, across, 0.1);
            printf("  %s: %.2f (6), %.2f (%.2f)\n", k ? "reference" : "image", edge, soft, width);
            ok = is_near("the edge", edge, 6.2, 0.5) && ok;
            ok = is_near("its width", soft, width, k ? 0.6 : 1.6) && ok;
        }
    test_image_finish(&images[0]);
    test_image_finish(&images[1]);
    test_scene_finish(&scene);
    return ok;
}

int main(void) {
    unsigned failed = 0;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    failed += !check_corner();
    failed += !check_ball(0.25);
    failed += !check_ball(10);
    failed += !check_shadow();
    printf("PSNR [dB] and largest difference to the reference\n");
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        failed += !check(&rows[i]);
    return failed > 0;
}
