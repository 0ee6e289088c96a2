/* SPDX-License-Identifier: Apache-2.0
 *
 * The opacity of a constant semi-transparent slab has a closed form. For a line that crosses the
 * slab at an angle θ from its normal, it is 1 - (1 - a)^(D/(L·cos θ)). Here a is the opacity over
 * the reference length L, and D is the thickness of the slab: n·spacing for n layers, the sum of
 * the layers' thicknesses for a rectilinear grid, less the part that a clip plane removes.
 *
 * The pixel on the optical axis must be within 1 % of it in every backend, for every kernel, filter
 * and compositor: with exponential attenuation these differ only in colour.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sp/log.h"
#include "support/data.h"
#include "support/render.h"

struct slab {
    unsigned layers;
    double spacing[3]; /* the layers lie across `axis` */
    int axis;
    double opacity, length; /* a, and L in world units */
    double tilt;            /* θ, degrees */
    double sigma;
};

static const struct slab slabs[] = {
    { 8, { 1, 1, 1 }, 2, 0.05, 1, 0, 0.7 },
    { 8, { 1, 1, 1 }, 2, 0.30, 1, 0, 0.7 },
    { 20, { 1, 1, 1 }, 2, 0.01, 1, 0, 0.7 },
    { 2, { 1, 1, 1 }, 2, 0.95, 1, 0, 0.7 },
    { 1, { 1, 1, 1 }, 2, 0.50, 1, 0, 0.7 },
    { 8, { 1, 1, 1 }, 0, 0.10, 1, 0, 0.7 },
    { 8, { 1, 1, 1 }, 1, 0.10, 1, 0, 0.7 },
    { 5, { 1, 1, 4 }, 2, 0.05, 1, 0, 0.7 },
    { 9, { 1, 1, 4 }, 0, 0.05, 1, 0, 0.7 },
    { 5, { 0.5, 2, 0.7 }, 1, 0.05, 0.5, 0, 0.7 },
    { 6, { 0.02, 0.02, 0.03 }, 2, 0.2, 0.05, 0, 0.7 },
    { 6, { 40, 40, 60 }, 2, 0.2, 75, 0, 0.7 },
    { 8, { 1, 1, 1 }, 2, 0.05, 3, 0, 1.0 },
    { 8, { 1, 1, 1 }, 2, 0.10, 1, 30, 0.7 },
    { 5, { 1, 1, 3 }, 2, 0.10, 2, 25, 0.7 },
    { 5, { 1, 1, 1 }, 2, 0.02, 0.25, 40, 0.9 },
};

static const struct choice {
    const char *name;
    enum sp_compositing compositing;
    double slab;
    enum sp_kernel kernel;
    enum sp_filter_mode filter;
    bool half;   /* a clip plane removes the far half */
    bool graded; /* a rectilinear grid: layers of different thickness */
    enum sp_tf_order order;
} choices[] = {
    { "sheets", SP_COMPOSITE_SHEET, 1, SP_KERNEL_GAUSSIAN, SP_FILTER_EWA, false, false, SP_TF_PRE },
    { "interpolated sheets", SP_COMPOSITE_SHEET, 1, SP_KERNEL_GAUSSIAN, SP_FILTER_EWA, false, false,
      SP_TF_POST },
    { "cut interpolated sheets", SP_COMPOSITE_SHEET, 1, SP_KERNEL_GAUSSIAN, SP_FILTER_EWA, true,
      false, SP_TF_POST },
    { "graded interpolated sheets", SP_COMPOSITE_SHEET, 1, SP_KERNEL_GAUSSIAN, SP_FILTER_EWA, false,
      true, SP_TF_POST },
    { "splats", SP_COMPOSITE_SPLAT, 1, SP_KERNEL_GAUSSIAN, SP_FILTER_EWA, false, false, SP_TF_PRE },
    { "slabs", SP_COMPOSITE_SLAB, 0.6, SP_KERNEL_GAUSSIAN, SP_FILTER_EWA, false, false, SP_TF_PRE },
    { "cubic sheets", SP_COMPOSITE_SHEET, 1, SP_KERNEL_CUBIC, SP_FILTER_EWA, false, false,
      SP_TF_PRE },
    { "cubic slabs", SP_COMPOSITE_SLAB, 0.8, SP_KERNEL_CUBIC, SP_FILTER_EWA, false, false,
      SP_TF_PRE },
    { "swan slabs", SP_COMPOSITE_SLAB, 2, SP_KERNEL_GAUSSIAN, SP_FILTER_SWAN, false, false,
      SP_TF_PRE },
    { "cut sheets", SP_COMPOSITE_SHEET, 1, SP_KERNEL_GAUSSIAN, SP_FILTER_EWA, true, false,
      SP_TF_PRE },
    { "cut slabs", SP_COMPOSITE_SLAB, 1.3, SP_KERNEL_GAUSSIAN, SP_FILTER_EWA, true, false,
      SP_TF_PRE },
    { "cut cubic slabs", SP_COMPOSITE_SLAB, 1, SP_KERNEL_CUBIC, SP_FILTER_EWA, true, false,
      SP_TF_PRE },
    { "graded sheets", SP_COMPOSITE_SHEET, 1, SP_KERNEL_GAUSSIAN, SP_FILTER_EWA, false, true,
      SP_TF_PRE },
    { "cut graded slabs", SP_COMPOSITE_SLAB, 1, SP_KERNEL_GAUSSIAN, SP_FILTER_EWA, true, true,
      SP_TF_PRE },
};

