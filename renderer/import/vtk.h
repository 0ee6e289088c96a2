/* SPDX-License-Identifier: Apache-2.0
 *
 * The common part of legacy and XML VTK files: both describe a grid and the place of an array of
 * samples. These readers are our own on top of expat and zlib, because libvtk depends on 176
 * packages.
 */
#ifndef SP_IMPORT_VTK_H
#define SP_IMPORT_VTK_H

#include "import/vtk_array.h"

struct vtk_volume { /* a reader of either format */
    const struct import_file *file;
    struct vtk_array samples, vectors; /* without a type if the file has none */
    double *positions[3];              /* owned; of a rectilinear grid */
};

/* Completes and checks *header once the file's header is read: copies the sample type and the
 * positions, and adds the vectors. The names are those of the arrays. The grid must have dims,
 * spacing, origin and direction. `byte` and `field` are the place where the file describes the
 * grid, for errors. */
bool vtk_complete(struct vtk_volume *volume, struct import_header *header, uint64_t byte,
                  const char *field, struct sp_error *err);

/* read() and close() of struct import_format. */
bool vtk_read(void *volume, void *voxels, float (*vectors)[3],
              const struct import_progress *progress, struct sp_error *err);
void vtk_close(void *volume);

/* Appends a name to a list of what the file holds instead. A full list stays as it is. */
void vtk_list(char list[160], const char *name);

#endif
