/* SPDX-License-Identifier: Apache-2.0
 *
 * Checks the bytes of a mesh before assimp reads them: assimp names no place in its errors, and
 * follows nested data by recursion until the stack overflows.
 */
#ifndef SP_IMPORT_MESH_CHECK_H
#define SP_IMPORT_MESH_CHECK_H

#include "data/import/format.h"
#include "data/import/mesh_bridge.h"

enum { IMPORT_NODES_DEEP = 500 /* levels of nodes of a glTF file */ };

/* STL: the size of a binary file must be that of its triangles. Bytes behind them are cut off with
 * a warning. *is_empty: it has no triangles, which assimp refuses. Text passes. */
bool import_stl_check(const struct import_file *file, struct mesh_bytes *bytes, bool *is_empty,
                      struct sp_error *err);

/* After assimp has refused a file: false with *err set for the first word of an STL text that does
 * not belong there, or the first line of an OBJ file that is wrong; true if there is none.
 * *is_empty: the file is valid, but has nothing to draw. */
bool import_stl_explain(const struct import_file *file, const struct mesh_bytes *bytes,
                        bool *is_empty, struct sp_error *err);
bool import_obj_explain(const struct import_file *file, const struct mesh_bytes *bytes,
                        bool *is_empty, struct sp_error *err);

/* glTF, as text or binary: JSON whose nodes are a tree of at most IMPORT_NODES_DEEP levels.
 * *is_empty: it has no meshes; assimp refuses such a file if it has no scene either. */
bool import_gltf_check(const struct import_file *file, const struct mesh_bytes *bytes,
                       bool *is_empty, struct sp_error *err);

#endif
