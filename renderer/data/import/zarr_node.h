/* SPDX-License-Identifier: Apache-2.0
 *
 * The metadata of one group or array: the JSON of Zarr v2 (.zgroup, .zarray, .zattrs) or v3
 * (zarr.json).
 */
#ifndef SP_IMPORT_ZARR_NODE_H
#define SP_IMPORT_ZARR_NODE_H

#include <jansson.h>

#include "data/import/zarr_store.h"

struct zarr_node {
    const struct zarr_store *store;
    char path[ZARR_KEY_BYTES]; /* "" = the root */
    int version;               /* 2 or 3 */
    bool is_array;
    const char *name;         /* of the file: ".zarray", ".zgroup" or "zarr.json"; constant */
    json_t *metadata;         /* owned; an object */
    const json_t *attributes; /* an object, which may be empty */
    json_t *separate;         /* owned: the attributes of v2; NULL = none */
};

/* Reads the metadata at a path. ZARR_MISSING if nothing is there. */
enum zarr_found zarr_node_open(struct zarr_node *node, const struct zarr_store *store,
                               const char *path, struct sp_error *err);
void zarr_node_close(struct zarr_node *node);

/* Fails at a pointer into the metadata. */
__attribute__((format(printf, 5, 6))) bool zarr_node_fail(const struct zarr_node *node,
                                                          struct sp_error *err, enum sp_code code,
                                                          const char *pointer, const char *format,
                                                          ...);

#endif
