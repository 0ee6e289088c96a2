/* SPDX-License-Identifier: Apache-2.0
 *
 * The functions that arrays.c needs to read a file with several arrays: HDF5, NetCDF or a group of
 * Zarr. The HDF5 and NetCDF libraries are modules that export this table of functions. One file at
 * a time, one thread.
 */
#ifndef SP_IMPORT_ARRAY_BRIDGE_H
#define SP_IMPORT_ARRAY_BRIDGE_H

#include <string.h>

#include "data/import/axes.h"

enum { ARRAY_NAME_BYTES = 256, ARRAYS_MAX = 4096 };

/* True for the names of a real and an imaginary part. */
static inline bool array_names_complex(const char *real, const char *imaginary) {
    static const char *const names[][2] = { { "r", "i" },       { "real", "imag" },
                                            { "re", "im" },     { "_Real", "_Imag" },
                                            { "Real", "Imag" }, { "real", "imaginary" } };
    bool is = false;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        is |= strcmp(real, names[i][0]) == 0 && strcmp(imaginary, names[i][1]) == 0;
    return is;
}

/* In place of the number of an array: the attributes of the file. */
#define ARRAY_OF_FILE UINT_MAX

enum { ARRAY_CHUNK_MAX = 256 << 20 }; /* bytes */

struct array_info {              /* one array of a file */
    char name[ARRAY_NAME_BYTES]; /* the path: "/a/b" in HDF5, "a/b" or "b" in NetCDF and Zarr; "" =
                                    the file is this array */
    unsigned rank;               /* in [0, IMPORT_RANK_MAX]; 0 if its elements are no numbers */
    uint64_t shape[IMPORT_RANK_MAX];
    uint64_t chunk[IMPORT_RANK_MAX];              /* 0 = not chunked */
    char dims[IMPORT_RANK_MAX][ARRAY_NAME_BYTES]; /* names of dimensions; "" = none */
    /* The arrays of the coordinates of dimensions; "" = the array with the name of the dimension.
     */
    char scales[IMPORT_RANK_MAX][ARRAY_NAME_BYTES];
    bool is_scale;         /* the array holds the coordinates of a dimension */
    bool is_alias;         /* another name of an array, or a link: read on demand only */
    bool is_preferred;     /* the file names it as the array to show */
    bool has_default_fill; /* numbers that no program wrote have the fill value of NetCDF */
    bool is_number;        /* its numbers can be read */
    /* A chunk is packed, so that one read needs all of it: at most ARRAY_CHUNK_MAX bytes. */
    bool is_packed;
    char problem[256];           /* why the numbers cannot be read; "" = they can */
    struct import_number number; /* as read() returns it */
};

/* Where a file is, and the other files that its arrays need. */
struct array_place {
    const char *path;   /* to open the file */
    const char *folder; /* of the file */
    /* Finds another file by its name in this one: the resolved path of a regular file below the
     * root, or false. */
    bool (*find)(const struct array_place *place, const char *name, char real[PATH_MAX]);
    const void *user;
};

struct array_functions {
    /* NULL on failure, with *err set but for its place. The place of the file must stay valid
     * until close(). */
    void *(*open)(const struct array_place *place, struct sp_error *err);
    void (*close)(void *file);
    /* Describes array n, from 0. False if there is none. */
    bool (*describe)(void *file, unsigned n, struct array_info *info);
    /* Reads a box of array n, the last dimension fastest, in native byte order. False with *err set
     * but for its place; err may be NULL. */
    bool (*read)(void *file, unsigned n, const uint64_t *start, const uint64_t *count, void *out,
                 struct sp_error *err);
    /* Reads an attribute of array n as at most `most` numbers; returns how many. */
    size_t (*numbers)(void *file, unsigned n, const char *attribute, double *out, size_t most);
    /* Reads an attribute as text, cut to `capacity` bytes with its 0; "" if there is none. */
    void (*text)(void *file, unsigned n, const char *attribute, char *out, size_t capacity);
    /* Like text(), for a group; NULL = groups have no attributes. */
    void (*group_text)(void *file, const char *group, const char *attribute, char *out,
                       size_t capacity);
    /* Like numbers(), for a group; NULL = groups have no attributes. */
    size_t (*group_numbers)(void *file, const char *group, const char *attribute, double *out,
                            size_t most);
    /* Names a channel of array n; "" or NULL = it has no name. */
    void (*channel)(void *file, unsigned n, uint32_t channel, char *out, size_t capacity);
};

#define HDF5_BRIDGE_MODULE "splat-import-hdf5.so"
#define HDF5_BRIDGE_SYMBOL "splat_hdf5_bridge"
extern const struct array_functions splat_hdf5_bridge;

#define NETCDF_BRIDGE_MODULE "splat-import-netcdf.so"
#define NETCDF_BRIDGE_SYMBOL "splat_netcdf_bridge"
extern const struct array_functions splat_netcdf_bridge;

#endif
