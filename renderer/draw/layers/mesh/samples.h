/* SPDX-License-Identifier: Apache-2.0
 *
 * The positions of the samples of a pixel: sixteen places of which no two share a row or a column
 * of 1/16 px, so that horizontal and vertical edges have as many steps of coverage as other edges.
 * Their mean is the middle of the pixel.
 */
#ifndef SP_MESH_SAMPLES_H
#define SP_MESH_SAMPLES_H

#include "base/wide.h"
#include "draw/layers/mesh/kernels.h"

enum { SP_MESH_VECTORS = SP_MESH_SAMPLES / SP_WIDE };

/* Offsets from the middle of the pixel [px]. */
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

/* Fills *sheet: per sample of the tile, the nearest triangle of the mesh, or the nearest triangle
 * behind the sheet `before`. before: NULL = the first sheet. Returns false if no sample has a
 * triangle. */
bool sp_mesh_cover(const struct sp_mesh *mesh, const struct sp_fragment_tile *tile,
                   const struct sp_mesh_sheet *before, struct sp_mesh_sheet *sheet);

#endif
