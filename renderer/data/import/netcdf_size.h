/* SPDX-License-Identifier: Apache-2.0
 *
 * The size of a classic NetCDF file. The library reads what is cut off as 0, without an error, so
 * the size is checked before: this is a parser of our own of the header.
 */
#ifndef SP_IMPORT_NETCDF_SIZE_H
#define SP_IMPORT_NETCDF_SIZE_H

#include "data/import/format.h"

/* True if the file has all numbers that its header declares, or is no classic NetCDF file. Errors
 * name file, byte and field. */
bool netcdf_size_check(const struct import_file *file, struct sp_error *err);

#endif
