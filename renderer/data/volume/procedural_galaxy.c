/* SPDX-License-Identifier: Apache-2.0
 *
 * A spiral galaxy on a rectilinear grid. The arms are logarithmic spirals. Their width and the gaps
 * of the grid grow with the radius: both are fine in the middle and coarse outside. Every part is
 * smooth. Lengths are in half edges of the volume, which is half as high as it is wide.
 */
#include <math.h>
#include <stdlib.h>

#include "data/volume/procedural.h"

/* The outermost gaps are cosh(GRADE), about 10, times as wide as the gaps in the middle. */
#define GRADE 3.0

/* Sample i of n along each axis, in [-1,1]. */
static double position(uint32_t n, uint32_t i) {
    return sinh(GRADE * (2.0 * i / (n - 1) - 1)) / sinh(GRADE);
}

static double grade(uint32_t n, uint32_t i) {
    return 0.5 * (n - 1) * (1 + position(n, i));
}

static void shape_galaxy(uint32_t size, uint32_t dims[3]) {
    dims[0] = dims[1] = size;
    dims[2] = size / 2;
}

/* The values that do not depend on z. */
struct column {
    float arms, height, rr; /* density in the plane; of the disc there; radius² */
};

static void *prepare_galaxy(const uint32_t dims[3]) {
    const double winding = 1 / tan(14 * M_PI / 180);
    struct column *plane = malloc((size_t)dims[0] * dims[1] * sizeof *plane);
    for (uint32_t j = 0; plane && j < dims[1]; j++)
        for (uint32_t i = 0; i < dims[0]; i++) {
            double x = position(dims[0], i), y = position(dims[1], j), rr = x * x + y * y;
            double r = sqrt(rr + 1e-4);
            double wave = 0.5 + 0.5 * cos(2 * (atan2(y, x) - winding * log(r)));
            double inside = 1 / (1 + exp(40 * (r - 0.92))); /* the rim */
            plane[(size_t)j * dims[0] + i] =
                (struct column){ .arms = (float)(0.7 * exp(-0.5 * r) * inside * rr / (rr + 0.003) *
                                                 (0.15 + 0.85 * wave * wave)),
                                 .height = (float)(0.02 + 0.06 * r),
                                 .rr = (float)rr };
        }
    return plane;
}

static void fill_galaxy(const void *prepared, const uint32_t dims[3], size_t begin, size_t end,
                        void *voxels) {
    const struct column *plane = prepared;
    const float bulge = 0.09f;
    size_t area = (size_t)dims[0] * dims[1];
    for (size_t k = begin; k < end; k++) {
        uint16_t *slice = (uint16_t *)voxels + k * area;
        float z = 0.5f * (float)position(dims[2], (uint32_t)k), zz = z * z;
        for (size_t c = 0; c < area; c++) {
            const struct column *p = &plane[c];
            float disc = p->arms * expf(-0.5f * zz / (p->height * p->height));
            float core = expf(-0.5f * (p->rr + 2 * zz) / (bulge * bulge));
            slice[c] = (uint16_t)(4000 * (disc + core * (1 - disc)) + 0.5f);
        }
    }
}

const struct sp_demo_maker sp_demo_galaxy = {
    .demo = { "galaxy", "a spiral on a rectilinear grid, fine in the middle, coarse outside", 96 },
    .type = SP_UINT16,
    .shape = shape_galaxy,
    .grade = grade,
    .prepare = prepare_galaxy,
    .fill = fill_galaxy,
};
