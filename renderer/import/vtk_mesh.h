/* SPDX-License-Identifier: Apache-2.0
 *
 * The cells of a VTK data set of polygons as a mesh: polygons become fans of triangles, strips
 * become triangles, and lines become tubes. A warning tells what is not drawn.
 */
#ifndef SP_IMPORT_VTK_MESH_H
#define SP_IMPORT_VTK_MESH_H

#include "import/mesh_parts.h"
#include "import/vtk_array.h"

enum vtk_cell_kind { VTK_VERTS, VTK_LINES, VTK_POLYS, VTK_STRIPS, VTK_CELL_KINDS };

struct vtk_cells {
    uint64_t count;          /* 0 = none */
    struct vtk_array points; /* of all cells, one after another; count 0 = that of the last end */
    struct vtk_array ends;   /* where each cell ends; without a type: each begins with its count */
    bool starts_at_0;        /* the first end is preceded by a 0, where the first cell begins */
    uint64_t at;             /* byte of the file, for errors; 0 = not seen */
};

/* The arrays have no type where the file has none. */
struct vtk_mesh {
    struct vtk_cells cells[VTK_CELL_KINDS];
    struct vtk_array normals, colors; /* of points */
    unsigned color_components;        /* 3 or 4 */
    bool has_cell_data;
    struct import_mesh_parts parts; /* owned */
};

/* True if there are polygons, strips or lines. */
bool vtk_mesh_is_there(const struct vtk_mesh *mesh);

/* Reads all cells and describes the mesh. `points`: positions of `count` points. */
bool vtk_mesh_open(struct vtk_mesh *mesh, const struct import_file *file,
                   const struct vtk_array *points, uint64_t count, struct import_header *header,
                   struct sp_error *err);

#endif
