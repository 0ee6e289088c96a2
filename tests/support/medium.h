/* SPDX-License-Identifier: Apache-2.0
 *
 * A scene with closed forms: a medium of constant extinction and colour on a rotated, anisotropic
 * grid, whose values are a linear function of the place. A ray of length L in it shows
 * c·(1 − e^−σL), and every iso-surface is a plane.
 */
#ifndef TESTS_SUPPORT_MEDIUM_H
#define TESTS_SUPPORT_MEDIUM_H

#include <stdbool.h>

#include "sp/view.h"
#include "sp/volume.h"

enum { TEST_MEDIUM_SIDE = 96 /* px of the image */ };

struct test_medium {
    struct sp_grid grid;
    struct sp_volume *volume; /* one reference; NULL = out of memory */
    struct sp_view view;      /* not lit */
    double sigma;             /* extinction */
};

extern const double test_medium_field[4]; /* slope and offset of the values */
extern const float test_medium_color[3];

/* The caller unrefs the volume. */
void test_medium_init(struct test_medium *medium, enum sp_projection projection);

double test_medium_value(const double p[3]);
double test_dot(const double a[3], const double b[3]);

/* The ray of a point of the image: unit direction. */
void test_medium_ray(const struct sp_camera *camera, double x, double y, double from[3],
                     double along[3]);

/* An axis of the grid as a vector, and its range of dot(axis, p − origin). */
void test_medium_axis(const struct sp_grid *grid, int a, double axis[3], double range[2]);

/* Sets [t0, t1], the part of a ray in the volume or in its clip box. False if it is empty. */
bool test_medium_cut(const struct test_medium *medium, const double from[3], const double along[3],
                     bool clipped, double t[2]);

#endif
