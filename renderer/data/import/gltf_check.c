/* SPDX-License-Identifier: Apache-2.0 */
#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/mesh_check.h"

/* The JSON text: the file itself, or the first chunk of a binary file. */
static struct mesh_bytes extract_text(const struct mesh_bytes *bytes) {
    uint32_t head[5];
    if (bytes->size < sizeof head || memcmp(bytes->start, "glTF", 4) != 0)
        return *bytes;
    memcpy(head, bytes->start, sizeof head); /* magic, version, length; length and kind of chunk */
    const size_t rest = bytes->size - sizeof head;
    return (struct mesh_bytes){ bytes->start + sizeof head, head[3] < rest ? head[3] : rest };
}

/* The parents of the nodes, or -1. False with *err set if a node has two. */
static bool fill_parents(const struct import_file *file, const json_t *nodes, int64_t *parents,
                         struct sp_error *err) {
    const size_t count = json_array_size(nodes);
    for (size_t i = 0; i < count; i++)
        parents[i] = -1;
    for (size_t i = 0; i < count; i++) {
        const json_t *children = json_object_get(json_array_get(nodes, i), "children");
        for (size_t k = 0; k < json_array_size(children); k++) {
            const json_int_t child = json_integer_value(json_array_get(children, k));
            if (child < 0 || child >= (json_int_t)count) /* assimp refuses it */
                continue;
            if (parents[child] >= 0)
                return sp_fail(err, SP_ERR_FORMAT, file->title,
                               "node %lld is a child of the nodes %lld and %zu, but nodes must be "
                               "a tree",
                               (long long)child, (long long)parents[child], i);
            parents[child] = (int64_t)i;
        }
    }
    return true;
}

static bool check_nodes(const struct import_file *file, const json_t *nodes, struct sp_error *err) {
    const size_t count = json_array_size(nodes);
    int64_t *parents = malloc((count + 1) * sizeof *parents);
    if (!parents)
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for the nodes");
    bool ok = fill_parents(file, nodes, parents, err);
    for (size_t i = 0; ok && i < count; i++) {
        int levels = 1;
        for (int64_t at = parents[i]; at >= 0 && levels <= IMPORT_NODES_DEEP; at = parents[at])
            levels++;
        if (levels > IMPORT_NODES_DEEP)
            ok = sp_fail(err, SP_ERR_UNSUPPORTED, file->title,
                         "node %zu lies below %d others or more, or below itself; export the mesh "
                         "with fewer levels of nodes",
                         i, IMPORT_NODES_DEEP);
    }
    free(parents);
    return ok;
}

bool import_gltf_check(const struct import_file *file, const struct mesh_bytes *bytes,
                       bool *is_empty, struct sp_error *err) {
    const struct mesh_bytes text = extract_text(bytes);
    json_error_t why;
    /* Jansson refuses more than 2048 levels of brackets. */
    json_t *root = json_loadb((const char *)text.start, text.size,
                              JSON_ALLOW_NUL | JSON_DECODE_ANY | JSON_DISABLE_EOF_CHECK, &why);
    if (!root)
        return import_fail(
            err, json_error_code(&why) == json_error_out_of_memory ? SP_ERR_MEMORY : SP_ERR_FORMAT,
            file->title, (uint64_t)(text.start - bytes->start) + (uint64_t)why.position, "JSON",
            "%s", why.text);
    const bool ok = check_nodes(file, json_object_get(root, "nodes"), err);
    const json_t *meshes = json_object_get(root, "meshes");
    *is_empty = json_is_object(json_object_get(root, "asset")) &&
                (!meshes || (json_is_array(meshes) && json_array_size(meshes) == 0));
    json_decref(root);
    return ok;
}
