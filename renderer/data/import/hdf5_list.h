/* SPDX-License-Identifier: Apache-2.0
 *
 * Lists the arrays of an HDF5 file: data sets, their other names, links, and the array that NeXus
 * names.
 */
#ifndef SP_IMPORT_HDF5_LIST_H
#define SP_IMPORT_HDF5_LIST_H

#include <hdf5.h>

#include "data/import/array_bridge.h"

struct hdf5_entry {
    char name[ARRAY_NAME_BYTES]; /* the path, with '/' before it */
    haddr_t address;             /* of a data set; HADDR_UNDEF = a link that leads nowhere */
    bool is_alias;               /* a link, or another name of a data set before it */
    char problem[256];           /* of a link: why it cannot be read */
    struct array_info *info;     /* owned; NULL = not described yet */
};

struct hdf5_list {
    struct hdf5_entry *entries; /* owned */
    unsigned count;
    unsigned preferred; /* the signal that NeXus names, + 1; 0 = none */
    unsigned signals;   /* groups with a signal */
    char signal[ARRAY_NAME_BYTES];
};

/* False without memory, or if the file is damaged. */
bool hdf5_list_fill(struct hdf5_list *list, hid_t file);
void hdf5_list_finish(struct hdf5_list *list);

/* Names the dimensions of a signal and their coordinates, as its group (NXdata) says. */
void hdf5_read_nexus(hid_t file, hid_t dataset, struct array_info *info);

/* Looks for the files of a virtual data set, or of external storage, by its creation properties.
 * Writes why it cannot be read; *problem stays "" if it can. */
void hdf5_check_sources(const struct array_place *place, hid_t file, hid_t properties,
                        char *problem, size_t capacity);

#endif
