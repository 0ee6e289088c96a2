/* SPDX-License-Identifier: Apache-2.0
 *
 * The data folder (--data): the only place from which clients may load files. Every path of a
 * client is resolved here, for loading and for listing.
 *
 * A path is followed name by name. The first name that leads out of the folder, by a symbolic link
 * or "..", ends the search. A link that leads nowhere gets the same error, so that an answer never
 * tells what exists outside. Files are opened again by the importer, which checks the path itself
 * (renderer/data/import/confine.h).
 */
#ifndef SRV_RENDER_DATA_FOLDER_H
#define SRV_RENDER_DATA_FOLDER_H

#include <dirent.h>
#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

#include "common/pagination.h"
#include "sp/elements.h"
#include "sp/status.h"

/* Resolves a path relative to `data`, a resolved folder; NULL = none. An absolute path, as the
 * daemon stores it, must also lie below `data`. `pointer` is the place of errors. False:
 * SP_ERR_DENIED (no data folder, or not readable), SP_ERR_INVALID (too long), SP_ERR_NOT_FOUND
 * (missing, outside, or a link that leads nowhere), SP_ERR_MEMORY. */
bool srv_data_resolve(const char *data, const char *path, const char *pointer, char real[PATH_MAX],
                      struct sp_error *err);

/* True if a path that a client states is relative. Otherwise SP_ERR_INVALID. */
bool srv_data_check_relative(const char *path, const char *pointer, struct sp_error *err);

struct srv_data_entry {
    /* First, as struct srv_page requires: "/NAME" for a folder and ":NAME" for a volume, so that
     * folders come first. */
    char key[NAME_MAX + 2];
    bool is_folder;      /* to enter */
    bool is_zarr;        /* a folder that is a volume */
    uint64_t size_bytes; /* of a file */
    const char *format;  /* of a volume: "NRRD", … (formats.h); constant */
    uint32_t dims[3];    /* 0 = the file was not looked at, or does not say */
    char type[16];       /* "uint8", …; "" = as for dims */
    enum sp_kind kind;   /* SP_KIND_COUNT = the same */
};
#define srv_data_name(entry) ((entry)->key + 1)

/* Puts the folders and loadable files of a folder, and folders that are volumes, on a page of
 * struct srv_data_entry. `path` "" is the data folder itself. Leaves out names that begin with a
 * dot, links that lead out of the data folder, and names that are not UTF-8, which JSON cannot
 * carry; *unlisted is how many folders and loadable files of the whole folder have such a name.
 * Blocks while it reads the disk. Errors as above, with the place "/path"; SP_ERR_INVALID (not a
 * folder), SP_ERR_IO. */
bool srv_data_list(const char *data, const char *path, struct srv_page *page, unsigned *unlisted,
                   struct sp_error *err);

/* Opens a folder, and resolves its path. The caller closes it. NULL with the errors of
 * srv_data_list(). */
DIR *srv_data_open(const char *data, const char *path, char real[PATH_MAX], struct sp_error *err);

enum srv_data_sight {
    SRV_DATA_NOTHING, /* neither a folder nor a loadable file, hidden, or led outside by a link */
    SRV_DATA_UNLISTABLE, /* its name is not UTF-8 */
    SRV_DATA_ENTRY,
    SRV_DATA_LINK, /* an entry by a symbolic link that stays inside */
};
/* Looks at a name of an open folder, `fd`, whose resolved path is `folder`; fills *entry if it can
 * be listed. Blocks. */
enum srv_data_sight srv_data_look(const char *data, const char *folder, int fd, const char *name,
                                  struct srv_data_entry *entry);

/* Reads dims, type and kind from the beginning of a file that srv_data_list() found, if its format
 * has them there. Blocks. */
void srv_data_describe(const char *data, const char *path, struct srv_data_entry *entry);

#endif
