/* SPDX-License-Identifier: Apache-2.0
 *
 * Text of OBJ and STL files with its vertices moved near 0, before assimp rounds them to float32.
 */
#ifndef SP_IMPORT_MESH_TEXT_H
#define SP_IMPORT_MESH_TEXT_H

#include "import/mesh_bridge.h"
#include "import/shift.h"

/* The word before the coordinates of a vertex; NULL if the file is not text. `extension` is "obj",
 * "stl" or another one. */
const char *import_mesh_text_word(const char *extension, const struct mesh_bytes *bytes);

/* Copies the text with the offset subtracted from the coordinates behind each `word` that begins a
 * line. The caller frees *text, the bytes of *moved. False without memory. */
bool import_mesh_text_move(const struct mesh_bytes *bytes, const char *word,
                           struct import_shift *shift, char **text, struct mesh_bytes *moved);

#endif