static double one(const void *user, double x, double y, double z) {
    (void)user, (void)x, (void)y, (void)z;
    return 1;
}

/* Makes the axis rectilinear: outer layers are thicker than inner ones, symmetric about the middle.
 * The length of the axis stays the same. */
static bool grade(struct test_scene *scene, int axis) {
    struct sp_grid *grid = &scene->info.grid;
    uint32_t n = grid->dims[axis];
    double *c = calloc(n, sizeof *c);
    if (!c)
        return false;
    for (uint32_t i = 1; i < n; i++)
        c[i] = c[i - 1] + grid->spacing[axis] * (1 + 0.2 * cos(2 * M_PI * (i - 0.5) / (n - 1)));
    grid->spacing[axis] = n > 1 ? c[n - 1] / (n - 1) : grid->spacing[axis];
    for (int a = 0; a < 3; a++)
        grid->origin[a] = a == axis ? -0.5 * c[n - 1] : grid->origin[a];
    grid->coordinates[axis] = scene->coordinates[axis] = c;
    return true;
}

/* Returns the total thickness of the layers. */
static double depth(const struct sp_grid *grid, int axis) {
    double sum = 0;
    const double *c = grid->coordinates[axis];
    uint32_t n = grid->dims[axis];
    for (uint32_t i = 0; i < n; i++) {
        double below = c && i > 0 ? c[i] - c[i - 1] : 0;
        double above = c && i + 1 < n ? c[i + 1] - c[i] : 0;
        bool inner = below > 0 && above > 0;
        sum += n > 1 && c ? (below + above) / (inner ? 2 : 1) : grid->spacing[axis];
    }
    return sum;
}

/* Builds a slab that is wide enough to keep its rim out of the axis pixel: 31 voxels across, more
 * where voxels are small. */
static bool build(struct test_scene *scene, const struct slab *s, bool ortho) {
    uint32_t dims[3];
    double largest = fmax(s->spacing[0], fmax(s->spacing[1], s->spacing[2]));
    for (int a = 0; a < 3; a++)
        dims[a] = a == s->axis ? s->layers : (uint32_t)(30 * largest / s->spacing[a]) | 1;
    test_view_init(&scene->view);
    test_scene_points(
        scene, (const double[][5]){ { 0, 0.8, 0.4, 0.2, 0 }, { 1, 0.8, 0.4, 0.2, s->opacity } }, 2);
    if (!test_scene_voxels(scene, "slab", dims, s->spacing, SP_UINT8, one, NULL))
        return false;
    struct sp_camera *camera = &scene->view.camera;
    double tilt = s->tilt * M_PI / 180, distance = 100 * largest;
    int across = (s->axis + 1) % 3;
    camera->position[2] = 0;
    camera->position[s->axis] = distance * cos(tilt);
    camera->position[across] = distance * sin(tilt);
    for (int a = 0; a < 3; a++)
        camera->up[a] = a == (s->axis + 2) % 3;
    camera->projection = ortho ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
    camera->height = 20 * largest;
    camera->fov_y = 12;
    camera->near = largest;
    scene->view.size[0] = scene->view.size[1] = 33; /* odd: a pixel on the axis */
    scene->view.transfer_function.reference_length = s->length;
    scene->view.filter.sigma = s->sigma;
    return true;
}

