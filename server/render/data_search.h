/* SPDX-License-Identifier: Apache-2.0
 *
 * A search of the data folder by name: a folder and the folders below it, nearest first. It stops
 * at the first of three limits and says which. It does not enter symbolic links, hidden folders and
 * Zarr hierarchies that are one volume.
 *
 * Many files that open as one volume are one hit: numbered files of a folder as a time series, if
 * all of them match, and all matching DICOM files of a folder.
 */
#ifndef SRV_RENDER_DATA_SEARCH_H
#define SRV_RENDER_DATA_SEARCH_H

#include "render/data_folder.h"

struct srv_data_hit {
    struct srv_data_entry entry; /* of a time series its name has '*' for each number */
    const char *folder;          /* relative to the data folder; owned by the search */
    unsigned files;              /* that open together; 1 = a folder, or a file of its own */
};

enum srv_data_cut { SRV_DATA_CUT_NONE, SRV_DATA_CUT_LIMIT, SRV_DATA_CUT_TIME, SRV_DATA_CUT_NAMES };

struct srv_data_search {
    /* Set by the caller. */
    const char *data;
    const char *text;          /* words; a name matches if it has all of them (proto_text_fold()) */
    struct srv_data_hit *hits; /* the caller's array of `hits_max` */
    unsigned hits_max;
    unsigned names_max; /* names that are read */
    double end_ms;      /* srv_clock_ms() at which it stops */
    /* Results. */
    unsigned count;
    unsigned unlisted; /* matching entries, and folders, whose names are not UTF-8 */
    unsigned unread;   /* folders below the first that cannot be read */
    enum srv_data_cut cut;
    /* The folders that were found, relative to the data folder, in the order of the search. */
    char **folders;
    unsigned folder_count, folder_capacity;
};

/* True if a text can be searched for: 1 to 255 characters, not only spaces. Otherwise
 * SP_ERR_INVALID with the place "/find". */
bool srv_data_search_check(const char *text, struct sp_error *err);

/* Searches the folder `path`. Blocks. The errors of srv_data_list(); SP_ERR_MEMORY. */
bool srv_data_search(struct srv_data_search *search, const char *path, struct sp_error *err);

/* Frees the folders of the search, also after an error. */
void srv_data_search_finish(struct srv_data_search *search);

#endif
