/* SPDX-License-Identifier: Apache-2.0
 *
 * Resolves a source to a file: the file itself, the metadata of a Zarr folder, or the first of
 * numbered files. For any other folder, the importer decides (folder.c), because it may read files.
 */
#ifndef SP_IMPORT_PLACE_H
#define SP_IMPORT_PLACE_H

#include <limits.h>

#include "sp/volume.h"

struct sp_import_place {
    char path[PATH_MAX];       /* of the source, then of its file; the name in errors */
    char file[PATH_MAX];       /* what to open for `path`, below `root` */
    char series[NAME_MAX + 1]; /* pattern of the files of a time series; "" = no series */
    char name[SP_NAME_BYTES];  /* of the volume; cut if it is too long */
    char root[PATH_MAX];       /* resolved; files are read only below it */
    const char *given_root;    /* borrowed; NULL = none */
    bool is_remote;            /* `path` is an address, and there is no file */
    bool is_folder;            /* `path` is a folder */
};

/* Fills in everything from `path`. Without `root`, the root is the folder itself, or the folder of
 * the file; for an array in a Zarr hierarchy it is the folder of the outermost group. Fails for a
 * folder of chunks. */
bool sp_import_place_resolve(struct sp_import_place *place, const char *root, struct sp_error *err);

#endif
