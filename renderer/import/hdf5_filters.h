/* SPDX-License-Identifier: Apache-2.0
 *
 * Filters of HDF5 that are not in the library, for reading: LZF (of h5py), Zstandard, and where
 * libblosc is there, Blosc. Plug-ins are never loaded.
 */
#ifndef SP_IMPORT_HDF5_FILTERS_H
#define SP_IMPORT_HDF5_FILTERS_H

#include "import/array_bridge.h"

/* Call it after the library is open. */
void hdf5_filters_register(void);

#endif
