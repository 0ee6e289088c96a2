/* SPDX-License-Identifier: Apache-2.0
 *
 * The continuous field of a grid of kernels, Σ_k a_k r_k, summed exactly at any point: the heart of
 * the integrator. `a_k` is up to eight numbers a voxel.
 *
 * Points are given in axis space, the distances along the grid's axes from sample (0,0,0) in world
 * units: p = direction⁻¹ (t - origin). There a Gaussian kernel is a product over the axes,
 *
 *   r_k(p) = Π_a s_a N(p_a - c_a; σ s_a)       c_a, s_a: the voxel's distance and local spacing
 *
 * whatever the rotation, shear or handedness, because v_k = |det direction|·Π s_a and the density's
 * determinant cancels |det direction|. The cubic one is g(√Σ_a ((p_a - c_a)/s_a)²).
 */
#ifndef TESTS_SUPPORT_FIELD_H
#define TESTS_SUPPORT_FIELD_H

#include <stdbool.h>
#include <stddef.h>

#include "sp/view.h"
#include "sp/volume.h"

typedef double test_quad __attribute__((vector_size(32), aligned(32)));

struct test_axis {
    double *place; /* distance of each padded sample; beyond the border the last gap repeats */
    double *size;  /* its local spacing */
    double step;   /* the smallest of them, or the spacing of an even axis */
    bool even;
};

struct test_field {
    size_t dims[3];         /* padded */
    int pad, reach;         /* kernels of 2·reach + 1 voxels per axis count at a point */
    int quads;              /* a voxel, 1 or 2 */
    test_quad *voxels;      /* i0 fastest */
    unsigned char *near_by; /* 1 where a point nearest to this voxel may see something */
    struct test_axis axes[3];
    enum sp_kernel kernel;
    double sigma;    /* voxels */
    double *lattice; /* exp(-k²/2σ²)/√(2π)σ for k = -reach … reach */
};

/* An empty field for the kernel of `filter`; a Gaussian is summed out to at least `radius` σ. False
 * when out of memory (finish it all the same) or when a kernel reaches farther than 20 voxels. */
bool test_field_init(struct test_field *f, const struct sp_grid *grid,
                     const struct sp_filter *filter, double radius, int quads);
void test_field_finish(struct test_field *f);

/* Sets a voxel's numbers, quads of them. */
void test_field_set(struct test_field *f, const uint32_t i[3], const test_quad *numbers);

/* To be called when all voxels are set; false when out of memory. */
bool test_field_close(struct test_field *f);

/* For a field of (f, 1): hides the points where Σ f_k r_k / Σ r_k lies in an interval that
 * `visible` refuses, judged by the samples around. After test_field_close(). */
typedef bool test_interval_fn(const void *user, double low, double high);
void test_field_hide(struct test_field *f, test_interval_fn *visible, const void *user);

/* The sums at a point; false where nothing is near. */
bool test_field_at(const struct test_field *f, const double p[3], test_quad *sums);

/* Where p + l·d, l ≥ 0, lies where kernels reach; false if nowhere. */
bool test_field_span(const struct test_field *f, const double p[3], const double d[3], double *from,
                     double *to);

#endif
