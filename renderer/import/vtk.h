/* SPDX-License-Identifier: Apache-2.0
 *
 * The common part of legacy and XML VTK files: both describe a grid or points, and the place of an
 * array of samples. These readers are our own on top of expat and zlib, because libvtk depends on
 * 176 packages.
 */
#ifndef SP_IMPORT_VTK_H
#define SP_IMPORT_VTK_H

#include "import/vtk_mesh.h"

/* The data sets that a file may have. */
enum vtk_set { VTK_NO_SET, VTK_IMAGE, VTK_RECTILINEAR, VTK_STRUCTURED, VTK_UNSTRUCTURED, VTK_POLY };

/* True if the data set gives the position of each point. */
static inline bool vtk_has_points(enum vtk_set set) {
    return set >= VTK_STRUCTURED;
}

struct vtk_volume { /* a reader of either format */
    const struct import_file *file;
    struct vtk_array samples, vectors; /* without a type if the file has none */
    double *positions[3];              /* owned; of a rectilinear grid */
    struct vtk_array points;           /* positions of points; without a type if there are none */
    uint32_t dims[3];                  /* of a structured grid */
    enum import_derived derived;       /* how values of points come from the vectors */
    struct vtk_mesh mesh;              /* of a data set of polygons */
};

/* The place of an image. */
struct vtk_image {
    double origin[3], spacing[3], direction[9];
    int32_t first[3]; /* index of the first sample; an extent may start at any */
};

/* Sets the grid's place; the axes of `direction` must have unit length. */
bool vtk_place_image(const struct import_file *file, const struct vtk_image *image,
                     struct import_header *header, uint64_t byte, struct sp_error *err);

/* How well the vectors of this name suit: 3 if the caller names them or a field that comes from
 * them, 2 if they are what the reader looks for (`is_usual`), 1 otherwise. The first of the best is
 * read. */
unsigned vtk_rank_vectors(const struct import_file *file, const char *name, bool is_usual);

/* Completes and checks *header once the file's header is read: copies the sample type and the
 * positions, and adds the vectors. The names are those of the arrays. The grid must have dims,
 * spacing, origin and direction. `byte` and `field` are the place where the file describes the
 * grid, for errors. */
bool vtk_complete(struct vtk_volume *volume, struct import_header *header, uint64_t byte,
                  const char *field, struct sp_error *err);

/* The same for a data set with `count` points, whose positions are in `points`. Polygons, strips
 * and lines are a mesh. If the source names a field, the data set is points with that field. */
bool vtk_complete_points(struct vtk_volume *volume, struct import_header *header, uint64_t count,
                         enum vtk_set set, uint64_t byte, const char *field, struct sp_error *err);

/* Warns that the cells of an unstructured grid are not drawn. */
void vtk_warn_of_cells(const struct import_file *file, uint64_t count);

/* read(), read_elements() and close() of struct import_format. */
bool vtk_read_elements(void *volume, const struct sp_elements *elements,
                       const struct import_progress *progress, struct sp_error *err);
bool vtk_read(void *volume, void *voxels, float (*vectors)[3],
              const struct import_progress *progress, struct sp_error *err);
void vtk_close(void *volume);

/* Appends a name to a list of what the file holds instead. A full list stays as it is. */
void vtk_list(char list[160], const char *name);

#endif
