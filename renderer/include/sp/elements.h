/* SPDX-License-Identifier: Apache-2.0
 *
 * What a volume consists of if it has no grid: points, Gaussians or triangles, in no order.
 *
 *   points      a scalar each, and perhaps a vector; drawn like voxels, through the transfer
 *               function
 *   gaussians   a trained scene (Kerbl et al. 2023): opacity and colour each, by direction
 *   mesh        triangles with colours and normals per vertex
 *
 * The grid of such a volume is the box around its elements: one sample, which is not finite.
 * Elements lie in the memory of the volume (sp_volume_elements()) and never change.
 */
#ifndef SP_ELEMENTS_H
#define SP_ELEMENTS_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/api.h"

#ifdef __cplusplus
extern "C" {
#endif

enum sp_kind { SP_KIND_GRID, SP_KIND_POINTS, SP_KIND_GAUSSIANS, SP_KIND_MESH, SP_KIND_COUNT };

enum {
    SP_ELEMENTS_MAX = 1 << 28, /* points, Gaussians, triangles, or vertices of a volume */
    SP_HARMONICS_DEGREE_MAX = 3
};

struct sp_elements_shape {
    enum sp_kind kind;
    uint32_t count;        /* points, Gaussians or triangles, [0, SP_ELEMENTS_MAX]; grid: 0 */
    uint32_t vertex_count; /* mesh: [0, SP_ELEMENTS_MAX] */
    uint32_t degree;       /* gaussians: of the spherical harmonics, [0, SP_HARMONICS_DEGREE_MAX] */
    bool has_vectors;      /* points: one each */
};

/* Arrays that the kind does not have are NULL. Numbers may be anything, unless a comment says
 * otherwise: an element that is not finite is not drawn. */
struct sp_elements {
    struct sp_elements_shape shape;
    float (*positions)[3]; /* [count]; mesh: [vertex_count]. World units */
    /* points, gaussians: L00, L10, L11, L20, L21, L22 of a triangular matrix L: L·Lᵀ is the
     * variance [world unit²]. May be singular, or 0. */
    float (*factors)[6];
    float *values;  /* points: scalars, data unit */
    float *volumes; /* points: of the space around each, > 0 [world unit³] */
    /* points with vectors: along the axes of the world of the data [data unit] */
    float (*vectors)[3];
    float *opacities; /* gaussians: at the centre, [0, 1] */
    /* gaussians: [count][(degree + 1)²][3] coefficients of red, green and blue. The colour is
     * 0.5 + Σ coefficient · harmonic(direction from the eye), at least 0. */
    float *harmonics;
    float (*normals)[3];      /* mesh: [vertex_count], of any length; 0 = not known */
    float (*colors)[4];       /* mesh: [vertex_count] sRGB and opacity, [0, 1] */
    uint32_t (*triangles)[3]; /* mesh: [count] vertices, < vertex_count */
};

/* Returns the name that the protocol uses: "grid", "points", "gaussians", "mesh". A constant
 * string. */
SP_API const char *sp_kind_name(enum sp_kind kind);

/* Coefficients of spherical harmonics per colour. */
static inline uint32_t sp_harmonics_count(uint32_t degree) {
    return (degree + 1) * (degree + 1);
}

#ifdef __cplusplus
}
#endif

#endif
