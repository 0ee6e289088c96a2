/* SPDX-License-Identifier: Apache-2.0
 *
 * Checks the size of a classic NetCDF file. The library reads the missing part of a truncated file
 * as 0, without an error. Therefore our own parser of the header checks the size first.
 */
#ifndef SP_IMPORT_NETCDF_SIZE_H
#define SP_IMPORT_NETCDF_SIZE_H

#include "data/import/format.h"

/* True if the file has all numbers that its header declares, or is no classic NetCDF file. Errors
 * name file, byte and field. */
bool netcdf_size_check(const struct import_file *file, struct sp_error *err);

#endif
