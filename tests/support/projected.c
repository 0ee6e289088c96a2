/* SPDX-License-Identifier: Apache-2.0 */
#include "support/projected.h"

#include <math.h>
#include <string.h>

#include "support/interpolant.h"
#include "support/interpolated.h"
#include "support/sample.h"

struct walker {
    struct test_interpolant field, bounded; /* of extremes: the bounded one */
    double zero[2];
    double *second; /* the numbers of the next pixel for the second zero */
};

static void follow(void *user, const double eye[3], const double ahead[3], double from, double to,
                   double step, double *number) {
    struct walker *w = user;
    double other = 0;
    number[0] = -INFINITY;
    number[1] = INFINITY;
    number[2] = number[3] = 0;
    for (double l = from + step / 2; l < to; l += step) {
        double world[3], index[3];
        for (int r = 0; r < 3; r++)
            world[r] = eye[r] + l * ahead[r];
        if (!test_interpolant_to_index(&w->field, world, index))
            continue;
        double value = test_interpolant_value(&w->field, index);
        double extreme = test_interpolant_value(&w->bounded, index);
        number[0] = fmax(number[0], extreme);
        number[1] = fmin(number[1], extreme);
        number[2] += fmax(value - w->zero[0], 0) * step;
        other += fmax(value - w->zero[1], 0) * step;
        number[3] += step;
    }
    memcpy(w->second, number, 4 * sizeof *number);
    w->second[2] = other;
    w->second += 4; /* pixels come row by row */
}

bool test_projected(const struct test_scene *scene, unsigned steps, const double zero[2],
                    struct test_image numbers[2]) {
    struct walker w = { .zero = { zero[0], zero[1] } };
    bool ok = test_image_init(&numbers[1], scene->view.size[0], scene->view.size[1]) &&
              test_interpolant_init(&w.field, scene) &&
              test_interpolant_init_bounded(&w.bounded, scene);
    w.second = numbers[1].rgba;
    ok = ok && test_each_ray(scene, steps, follow, &w, &numbers[0]);
    test_interpolant_finish(&w.field);
    test_interpolant_finish(&w.bounded);
    return ok;
}

static double number_of(const struct sp_view *view, const double *pixel, double zero) {
    double absorption = view->compositing.absorption;
    switch (view->compositing.mode) {
    case SP_COMPOSITE_MAXIMUM:
        return pixel[0];
    case SP_COMPOSITE_MINIMUM:
        return pixel[1];
    case SP_COMPOSITE_MEAN:
        return zero + pixel[2] / pixel[3];
    default:
        return isnan(absorption) ? pixel[2] : 1 - exp(-absorption * pixel[2]);
    }
}

bool test_projected_image(const struct sp_view *view, const struct test_image *numbers, double zero,
                          struct test_image *image) {
    const struct sp_compositing_options *c = &view->compositing;
    if (!test_image_init(image, view->size[0], view->size[1]))
        return false;
    for (unsigned y = 0; y < view->size[1]; y++)
        for (unsigned x = 0; x < view->size[0]; x++) {
            const double *pixel = test_image_at(numbers, x, y);
            double *rgba = test_image_at(image, x, y), color[3], opacity = 1;
            double number = number_of(view, pixel, zero);
            double grey = fmin(fmax((number - c->center) / c->width + 0.5, 0), 1);
            memset(rgba, 0, 4 * sizeof *rgba);
            if (!(pixel[3] > 0))
                continue;
            color[0] = color[1] = color[2] = grey;
            if (c->colors == SP_COLORS_TRANSFER_FUNCTION)
                test_classify(&view->transfer_function, number, 0, color, &opacity);
            for (int k = 0; k < 3; k++)
                rgba[k] = opacity * color[k];
            rgba[3] = opacity;
        }
    test_image_over(image, view->background);
    return true;
}
