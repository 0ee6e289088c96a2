/* SPDX-License-Identifier: Apache-2.0
 *
 * The input of splat-import: a file, a folder, or splat-fetch, which fetches a remote hierarchy.
 */
#ifndef SP_IMPORT_INPUT_H
#define SP_IMPORT_INPUT_H

#include "data/import/child.h"
#include "data/import/place.h"

struct sp_import_input {
    int fds[2]; /* for sp_import_child_start(); −1 = not open */
    unsigned count;
    struct sp_import_child fetch;
    char folder[PATH_MAX]; /* resolved: the folder itself, or the folder of the file */
};

/* Opens the file of a place, or starts splat-fetch, which lies beside the program `importer`, for
 * hosts of the list `allowed` (address.h). SP_ERR_DENIED: the host is not allowed.
 * SP_ERR_UNSUPPORTED: there is no splat-fetch. */
bool sp_import_input_open(struct sp_import_input *input, const struct sp_import_place *place,
                          const char *importer, const char *allowed, struct sp_error *err);

/* Closes the descriptors, once the child has them: then splat-fetch ends with the child. */
void sp_import_input_hand_over(struct sp_import_input *input);

/* Ends splat-fetch and closes everything. May be called twice. */
void sp_import_input_close(struct sp_import_input *input);

/* Checks that the host of an address is allowed: SP_ERR_DENIED, SP_ERR_INVALID. */
bool sp_import_check_host(const char *address, const char *allowed, struct sp_error *err);

#endif
