/* SPDX-License-Identifier: Apache-2.0
 *
 * The continuous field of a grid of kernels, Σ_k a_k r_k, summed exactly at any point, for the
 * integrator (support/truth.h). `a_k` is up to eight numbers per voxel.
 *
 * Points are given in axis space, the distances along the grid's axes from sample (0,0,0) in world
 * units: p = direction⁻¹ (t - origin). There a Gaussian kernel is a product over the axes,
 *
 *   r_k(p) = Π_a s_a N(p_a - c_a; σ s_a)       c_a, s_a: the voxel's distance and local spacing
 *
 * for any rotation, shear or handedness, because v_k = |det direction|·Π s_a and the determinant of
 * the density cancels |det direction|. The cubic kernel is g(√Σ_a ((p_a - c_a)/s_a)²).
 */
#ifndef TESTS_SUPPORT_FIELD_H
#define TESTS_SUPPORT_FIELD_H

#include <stdbool.h>
#include <stddef.h>

#include "sp/view.h"
#include "sp/volume.h"

typedef double test_quad __attribute__((vector_size(32), aligned(32)));

struct test_axis {
    double *place; /* distance of each padded sample; the last gap repeats beyond the border */
    double *size;  /* the local spacing of each padded sample */
    double step;   /* the smallest local spacing, or the spacing of an even axis */
    bool even;
};

struct test_field {
    size_t dims[3];         /* padded */
    int pad, reach;         /* 2·reach + 1 kernels per axis contribute to a point */
    int quads;              /* per voxel, 1 or 2 */
    test_quad *voxels;      /* i0 fastest */
    unsigned char *near_by; /* 1 where points nearest to this voxel may have a visible value */
    struct test_axis axes[3];
    enum sp_kernel kernel;
    double sigma;    /* voxels */
    double *lattice; /* exp(-k²/2σ²)/√(2π)σ for k = -reach … reach */
};

/* Initialises an empty field for the kernel of `filter`. A Gaussian is summed out to at least
 * `radius` σ. False when out of memory or when a kernel reaches farther than 20 voxels; call
 * test_field_finish() in these cases as well. */
bool test_field_init(struct test_field *f, const struct sp_grid *grid,
                     const struct sp_filter *filter, double radius, int quads);
void test_field_finish(struct test_field *f);

/* Sets the numbers of a voxel: `quads` quads. */
void test_field_set(struct test_field *f, const uint32_t i[3], const test_quad *numbers);

/* Call it when all voxels are set. False when out of memory. */
bool test_field_close(struct test_field *f);

/* For a field of (f, 1): hides the points where `visible` returns false for the interval of
 * Σ f_k r_k / Σ r_k, which the samples around the point bound. Call it after test_field_close(). */
typedef bool test_interval_fn(const void *user, double low, double high);
void test_field_hide(struct test_field *f, test_interval_fn *visible, const void *user);

/* Sets the sums at a point. False where no visible voxel is near. */
bool test_field_at(const struct test_field *f, const double p[3], test_quad *sums);

/* Sets the interval of l ≥ 0 in which p + l·d is within reach of kernels. False if it is empty. */
bool test_field_span(const struct test_field *f, const double p[3], const double d[3], double *from,
                     double *to);

#endif
