/* SPDX-License-Identifier: Apache-2.0
 *
 * Filters of HDF5 that are not in the library, for reading: LZF (of h5py), Zstandard, and where
 * libblosc is there, Blosc. Plug-ins are never loaded.
 */
#ifndef SP_IMPORT_HDF5_FILTERS_H
#define SP_IMPORT_HDF5_FILTERS_H

#include <hdf5.h>

#include "data/import/array_bridge.h"

/* Call it after the library is open. */
void hdf5_filters_register(void);

/* Call it for each array that is opened: what a filter unpacks must fill a chunk of it. HDF5 1.10
 * does not compare, and takes the rest from whatever lies behind. */
void hdf5_filters_expect(hid_t dataset);

#endif
