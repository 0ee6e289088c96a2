/* SPDX-License-Identifier: Apache-2.0
 *
 * Arrays of HDF5 and NetCDF files, private to the readers: arrays.c chooses and reads one,
 * array_axes.c finds its place in the world.
 */
#ifndef SP_IMPORT_ARRAYS_H
#define SP_IMPORT_ARRAYS_H

#include "import/array_bridge.h"
#include "import/conversion.h"

struct arrays {
    const struct import_file *file;
    const struct array_functions *call;
    void *handle;
    bool is_netcdf;
    unsigned chosen; /* the array that is read */
    struct array_info info;
    struct import_axes axes;
    uint32_t channels, channel;
    struct import_conversion conversion;
    double *positions[3]; /* owned: of rectilinear axes */
    double *times;        /* owned; NULL = unknown */
};

/* Fails at "SHOWN: NAME" of the array. */
__attribute__((format(printf, 4, 5))) bool arrays_fail(const struct arrays *a, struct sp_error *err,
                                                       enum sp_code code, const char *format, ...);

/* Finds the axes of the array, and from the attributes and coordinates the place of the grid and
 * the times. */
bool arrays_take_axes(struct arrays *a, struct import_header *header, struct sp_error *err);

#endif
