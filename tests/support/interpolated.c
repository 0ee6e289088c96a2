/* SPDX-License-Identifier: Apache-2.0 */
#include "support/interpolated.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "support/interpolant.h"
#include "support/lit.h"
#include "support/sample.h"

/* Light changes slowly, and its rays are expensive. A ray computes it again when the opacity has
 * grown by this share, or after a distance of one sample. */
static const double share_per_light = 0.06;

struct marcher {
    const struct sp_view *view;
    struct test_interpolant field;
    struct test_lit lit;
    bool is_lit; /* with occlusion or a shadow */
};

static void march(void *user, const double eye[3], const double ahead[3], double from, double to,
                  double step, double *rgba) {
    const struct marcher *m = user;
    const struct sp_view *view = m->view;
    double light = 1, share[2] = { 1, 1 };
    double lit_at = -INFINITY, lit_light = 1; /* where `share` was found */
    memset(rgba, 0, 4 * sizeof *rgba);
    for (double l = from + step / 2; l < to && light > 1e-6; l += step) {
        double world[3], index[3], gradient[3] = { 0 }, color[3], opacity;
        for (int r = 0; r < 3; r++)
            world[r] = eye[r] + l * ahead[r];
        if (!test_interpolant_to_index(&m->field, world, index))
            continue;
        if (test_needs_gradient(view))
            test_interpolant_gradient(&m->field, index, gradient);
        double length =
            sqrt(gradient[0] * gradient[0] + gradient[1] * gradient[1] + gradient[2] * gradient[2]);
        double value = test_interpolant_value(&m->field, index);
        test_classify(&view->transfer_function, value, length, color, &opacity);
        if (!(opacity > 0))
            continue;
        double alpha = 1 - pow(1 - opacity, step / view->transfer_function.reference_length);
        if (m->is_lit && light > 0.01 &&
            (l > lit_at + m->lit.cell / 2 || light < lit_light - share_per_light)) {
            test_lit_shares(&m->lit, world, ahead, gradient, share);
            lit_at = l;
            lit_light = light;
        }
        test_shade_shares(view, ahead, gradient, share, color);
        for (int c = 0; c < 3; c++)
            rgba[c] += light * alpha * color[c];
        light *= 1 - alpha;
    }
    rgba[3] = 1 - light;
}

bool test_each_ray(const struct test_scene *scene, unsigned steps, test_ray_fn *follow, void *user,
                   struct test_image *image) {
    return test_ray_rows(scene, steps, 0, scene->view.size[1], follow, user, image);
}

bool test_ray_rows(const struct test_scene *scene, unsigned steps, unsigned begin, unsigned end,
                   test_ray_fn *follow, void *user, struct test_image *image) {
    const struct sp_view *view = &scene->view;
    const struct sp_grid *grid = &scene->info.grid;
    double w[3][3], middle[3], radius = 0, smallest = INFINITY;
    test_camera_axes(&view->camera, w);
    double scale = test_camera_scale(view);
    for (int r = 0; r < 3; r++)
        middle[r] = grid->origin[r];
    for (int a = 0; a < 3; a++) {
        const double *c = grid->coordinates[a];
        uint32_t last = grid->dims[a] - 1;
        double extent = c ? c[last] : grid->spacing[a] * last;
        radius += 0.5 * extent + grid->spacing[a] * (c ? last : 1);
        smallest = fmin(smallest, grid->spacing[a]);
        for (uint32_t i = 0; c && i < last; i++)
            smallest = fmin(smallest, c[i + 1] - c[i]);
        for (int r = 0; r < 3; r++)
            middle[r] += 0.5 * extent * grid->direction[r][a];
    }
    if (!test_image_init(image, view->size[0], end - begin))
        return false;
    for (unsigned y = begin; y < end; y++)
        for (unsigned x = 0; x < view->size[0]; x++) {
            double right = (x + 0.5 - 0.5 * view->size[0]) / scale;
            double down = (y + 0.5 - 0.5 * view->size[1]) / scale;
            double eye[3], ahead[3], length = 0, along = 0;
            bool is_flat = view->camera.projection == SP_ORTHOGRAPHIC;
            for (int r = 0; r < 3; r++) {
                double across = right * w[0][r] + down * w[1][r];
                eye[r] = view->camera.position[r] + (is_flat ? across : 0);
                ahead[r] = w[2][r] + (is_flat ? 0 : across);
                length += ahead[r] * ahead[r];
            }
            length = sqrt(length);
            for (int r = 0; r < 3; r++) {
                ahead[r] /= length;
                along += (middle[r] - eye[r]) * ahead[r];
            }
            /* The near plane, and a sphere that holds the volume. */
            double from = fmax(along - radius, view->camera.near * (is_flat ? 1 : length));
            follow(user, eye, ahead, from, along + radius, smallest / steps,
                   test_image_at(image, x, y - begin));
        }
    return true;
}

bool test_interpolated(const struct test_scene *scene, unsigned steps, struct test_image *image) {
    const struct sp_view *view = &scene->view;
    const struct sp_shading *shading = &view->shading;
    struct marcher m = { .view = view };
    m.is_lit = shading->mode == SP_SHADING_PHONG && (shading->occlusion > 0 || shading->shadow > 0);
    bool ok = test_interpolant_init(&m.field, scene) &&
              (!m.is_lit || test_lit_init(&m.lit, &m.field, 2)) &&
              test_each_ray(scene, steps, march, &m, image);
    test_lit_finish(&m.lit);
    test_interpolant_finish(&m.field);
    if (ok)
        test_image_over(image, view->background);
    return ok;
}
