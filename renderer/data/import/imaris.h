/* SPDX-License-Identifier: Apache-2.0
 *
 * Imaris files (.ims): HDF5 with an array for each level of detail, time point and channel. They
 * are shown as one array of the dimensions t, c, z, y and x.
 */
#ifndef SP_IMPORT_IMARIS_H
#define SP_IMPORT_IMARIS_H

#include "data/import/array_reader.h"

struct imaris;

/* If the open file is one of Imaris, puts its image in place of the arrays: a->call and a->handle,
 * which closes the file, too. *imaris is NULL if it is none, or if file->field names one of the
 * arrays. */
bool imaris_open(struct arrays *a, struct imaris **imaris, struct sp_error *err);

/* After arrays_fill_header(): spacing, origin, unit, levels and times. */
bool imaris_place(const struct imaris *imaris, struct arrays *a, struct import_header *header,
                  struct sp_error *err);

#endif