static bool choose(struct test_scene *scene, const struct slab *s, const struct choice *choice) {
    struct sp_view *view = &scene->view;
    view->compositing.mode = choice->compositing;
    view->transfer_function.order = choice->order;
    view->compositing.slab = choice->slab;
    view->filter.kernel = choice->kernel;
    view->filter.mode = choice->filter;
    if (choice->graded && !grade(scene, s->axis))
        return false;
    double normal[3] = { 0 }, middle[3] = { 0 };
    normal[s->axis] = 1; /* towards the camera */
    if (choice->half)
        test_scene_cut(scene, normal, middle);
    return true;
}

static bool check(const struct test_renderer *r, const char *name, unsigned number,
                  const struct choice *choice, bool ortho, double lowpass, double *worst) {
    const struct slab *s = &slabs[number];
    struct test_scene scene;
    struct test_image image;
    struct sp_error err;
    if (!build(&scene, s, ortho) || !choose(&scene, s, choice))
        return false;
    scene.view.filter.lowpass = lowpass;
    if (!sp_renderer_supports(r->renderer, &scene.view, &err) && err.code == SP_ERR_UNSUPPORTED) {
        if (number == 0)
            printf("skipped: %s, %s: %s: %s\n", name, choice->name, err.place, err.text);
        test_scene_finish(&scene);
        return true;
    }
    if (!test_render_scene(r, &scene, &image, &err)) {
        printf("FAILED %s slab %u, %s: %s: %s\n", name, number, choice->name, err.place, err.text);
        return false;
    }
    double path = depth(&scene.info.grid, s->axis) / cos(s->tilt * M_PI / 180);
    if (choice->half)
        path *= 0.5;
    double wanted = 1 - pow(1 - (double)(float)s->opacity, path / s->length);
    const double *p = test_image_at(&image, 16, 16);
    double error = p[3] / wanted - 1, colour = 0;
    static const double rgb[3] = { 0.8, 0.4, 0.2 };
    for (int c = 0; c < 3; c++)
        colour = fmax(colour, fabs(p[c] / (rgb[c] * p[3]) - 1));
    /* A plane through the middle of a single layer gets a larger bound. The affine approximation of
     * the perspective moves kernels beside the axis behind the plane, by the square of their
     * distance from the axis divided by the distance of the camera. */
    double bound = choice->half && s->layers == 1 ? 0.015 : 0.01;
    bool ok = fabs(error) < bound && colour < 1e-3;
    if (!ok)
        printf("FAILED %s slab %u, %s, %s, low-pass %g: opacity %.5f, expected %.5f (error %+.2f "
               "%%, bound %.1f %%); colour error %.2g %%, bound 0.1 %%\n",
               name, number, choice->name, ortho ? "orthographic" : "perspective", lowpass, p[3],
               wanted, 100 * error, 100 * bound, 100 * colour);
    *worst = fmax(*worst, fabs(error));
    test_image_finish(&image);
    test_scene_finish(&scene);
    return ok;
}

int main(void) {
    struct test_target target;
    unsigned ran = 0, failed = 0;
    sp_log_init(NULL, NULL, SP_LOG_ERROR); /* refusals are printed here as skips */
    for (unsigned i = 0; test_target_at(i, &target); i++) {
        struct test_renderer r;
        struct sp_error err;
        char name[64];
        snprintf(name, sizeof name, "%s/%s", target.backend, target.isa);
        if (!test_renderer_open(&r, &target, 2, &err)) {
            printf("skipped: %s: %s\n", name, err.text);
            continue;
        }
        for (unsigned c = 0; c < sizeof choices / sizeof *choices; c++) {
            double worst = 0;
            for (unsigned s = 0; s < sizeof slabs / sizeof *slabs; s++)
                for (int ortho = 0; ortho < 2; ortho++)
                    for (unsigned lowpass = 0; lowpass < 2; lowpass++) {
                        if (strcmp(target.backend, "gl-software") == 0 && s % 8 != c % 8)
                            continue; /* software GL is slow: each choice on two slabs only */
                        if (c > 0 && lowpass != (s + c) % 2)
                            continue; /* only the first choice tests both low-pass filters */
                        failed += !check(&r, name, s, &choices[c], ortho, lowpass, &worst);
                        ran++;
                    }
            printf("%s, %s: largest deviation from the analytic opacity %.3f %%\n", name,
                   choices[c].name, 100 * worst);
        }
        test_renderer_close(&r);
    }
    printf("%u of %u slabs failed\n", failed, ran);
    return failed ? EXIT_FAILURE : ran ? EXIT_SUCCESS : TEST_SKIPPED;
}
