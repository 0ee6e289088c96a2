/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/itk_hdf5.h"

#include <stdio.h>
#include <string.h>

enum { DIMENSIONS_MAX = ARRAYS_SIDE_MAX };

static bool is_itk(const struct arrays *a) {
    return strcmp(a->info.name, ITK_HDF5_VOXELS) == 0;
}

static bool read_numbers(const struct arrays *a, const char *name, unsigned rank, unsigned side,
                         double *out) {
    char path[64];
    snprintf(path, sizeof path, "/ITKImage/0/%s", name);
    return arrays_read_numbers(a, path, rank, side, out);
}

/* The number of axes of the image; 0 = unknown. */
static unsigned axes_of(const struct arrays *a) {
    double sizes[DIMENSIONS_MAX];
    for (unsigned count = 2; count <= DIMENSIONS_MAX; count++)
        if (read_numbers(a, "Dimension", 1, count, sizes))
            return a->info.rank == count || a->info.rank == count + 1 ? count : 0;
    return 0;
}

void itk_hdf5_name_dimensions(struct arrays *a) {
    static const char *const names[DIMENSIONS_MAX] = { "x", "y", "z", "t" };
    const unsigned count = is_itk(a) ? axes_of(a) : 0;
    for (unsigned d = 0; d < count; d++)
        strcpy(a->info.dims[count - 1 - d], names[d]);
    if (count > 0 && a->info.rank > count)
        strcpy(a->info.dims[count], "component");
}

void itk_hdf5_place(const struct arrays *a, struct import_header *header) {
    const unsigned count = is_itk(a) ? axes_of(a) : 0, space = count < 3 ? count : 3;
    double spacing[DIMENSIONS_MAX], origin[DIMENSIONS_MAX],
        directions[DIMENSIONS_MAX * DIMENSIONS_MAX];
    if (count == 0)
        return;
    bool is_known = read_numbers(a, "Spacing", 1, count, spacing) &&
                    read_numbers(a, "Origin", 1, count, origin);
    for (unsigned axis = 0; is_known && axis < count; axis++)
        is_known = spacing[axis] > 0;
    if (!is_known) {
        import_warn(a->file->warnings, "The image of ITK has no valid Spacing and Origin; they "
                                       "were left out.");
        return;
    }
    for (unsigned axis = 0; axis < space; axis++) {
        header->grid.spacing[axis] = spacing[axis];
        header->grid.origin[axis] = origin[axis];
    }
    if (space < 3) /* a flat image is as thick as its pixels are wide */
        header->grid.spacing[2] = spacing[0];
    if (a->axes.time >= 0 && count > 3)
        import_header_use_interval(header, origin[3], spacing[3], "");
    if (!read_numbers(a, "Directions", 2, count, directions))
        import_warn(a->file->warnings,
                    "The image of ITK has no valid Directions; its axes are those of the world.");
    else /* a row per axis of the image */
        for (unsigned axis = 0; axis < space; axis++)
            for (unsigned to = 0; to < space; to++)
                header->grid.direction[to][axis] = directions[axis * count + to];
    snprintf(header->unit, sizeof header->unit, "mm");
    if (space == 3)
        import_header_set_anatomy(header, "LPS");
}
