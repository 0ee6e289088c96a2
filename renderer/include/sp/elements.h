/* SPDX-License-Identifier: Apache-2.0
 *
 * The elements of a volume without a grid: points, Gaussians or triangles, in no order.
 *
 *   points      a scalar and optionally a vector per point; drawn like voxels, through the transfer
 *               function
 *   gaussians   a trained scene (Kerbl et al. 2023): opacity and view-dependent colour per Gaussian
 *   mesh        triangles with colours and normals per vertex
 *
 * The grid of such a volume is the box around its elements. It has one sample, which is not finite.
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
    SP_ELEMENTS_MAX = 1 << 28, /* largest number of points, Gaussians, triangles or vertices */
    SP_HARMONICS_DEGREE_MAX = 3
};

struct sp_elements_shape {
    enum sp_kind kind;
    uint32_t count;        /* points, Gaussians or triangles, [0, SP_ELEMENTS_MAX]; grid: 0 */
    uint32_t vertex_count; /* mesh: [0, SP_ELEMENTS_MAX] */
    /* gaussians: degree of the spherical harmonics, [0, SP_HARMONICS_DEGREE_MAX] */
    uint32_t degree;
    bool has_vectors; /* points: each has a vector */
    /* mesh: no vertex has a colour of its own; `colors` has opacities alone. Layers draw the mesh
     * in their own colour. */
    bool lacks_colors;
};

/* An array that the kind does not have is NULL. Unless a comment says otherwise, numbers may have
 * any value; an element with a NaN or infinite number is not drawn. */
struct sp_elements {
    struct sp_elements_shape shape;
    float (*positions)[3]; /* [count]; mesh: [vertex_count]. World units */
    /* points, gaussians: L00, L10, L11, L20, L21, L22 of a triangular matrix L: L·Lᵀ is the
     * variance [world unit²]. L may be singular, or 0. */
    float (*factors)[6];
    float *values;  /* points: scalars [data unit] */
    float *volumes; /* points: volume of the space around each point, > 0 [world unit³] */
    /* points with vectors: components along the world axes of the data [data unit] */
    float (*vectors)[3];
    float *opacities; /* gaussians: opacity at the centre, [0, 1] */
    /* gaussians: [count][(degree + 1)²][3] coefficients of red, green and blue. The colour is
     * 0.5 + Σ coefficient · harmonic(direction from the eye), at least 0. */
    float *harmonics;
    float (*normals)[3];      /* mesh: [vertex_count], of any length; 0 = not known */
    float (*colors)[4];       /* mesh: [vertex_count] sRGB and opacity, [0, 1] */
    uint32_t (*triangles)[3]; /* mesh: [count] vertices, < vertex_count */
};

/* Returns the name of the kind in the protocol: "grid", "points", "gaussians", "mesh". A constant
 * string. */
SP_API const char *sp_kind_name(enum sp_kind kind);

/* Returns the number of coefficients of spherical harmonics per colour. */
static inline uint32_t sp_harmonics_count(uint32_t degree) {
    return (degree + 1) * (degree + 1);
}

#ifdef __cplusplus
}
#endif

#endif
