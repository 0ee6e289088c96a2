/* SPDX-License-Identifier: Apache-2.0
 *
 * Where the samples of a pixel lie: sixteen places of which no two share a row or a column of 1/16
 * px, so that level and upright edges have as many steps as others. Their mean is the middle.
 */
#ifndef SP_MESH_SAMPLES_H
#define SP_MESH_SAMPLES_H

#include "base/wide.h"
#include "draw/layers/mesh/kernels.h"

enum { SP_MESH_VECTORS = SP_MESH_SAMPLES / SP_WIDE };

/* From the middle of the pixel, px. */
#define SP_MESH_AT(i) (((float)(i) + 0.5f) / 16)
static const float sp_mesh_dx[SP_MESH_SAMPLES] = {
    SP_MESH_AT(1),  SP_MESH_AT(-1), SP_MESH_AT(-3), SP_MESH_AT(4),  SP_MESH_AT(-5), SP_MESH_AT(2),
    SP_MESH_AT(5),  SP_MESH_AT(3),  SP_MESH_AT(-2), SP_MESH_AT(0),  SP_MESH_AT(-4), SP_MESH_AT(-6),
    SP_MESH_AT(-8), SP_MESH_AT(7),  SP_MESH_AT(6),  SP_MESH_AT(-7),
};
static const float sp_mesh_dy[SP_MESH_SAMPLES] = {
    SP_MESH_AT(1), SP_MESH_AT(-3), SP_MESH_AT(2), SP_MESH_AT(-1), SP_MESH_AT(-2), SP_MESH_AT(5),
    SP_MESH_AT(3), SP_MESH_AT(-5), SP_MESH_AT(6), SP_MESH_AT(-7), SP_MESH_AT(-6), SP_MESH_AT(4),
    SP_MESH_AT(0), SP_MESH_AT(-4), SP_MESH_AT(7), SP_MESH_AT(-8),
};
#undef SP_MESH_AT

/* Finds which samples of a tile the entries of the mesh cover: per sample the nearest triangle, or
 * the nearest behind `before`. Returns false if there is none. */
bool sp_mesh_cover(const struct sp_mesh *mesh, const struct sp_fragment_tile *tile,
                   const struct sp_mesh_sheet *before, struct sp_mesh_sheet *sheet);

#endif
