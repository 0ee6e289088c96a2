/* SPDX-License-Identifier: Apache-2.0
 *
 * Images that ITK and SimpleITK write as HDF5: /ITKImage/0/VoxelData, with the place in arrays
 * beside it.
 */
#ifndef SP_IMPORT_ITK_HDF5_H
#define SP_IMPORT_ITK_HDF5_H

#include "data/import/array_reader.h"

#define ITK_HDF5_VOXELS "/ITKImage/0/VoxelData"

/* After arrays_choose(): names the dimensions, of which the last may have the components of each
 * voxel. Does nothing if ITK did not write the chosen array. */
void itk_hdf5_name_dimensions(struct arrays *a);

/* After arrays_fill_header(): spacing, origin, direction [mm, LPS] and the times. */
void itk_hdf5_place(const struct arrays *a, struct import_header *header);

#endif
