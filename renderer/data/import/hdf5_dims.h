/* SPDX-License-Identifier: Apache-2.0
 *
 * What an array of HDF5 says about its dimensions.
 */
#ifndef SP_IMPORT_HDF5_DIMS_H
#define SP_IMPORT_HDF5_DIMS_H

#include <hdf5.h>

#include "data/import/array_bridge.h"

/* Fills the names and scales of the dimensions, whether the array is a scale itself, and whether
 * NetCDF wrote the file. The rank must be set. */
void hdf5_read_dimensions(hid_t file, hid_t dataset, struct array_info *info);

/* Names the dimensions of a mesh of openPMD (axisLabels), unless they have names. */
void hdf5_read_labels(hid_t file, hid_t dataset, struct array_info *info);

/* Reads an attribute of one text, or of letters, as text(): "" if there is none. */
void hdf5_text(hid_t object, const char *name, char *out, size_t capacity);

/* Reads an attribute of texts; returns how many, 0 if there is none or too many. */
unsigned hdf5_texts(hid_t object, const char *name, char out[IMPORT_RANK_MAX][ARRAY_NAME_BYTES]);

/* Closes a type, a space or an attribute; a negative number is none. */
static inline void hdf5_close(hid_t id) {
    if (id >= 0)
        H5Idec_ref(id);
}

#endif
