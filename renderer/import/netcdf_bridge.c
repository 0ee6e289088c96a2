/* SPDX-License-Identifier: Apache-2.0
 *
 * NetCDF files, of the classic formats (CDF-1, CDF-2, CDF-5) and of NetCDF-4.
 */
#include "import/array_bridge.h"

#include <netcdf.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CACHE_BYTES = 128 << 20, CACHE_SLOTS = 12421 };

struct netcdf {
    int id;
    int count; /* arrays of the root group */
};

static void close_file(void *file) {
    struct netcdf *c = file;
    nc_close(c->id);
    free(c);
}

static void *open_file(const char *path, char *why, size_t capacity) {
    struct netcdf *c = calloc(1, sizeof *c);
    snprintf(why, capacity, "out of memory");
    if (!c)
        return NULL;
    setenv("HDF5_USE_FILE_LOCKING", "FALSE", 1); /* the sandbox allows no locks */
    int status = nc_open(path, NC_NOWRITE, &c->id);
    if (status == NC_NOERR)
        status = nc_inq_nvars(c->id, &c->count);
    if (status == NC_NOERR)
        return c;
    snprintf(why, capacity, "NetCDF cannot open the file: %s", nc_strerror(status));
    free(c);
    return NULL;
}

static bool number_of(nc_type type, struct import_number *number) {
    switch (type) {
    case NC_BYTE:
        *number = (struct import_number){ IMPORT_SIGNED, 1 };
        break;
    case NC_UBYTE:
        *number = (struct import_number){ IMPORT_UNSIGNED, 1 };
        break;
    case NC_SHORT:
        *number = (struct import_number){ IMPORT_SIGNED, 2 };
        break;
    case NC_USHORT:
        *number = (struct import_number){ IMPORT_UNSIGNED, 2 };
        break;
    case NC_INT:
        *number = (struct import_number){ IMPORT_SIGNED, 4 };
        break;
    case NC_UINT:
        *number = (struct import_number){ IMPORT_UNSIGNED, 4 };
        break;
    case NC_INT64:
        *number = (struct import_number){ IMPORT_SIGNED, 8 };
        break;
    case NC_UINT64:
        *number = (struct import_number){ IMPORT_UNSIGNED, 8 };
        break;
    case NC_FLOAT:
        *number = (struct import_number){ IMPORT_FLOAT, 4 };
        break;
    case NC_DOUBLE:
        *number = (struct import_number){ IMPORT_FLOAT, 8 };
        break;
    default:
        return false;
    }
    return true;
}

static bool describe(void *file, unsigned n, struct array_info *info) {
    const struct netcdf *c = file;
    char name[NC_MAX_NAME + 1] = "";
    int dims[NC_MAX_VAR_DIMS], rank = 0, storage = NC_CONTIGUOUS;
    nc_type type;
    memset(info, 0, sizeof *info);
    if (n >= (unsigned)c->count || n >= ARRAYS_MAX)
        return false;
    if (nc_inq_var(c->id, (int)n, name, &type, &rank, dims, NULL) != NC_NOERR) {
        snprintf(info->problem, sizeof info->problem, "it cannot be opened");
        return true;
    }
    snprintf(info->name, sizeof info->name, "%.*s", (int)sizeof info->name - 1, name);
    if (!number_of(type, &info->number))
        snprintf(info->problem, sizeof info->problem, "it has no numbers");
    else if (rank > IMPORT_RANK_MAX)
        snprintf(info->problem, sizeof info->problem, "it has %d dimensions, more than %d", rank,
                 IMPORT_RANK_MAX);
    for (int d = 0; d < rank && !info->problem[0]; d++) {
        size_t size = 0;
        if (nc_inq_dim(c->id, dims[d], name, &size) != NC_NOERR)
            snprintf(info->problem, sizeof info->problem, "a dimension is missing");
        info->shape[d] = size;
        snprintf(info->dims[d], sizeof info->dims[d], "%.*s", (int)sizeof info->dims[d] - 1, name);
    }
    info->is_number = !info->problem[0];
    info->rank = info->is_number ? (unsigned)rank : 0;
    size_t chunk[NC_MAX_VAR_DIMS];
    if (info->is_number && rank > 0 &&
        nc_inq_var_chunking(c->id, (int)n, &storage, chunk) == NC_NOERR && storage == NC_CHUNKED) {
        for (int d = 0; d < rank; d++)
            info->chunk[d] = chunk[d];
        nc_set_var_chunk_cache(c->id, (int)n, CACHE_BYTES, CACHE_SLOTS, 1);
    }
    return true;
}

static bool read_box(void *file, unsigned n, const uint64_t *start, const uint64_t *count,
                     void *out, char *why, size_t capacity) {
    const struct netcdf *c = file;
    struct array_info info;
    size_t first[IMPORT_RANK_MAX], size[IMPORT_RANK_MAX];
    if (!describe(file, n, &info) || !info.is_number)
        return false;
    for (unsigned d = 0; d < info.rank; d++) {
        first[d] = (size_t)start[d];
        size[d] = (size_t)count[d];
    }
    const int status = nc_get_vara(c->id, (int)n, first, size, out);
    snprintf(why, capacity, "NetCDF cannot read the numbers: %s", nc_strerror(status));
    return status == NC_NOERR;
}

static size_t numbers(void *file, unsigned n, const char *name, double *out, size_t most) {
    const struct netcdf *c = file;
    double values[64];
    nc_type type;
    size_t count = 0;
    if (nc_inq_att(c->id, (int)n, name, &type, &count) != NC_NOERR || type == NC_CHAR ||
        count > 64 || nc_get_att_double(c->id, (int)n, name, values) != NC_NOERR)
        return 0;
    count = count < most ? count : most;
    memcpy(out, values, count * sizeof *out);
    return count;
}

static void text(void *file, unsigned n, const char *name, char *out, size_t capacity) {
    const struct netcdf *c = file;
    char value[1024];
    nc_type type;
    size_t size = 0;
    out[0] = 0;
    if (nc_inq_att(c->id, (int)n, name, &type, &size) != NC_NOERR)
        return;
    if (type == NC_CHAR && size < sizeof value &&
        nc_get_att_text(c->id, (int)n, name, value) == NC_NOERR) {
        snprintf(out, capacity, "%.*s", (int)size, value);
    } else if (type == NC_STRING && size == 1) {
        char *one = NULL;
        if (nc_get_att_string(c->id, (int)n, name, &one) == NC_NOERR && one)
            snprintf(out, capacity, "%s", one);
        nc_free_string(1, &one);
    }
}

__attribute__((visibility("default")))
const struct array_functions splat_netcdf_bridge = { open_file, close_file, describe,
                                                     read_box,  numbers,    text };
