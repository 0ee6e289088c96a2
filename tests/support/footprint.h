/* SPDX-License-Identifier: Apache-2.0
 *
 * Footprints of the second opinion (formula.h has the formulas): voxel → image.
 */
#ifndef TESTS_SUPPORT_FOOTPRINT_H
#define TESTS_SUPPORT_FOOTPRINT_H

#include <stdbool.h>
#include <stdint.h>

#include "base/vec.h"
#include "support/scene.h"

enum { TEST_PLANES_MAX = 6 + SP_CLIP_PLANES_MAX, TEST_NUMBERS = 5 };

/* What all voxels of a scene share. */
struct test_projection {
    const struct test_scene *scene;
    double w[3][3];       /* world → camera */
    double scale;         /* f or s, px */
    double sigma, radius; /* of the kernel: deviation [voxels], where it ends [deviations] */
    bool perspective, cubic, post;
    int planes; /* kept: normal·t ≥ offset */
    struct test_half_space {
        double normal[3], offset;
    } half[TEST_PLANES_MAX];
};

struct test_footprint {
    double x, y, rx, ry;          /* centre and half sides of the box, px */
    double conic[3];              /* Ṽ⁻¹: xx, xy, yy; flat: 0 */
    double peak;                  /* length at the centre, world units; flat: everywhere */
    double distance, slope[2];    /* depth: x2 and its change per pixel */
    double deviation, reach;      /* along the ray given the pixel; r √V22 */
    double numbers[TEST_NUMBERS]; /* pre: c·g, g; post: gradient, 1, f; times length they add up */
    bool flat;
    int planes;
    struct test_cut { /* η = e + k·d in deviations; side as to how it bounds the depth */
        double e, k[2];
        int side; /* 1 below, -1 above, 0 not */
    } cut[TEST_PLANES_MAX];
    uint32_t voxel[3];
};

void test_projection_init(struct test_projection *p, const struct test_scene *scene);

/* False when the voxel is not drawn. */
bool test_footprint_init(const struct test_projection *p, const uint32_t voxel[3],
                         struct test_footprint *f);

/* What counts on the ray of the pixel at `d` from the centre: the length of the whole kernel, and
 * the interval of depth that clip planes leave, in deviations around the ray's mean. False when
 * nothing does. */
struct test_crossing {
    double length, rho, all; /* cubic: distance from the middle [voxels], F(ρ) */
    double low, high;
};
bool test_footprint_cross(const struct test_projection *p, const struct test_footprint *f,
                          const double d[2], struct test_crossing *c);

/* Share of the kernel before `depth`, in deviations, on that ray. */
double test_footprint_share(const struct test_projection *p, const struct test_crossing *c,
                            double depth);

#endif
