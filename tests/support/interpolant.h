/* SPDX-License-Identifier: Apache-2.0
 *
 * A volume as a function of space, for references that march rays.
 *
 * Along each axis, half way between two samples, the polynomial of degree 5 through the six nearest
 * samples; between these values and the samples, linear. The volume ends half a cell beyond the
 * outermost samples, whose values hold there. Values are kept inside the range of the samples; in a
 * bounded field, each value half way between two others is kept between these two: in slices across
 * the axis along which the camera looks most, first along their rows, then from slice to slice,
 * then along their columns.
 */
#ifndef TESTS_SUPPORT_INTERPOLANT_H
#define TESTS_SUPPORT_INTERPOLANT_H

#include "support/scene.h"

struct test_interpolant {
    const struct test_scene *scene; /* borrowed */
    const struct sp_grid *grid;
    int count[3];         /* values per axis: samples, and values half way between */
    bool is_bounded;      /* see above */
    int slices;           /* the axis along which the camera looks most */
    double *values;       /* owned; axis 0 fastest */
    double inverse[3][3]; /* of the grid's direction: world → distances along the axes */
};

/* Samples must be finite. False when out of memory. */
bool test_interpolant_init(struct test_interpolant *f, const struct test_scene *scene);
bool test_interpolant_init_bounded(struct test_interpolant *f, const struct test_scene *scene);
void test_interpolant_finish(struct test_interpolant *f);

/* Sets the sample index at a point; false outside of the volume and where clipping removes it. */
bool test_interpolant_to_index(const struct test_interpolant *f, const double world[3],
                               double index[3]);

double test_interpolant_value(const struct test_interpolant *f, const double index[3]);

/* In world space [data unit per world unit]: central differences over half a sample to each side.
 */
void test_interpolant_gradient(const struct test_interpolant *f, const double index[3],
                               double out[3]);

/* Sets the inverse of a matrix that has one. */
void test_invert(double m[3][3], double out[3][3]);

#endif
