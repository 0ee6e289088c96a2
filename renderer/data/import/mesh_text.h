/* SPDX-License-Identifier: Apache-2.0
 *
 * Text of OBJ and STL files with its vertices moved near 0, before assimp rounds them to float32.
 */
#ifndef SP_IMPORT_MESH_TEXT_H
#define SP_IMPORT_MESH_TEXT_H

#include "data/import/mesh_bridge.h"
#include "data/import/shift.h"

/* What is before the coordinates of a vertex. */
struct mesh_word {
    const char *text;
    bool begins_line; /* the first word of its line; else one that ends at a space */
};

/* NULL if the file is not text. `extension` is "obj", "stl" or another one. */
const struct mesh_word *import_mesh_text_word(const char *extension,
                                              const struct mesh_bytes *bytes);

/* Copies the text with the offset subtracted from the coordinates behind each word. If there is
 * none, or one without three numbers, the offset becomes 0 and *moved the text itself. The caller
 * frees *text, which has the bytes of *moved otherwise. False without memory. */
bool import_mesh_text_move(const struct mesh_bytes *bytes, const struct mesh_word *word,
                           struct import_shift *shift, char **text, struct mesh_bytes *moved);

#endif
