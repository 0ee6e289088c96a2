/* SPDX-License-Identifier: Apache-2.0
 *
 * What the two kinds of VTK files have in common: both describe a grid, name an array of samples
 * and say where it is.
 */
#ifndef SP_IMPORT_VTK_H
#define SP_IMPORT_VTK_H

#include "import/vtk_array.h"

struct vtk_volume { /* the reader of either format */
    const struct import_file *file;
    struct vtk_array samples;
    double *positions[3]; /* owned; of a rectilinear grid */
};

/* When the header is read: takes the samples' type and the positions into *header, whose grid has
 * dims, spacing, origin and direction, and checks everything that it then says. `byte` and `field`
 * are where the file describes the grid. */
bool vtk_complete(struct vtk_volume *volume, struct import_header *header, uint64_t byte,
                  const char *field, struct sp_error *err);

/* The last two calls of struct import_format. */
bool vtk_read(void *volume, void *voxels, const struct import_progress *progress,
              struct sp_error *err);
void vtk_close(void *volume);

/* Adds "NAME, " or, when it is full, nothing to a list of what a file holds instead. */
void vtk_list(char list[160], const char *name);

#endif
