/* SPDX-License-Identifier: Apache-2.0
 *
 * The names in a folder, in the order of the numbers in them. Leaves out hidden names, which begin
 * with a dot.
 */
#ifndef SP_IMPORT_FOLDER_H
#define SP_IMPORT_FOLDER_H

#include "data/import/numbered.h"

/* Adds the names of the regular files (symbolic links count as files) or of the folders in
 * `folder`, a path, up to `most` names in all. Adds nothing if it cannot be listed. Each is
 * "PREFIX/NAME", or NAME with the prefix "". False if there is no memory. */
bool import_names_add(struct import_names *list, const char *folder, const char *prefix,
                      bool are_folders, uint32_t most);

/* Sorts the names from number `first` on. */
void import_names_sort(struct import_names *list, uint32_t first);

#endif
