/* SPDX-License-Identifier: Apache-2.0
 *
 * The grid of the slices of one step, which are sorted.
 */
#ifndef SP_IMPORT_DICOM_GRID_H
#define SP_IMPORT_DICOM_GRID_H

#include "data/import/dicom_slices.h"

/* Fills the grid, its unit and anatomy, and warns of gaps. `*places` receives the coordinates of
 * the slices or NULL; free() them after close(). */
bool dicom_grid_fill(const struct dicom_slices *slices, const struct dicom_source *source,
                     struct import_header *header, double **places, struct sp_error *err);

/* Warns if images of one place, which become fields or steps, lie beside each other, as the images
 * of two knees do. The slices are sorted. */
void dicom_grid_warn_of_sides(const struct dicom_slices *slices, const struct dicom_source *source);

#endif
