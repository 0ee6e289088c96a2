/* SPDX-License-Identifier: Apache-2.0
 *
 * The part of assimp that mesh.c needs, for C. assimp is a module of its own, MESH_BRIDGE_MODULE
 * beside the program, which mesh.c loads when a file may be a mesh. The module exports one table of
 * functions, MESH_BRIDGE_SYMBOL. One file at a time, one thread.
 */
#ifndef SP_IMPORT_MESH_BRIDGE_H
#define SP_IMPORT_MESH_BRIDGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Bytes of a file. */
struct mesh_bytes {
    const unsigned char *start;
    size_t size;
};

/* Opens another file that a file names; assimp opens none by itself. The bytes must stay valid
 * until the mesh is closed. False: there is no such file, or it may not be read. */
typedef bool mesh_bridge_find(void *user, const char *name, struct mesh_bytes *bytes);

/* Triangles of one colour. The arrays belong to the bridge. */
struct mesh_bridge_part {
    uint32_t vertices, triangles;
    const float (*positions)[3];
    const float (*normals)[3]; /* NULL = not known */
    const float (*colors)[4];  /* factors on `color`; NULL = 1 */
    float color[4];
    bool has_colors; /* the file gives `colors` or `color` */
    bool is_linear;  /* colours are linear light, else sRGB */
};

struct mesh_bridge;

struct mesh_bridge_functions {
    /* Reads a mesh. `extension` is "stl", "obj", "gltf" or "glb". NULL on failure, with *err set
     * but for its place. */
    struct mesh_bridge *(*open)(const struct mesh_bytes *bytes, const char *extension,
                                mesh_bridge_find *find, void *user, struct sp_error *err);
    void (*close)(struct mesh_bridge *bridge);
    /* Describes part n, from 0; false if there is none. A part may be empty. */
    bool (*part)(const struct mesh_bridge *bridge, unsigned n, struct mesh_bridge_part *part);
    /* Passes the triangles of part n to add() until it returns false. */
    bool (*triangles)(const struct mesh_bridge *bridge, unsigned n,
                      bool (*add)(void *user, const uint32_t vertices[3]), void *user);
    /* The same with the points of the lines of part n; `begins`: of the first point of a line. */
    bool (*lines)(const struct mesh_bridge *bridge, unsigned n,
                  bool (*add)(void *user, uint32_t vertex, bool begins), void *user);
};

#define MESH_BRIDGE_MODULE "splat-import-mesh.so"
#define MESH_BRIDGE_SYMBOL "splat_mesh_bridge"
extern const struct mesh_bridge_functions splat_mesh_bridge;

#ifdef __cplusplus
}
#endif
#endif
