/* SPDX-License-Identifier: Apache-2.0
 *
 * The footprint of a voxel on the image, for the reference renderer of formula.h, which has the
 * formulas.
 */
#ifndef TESTS_SUPPORT_FOOTPRINT_H
#define TESTS_SUPPORT_FOOTPRINT_H

#include <stdbool.h>
#include <stdint.h>

#include "base/vec.h"
#include "support/scene.h"

enum { TEST_PLANES_MAX = 6 + SP_CLIP_PLANES_MAX, TEST_NUMBERS = 5 };

/* Data that all voxels of a scene share. */
struct test_projection {
    const struct test_scene *scene;
    double w[3][3];       /* world → camera */
    double scale;         /* f or s, px */
    double sigma, radius; /* standard deviation [voxels] and radius [deviations] of the kernel */
    bool perspective, cubic, post;
    int planes; /* a plane keeps normal·t ≥ offset */
    struct test_half_space {
        double normal[3], offset;
    } half[TEST_PLANES_MAX];
};

struct test_footprint {
    double x, y, rx, ry;          /* centre and half sides of the box, px */
    double conic[3];              /* Ṽ⁻¹: xx, xy, yy; flat: 0 */
    double peak;                  /* length at the centre, world units; flat: everywhere */
    double distance, slope[2];    /* depth: x2 and its change per pixel */
    double deviation, reach;      /* of the depth on the ray of a pixel; r √V22 */
    double numbers[TEST_NUMBERS]; /* per length; pre: c·g, g; post: gradient, 1, f */
    bool flat;
    int planes;
    struct test_cut { /* a clip plane: η = e + k·d in deviations */
        double e, k[2];
        int side; /* 1: lower bound of the depth; -1: upper bound; 0: a factor */
    } cut[TEST_PLANES_MAX];
    uint32_t voxel[3];
};

void test_projection_init(struct test_projection *p, const struct test_scene *scene);

/* False when the voxel is not drawn. */
bool test_footprint_init(const struct test_projection *p, const uint32_t voxel[3],
                         struct test_footprint *f);

/* Where the ray of the pixel at `d` from the footprint's centre crosses the kernel.
 * test_footprint_cross() returns false if the clip planes leave nothing. */
struct test_crossing {
    double length;    /* of the whole kernel on the ray [world units] */
    double rho;       /* cubic only: distance of the ray from the kernel's centre [voxels] */
    double all;       /* cubic only: F(ρ) */
    double low, high; /* the part that clip planes keep [standard deviations from the mean depth] */
};
bool test_footprint_cross(const struct test_projection *p, const struct test_footprint *f,
                          const double d[2], struct test_crossing *c);

/* Returns the share of the kernel before `depth` [deviations] on that ray. */
double test_footprint_share(const struct test_projection *p, const struct test_crossing *c,
                            double depth);

#endif
