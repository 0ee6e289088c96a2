/* SPDX-License-Identifier: Apache-2.0
 *
 * Grids whose place programs write in their own way into HDF5 files:
 *
 *   openPMD    attributes of the mesh: gridSpacing, gridGlobalOffset, gridUnitSI, position; the
 *              bridge takes the names of the dimensions (axisLabels)
 *   DREAM.3D   SPACING and ORIGIN of the cells, in the group _SIMPL_GEOMETRY, or in attributes
 */
#ifndef SP_IMPORT_HDF5_GRIDS_H
#define SP_IMPORT_HDF5_GRIDS_H

#include "data/import/array_reader.h"

/* After arrays_choose(): names the dimensions of cells of DREAM.3D, z, y, x and components. */
void hdf5_grids_name_dimensions(struct arrays *a);

/* After arrays_fill_header(): spacing, origin and unit. Does nothing if the chosen array is
 * neither. */
void hdf5_grids_place(const struct arrays *a, struct import_header *header);

#endif
