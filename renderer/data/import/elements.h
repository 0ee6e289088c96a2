/* SPDX-License-Identifier: Apache-2.0
 *
 * Computes data of elements that a file does not give: the size of points, and the normals of a
 * mesh.
 */
#ifndef SP_IMPORT_ELEMENTS_H
#define SP_IMPORT_ELEMENTS_H

#include "data/import/format.h"

/* Completes the elements once they are read. Normals are the sums of the normals of the triangles
 * at a vertex, weighted by area; triangles whose vertices do not exist add nothing. *folded is as
 * in struct sp_volume_info. Warns of elements that are not drawn. SP_ERR_MEMORY. */
bool import_elements_finish(const struct import_file *file, const struct import_header *header,
                            const struct sp_elements *elements,
                            const struct import_progress *progress, uint64_t *folded,
                            struct sp_error *err);

#endif
