/* SPDX-License-Identifier: Apache-2.0
 *
 * One array of a file with several: HDF5, NetCDF, and groups and plain arrays of Zarr. The
 * conventions of CF hold for all of them, as far as a file follows them.
 *
 *   array_choice (which array) ─► array_values (samples) ─► array_axes (place, time) ─► names
 */
#ifndef SP_IMPORT_ARRAY_READER_H
#define SP_IMPORT_ARRAY_READER_H

#include "data/import/array_bridge.h"
#include "data/import/conversion.h"

/* The height of a volume whose vertical axis has another kind of unit, in its horizontal extent. */
#define ARRAYS_HEIGHT_SHARE 0.25

struct arrays {
    const struct import_file *file;
    const char *title;        /* the name in errors */
    struct array_place place; /* of HDF5 and NetCDF */
    char path[40];            /* of the place */
    const struct array_functions *call;
    void *handle;
    bool is_netcdf;   /* NetCDF reads the file */
    bool takes_first; /* takes the first of several suitable arrays; otherwise the user must choose
                       */
    char *auxiliary;  /* owned: the arrays that others name as their coordinates, " a b "; NULL =
                         none */
    unsigned chosen;  /* the array that is read */
    struct array_info info;
    struct import_axes axes;
    uint32_t channels, channel;
    struct import_conversion conversion;
    /* Whole numbers of this value stand for missing samples; NAN = no such value. */
    double default_fill;
    double steps[IMPORT_RANK_MAX]; /* the spacing of dimensions, from tags; 0 = unknown */
    bool is_placed[3];             /* x, y and z have coordinates */
    double *positions[3];          /* owned: of rectilinear axes */
    double *times;                 /* owned; NULL = unknown */
};

/* Chooses the array that file->field names, or else an array with the most dimensions, where more
 * than three count as three. */
bool arrays_choose(struct arrays *a, struct sp_error *err);

/* Fills the header from the chosen array: type, grid, steps, names. The caller checks the grid. */
bool arrays_fill_header(struct arrays *a, struct import_header *header, struct sp_error *err);

/* Frees the memory that these functions allocated. */
void arrays_finish(struct arrays *a);

/* Fails at "TITLE: NAME" of the array. */
__attribute__((format(printf, 4, 5))) bool arrays_fail(const struct arrays *a, struct sp_error *err,
                                                       enum sp_code code, const char *format, ...);

/* The parts of arrays_fill_header(). */

/* How stored numbers become samples: scale_factor, add_offset, _FillValue and others. */
void arrays_set_conversion(struct arrays *a, struct import_header *header);

/* The same for array n, which may have coordinates, as its own attributes say. Returns whether it
 * has a _FillValue. The type in memory is the caller's matter. */
bool arrays_read_packing(const struct arrays *a, unsigned n, const struct array_info *info,
                         struct import_conversion *conversion);

enum { ARRAYS_SIDE_MAX = 4 };

/* Reads an array of `side` finite numbers, at most ARRAYS_SIDE_MAX, along each of `rank`
 * dimensions, 1 or 2. False if there is none. */
bool arrays_read_numbers(const struct arrays *a, const char *path, unsigned rank, unsigned side,
                         double *out);

/* Call it if default fill values are among the samples. The samples become floating-point numbers,
 * so that missing samples can be NaN. */
void arrays_use_default_fill(struct arrays *a);

/* Reads the axes of the array, and from the attributes and coordinates the place of the grid and
 * the times. */
bool arrays_read_axes(struct arrays *a, struct import_header *header, struct sp_error *err);

enum arrays_role {
    ARRAYS_ROLE_NONE,
    ARRAYS_ROLE_X,
    ARRAYS_ROLE_Y,
    ARRAYS_ROLE_Z,
    ARRAYS_ROLE_TIME,
    ARRAYS_ROLE_CHANNEL
};

/* Finds the role of a dimension from its name and from the attributes of array n, which has its
 * coordinates; n = −1: there is no such array. */
enum arrays_role arrays_role_of(const struct arrays *a, int n, const char *name);

/* Finds the array with the coordinates of dimension d, if its name differs from the dimension: the
 * only one-dimensional array that the attribute "coordinates" names, or an array of times. −1 =
 * there is none. */
int arrays_find_auxiliary(const struct arrays *a, unsigned d);

/* Refuses arrays on the cells of an unstructured grid. */
bool arrays_check_cells(const struct arrays *a, struct sp_error *err);

/* Warns of coordinates that do not place the samples. */
void arrays_warn_of_auxiliary(const struct arrays *a);

/* Reads names and spacing of the dimensions from the attribute "axistags" of vigra, and names from
 * those of HDF5 images in colours. */
void arrays_read_tags(struct arrays *a);

/* Reads the size of a voxel from attributes, where there are no coordinates. */
void arrays_read_sizes(struct arrays *a, struct import_header *header);

/* Sets the names of the samples, and lists the other fields of the file. */
bool arrays_set_names(struct arrays *a, struct import_header *header, struct sp_error *err);

#endif
