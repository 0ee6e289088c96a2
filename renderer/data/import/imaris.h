/* SPDX-License-Identifier: Apache-2.0
 *
 * Imaris files (.ims): HDF5 with an array for each level of detail, time point and channel. They
 * are shown as one array of the dimensions t, c, z, y and x.
 */
#ifndef SP_IMPORT_IMARIS_H
#define SP_IMPORT_IMARIS_H

#include "data/import/array_reader.h"

struct imaris;

/* If the open file is an Imaris file, replaces a->call and a->handle, so that they read its image
 * instead of its arrays. Closing the new handle also closes the file. *imaris is NULL if the file
 * is not an Imaris file, or if file->field names one of its arrays. */
bool imaris_open(struct arrays *a, struct imaris **imaris, struct sp_error *err);

/* After arrays_fill_header(): spacing, origin, unit, levels and times. */
bool imaris_place(const struct imaris *imaris, struct arrays *a, struct import_header *header,
                  struct sp_error *err);

#endif
