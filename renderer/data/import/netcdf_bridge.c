/* SPDX-License-Identifier: Apache-2.0
 *
 * NetCDF files, of the classic formats (CDF-1, CDF-2, CDF-5) and of NetCDF-4.
 */
#include "base/grow.h"
#include "data/import/array_bridge.h"

#include <netcdf.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CACHE_BYTES = 128 << 20, CACHE_SLOTS = 12421 };

enum { GROUP_DEPTH_MAX = 32 };

struct variable {
    int group, id;
    char name[ARRAY_NAME_BYTES]; /* the path, "group/name" or "name" */
    bool has_cache;              /* of chunks; to set it again would empty it */
};

struct netcdf {
    int id;
    unsigned count;
    struct variable *variables; /* owned: of the root group first, then of the groups below */
};

static void close_file(void *file) {
    struct netcdf *c = file;
    nc_close(c->id);
    free(c->variables);
    free(c);
}

static bool add_variable(struct netcdf *c, int group, int id, const char *path) {
    char name[NC_MAX_NAME + 1] = "";
    if (c->count == ARRAYS_MAX)
        return true;
    if (!sp_grow(&c->variables, c->count, sizeof *c->variables))
        return false;
    struct variable *v = &c->variables[c->count++];
    *v = (struct variable){ .group = group, .id = id };
    nc_inq_varname(group, id, name);
    return snprintf(v->name, sizeof v->name, "%s%.*s", path, NC_MAX_NAME, name) > 0;
}

/* Lists the variables of a group, then the variables of the groups in it. `path` ends with '/' or
 * is "". */
static bool list_group(struct netcdf *c, int group, const char *path, unsigned depth,
                       struct sp_error *err) {
    int count = 0;
    char below[ARRAY_NAME_BYTES], name[NC_MAX_NAME + 1];
    if (nc_inq_nvars(group, &count) != NC_NOERR)
        return true;
    for (int i = 0; i < count; i++)
        if (!add_variable(c, group, i, path))
            return sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
    if (depth == GROUP_DEPTH_MAX || nc_inq_grps(group, &count, NULL) != NC_NOERR || count <= 0)
        return true;
    int *groups = calloc((size_t)count, sizeof *groups);
    if (!groups)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
    int status = nc_inq_grps(group, &count, groups);
    bool ok =
        status == NC_NOERR ||
        sp_fail(err, SP_ERR_FORMAT, "", "NetCDF cannot list the groups: %s", nc_strerror(status));
    for (int i = 0; ok && i < count; i++)
        if (nc_inq_grpname(groups[i], name) == NC_NOERR &&
            snprintf(below, sizeof below, "%s%s/", path, name) < (int)sizeof below)
            ok = list_group(c, groups[i], below, depth + 1, err);
    free(groups);
    return ok;
}

static void *open_file(const struct array_place *place, struct sp_error *err) {
    struct netcdf *c = calloc(1, sizeof *c);
    if (!c) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
        return NULL;
    }
    setenv("HDF5_USE_FILE_LOCKING", "FALSE", 1); /* the sandbox allows no locks */
    int status = nc_open(place->path, NC_NOWRITE, &c->id);
    if (status == NC_NOERR) {
        if (list_group(c, c->id, "", 0, err))
            return c;
        close_file(c);
        return NULL;
    }
    sp_fail(err, SP_ERR_FORMAT, "", "NetCDF cannot open the file: %s", nc_strerror(status));
    free(c);
    return NULL;
}

/* True if the type has two floating-point members with the names of a real and an imaginary part.
 */
static bool is_complex(int group, nc_type type, struct import_number *number) {
    char first[NC_MAX_NAME + 1] = "", second[NC_MAX_NAME + 1] = "";
    nc_type parts[2] = { NC_NAT, NC_NAT };
    size_t count = 0, size = 0;
    if (nc_inq_compound(group, type, NULL, &size, &count) != NC_NOERR || count != 2 ||
        nc_inq_compound_fieldname(group, type, 0, first) != NC_NOERR ||
        nc_inq_compound_fieldname(group, type, 1, second) != NC_NOERR ||
        nc_inq_compound_fieldtype(group, type, 0, &parts[0]) != NC_NOERR ||
        nc_inq_compound_fieldtype(group, type, 1, &parts[1]) != NC_NOERR)
        return false;
    *number = (struct import_number){ IMPORT_COMPLEX, parts[0] == NC_FLOAT ? 8 : 16 };
    return array_names_complex(first, second) && parts[0] == parts[1] &&
           (parts[0] == NC_FLOAT || parts[0] == NC_DOUBLE) && size == number->size;
}

static bool number_of(int group, nc_type type, struct import_number *number) {
    static const struct import_number known[] = {
        [NC_BYTE] = { IMPORT_SIGNED, 1 },  [NC_UBYTE] = { IMPORT_UNSIGNED, 1 },
        [NC_SHORT] = { IMPORT_SIGNED, 2 }, [NC_USHORT] = { IMPORT_UNSIGNED, 2 },
        [NC_INT] = { IMPORT_SIGNED, 4 },   [NC_UINT] = { IMPORT_UNSIGNED, 4 },
        [NC_INT64] = { IMPORT_SIGNED, 8 }, [NC_UINT64] = { IMPORT_UNSIGNED, 8 },
        [NC_FLOAT] = { IMPORT_FLOAT, 4 },  [NC_DOUBLE] = { IMPORT_FLOAT, 8 },
    };
    int kind = 0;
    nc_type base = NC_NAT;
    if (type > NC_MAX_ATOMIC_TYPE) {
        if (nc_inq_user_type(group, type, NULL, NULL, &base, NULL, &kind) != NC_NOERR)
            return false;
        if (kind == NC_COMPOUND)
            return is_complex(group, type, number);
        if (kind != NC_ENUM)
            return false;
        type = base;
    }
    if (type < 0 || (size_t)type >= sizeof known / sizeof *known)
        return false;
    *number = known[type];
    return number->size > 0;
}

static bool describe(void *file, unsigned n, struct array_info *info) {
    const struct netcdf *c = file;
    char name[NC_MAX_NAME + 1] = "";
    int dims[NC_MAX_VAR_DIMS], rank = 0, storage = NC_CONTIGUOUS;
    nc_type type;
    memset(info, 0, sizeof *info);
    if (n >= c->count)
        return false;
    const struct variable *v = &c->variables[n];
    memcpy(info->name, v->name, sizeof info->name);
    if (nc_inq_var(v->group, v->id, name, &type, &rank, dims, NULL) != NC_NOERR) {
        snprintf(info->problem, sizeof info->problem, "it cannot be opened");
        return true;
    }
    if (!number_of(v->group, type, &info->number))
        snprintf(info->problem, sizeof info->problem, "it has no numbers but %s",
                 type == NC_CHAR || type == NC_STRING ? "text" : "structures");
    else if (rank > IMPORT_RANK_MAX)
        snprintf(info->problem, sizeof info->problem, "it has %d dimensions, more than %d", rank,
                 IMPORT_RANK_MAX);
    for (int d = 0; d < rank && !info->problem[0]; d++) {
        size_t size = 0;
        if (nc_inq_dim(v->group, dims[d], name, &size) != NC_NOERR)
            snprintf(info->problem, sizeof info->problem, "a dimension is missing");
        info->shape[d] = size;
        snprintf(info->dims[d], sizeof info->dims[d], "%.*s", (int)sizeof info->dims[d] - 1, name);
    }
    info->is_number = !info->problem[0];
    info->rank = info->is_number ? (unsigned)rank : 0;
    int is_never_filled = 1;
    info->has_default_fill =
        nc_inq_var_fill(v->group, v->id, &is_never_filled, NULL) == NC_NOERR && !is_never_filled;
    size_t chunk[NC_MAX_VAR_DIMS];
    if (info->is_number && rank > 0 &&
        nc_inq_var_chunking(v->group, v->id, &storage, chunk) == NC_NOERR &&
        storage == NC_CHUNKED) {
        for (int d = 0; d < rank; d++)
            info->chunk[d] = chunk[d];
        unsigned filter = 0;
        info->is_packed =
            nc_inq_var_filter(v->group, v->id, &filter, NULL, NULL) == NC_NOERR && filter > 0;
    }
    return true;
}

static bool read_box(void *file, unsigned n, const uint64_t *start, const uint64_t *count,
                     void *out, struct sp_error *err) {
    const struct netcdf *c = file;
    struct array_info info;
    size_t first[IMPORT_RANK_MAX], size[IMPORT_RANK_MAX];
    if (!describe(file, n, &info) || !info.is_number)
        return sp_fail(err, SP_ERR_FORMAT, "", "NetCDF cannot read the numbers: %s",
                       nc_strerror(NC_EBADTYPE));
    struct variable *v = &c->variables[n];
    if (info.chunk[0] && !v->has_cache)
        nc_set_var_chunk_cache(v->group, v->id, CACHE_BYTES, CACHE_SLOTS, 1);
    v->has_cache = true;
    for (unsigned d = 0; d < info.rank; d++) {
        first[d] = (size_t)start[d];
        size[d] = (size_t)count[d];
    }
    const int status = nc_get_vara(v->group, v->id, first, size, out);
    return status == NC_NOERR ||
           sp_fail(err, status == NC_ENOMEM ? SP_ERR_MEMORY : SP_ERR_FORMAT, "",
                   "NetCDF cannot read the numbers: %s%s", nc_strerror(status),
                   status == NC_EFILTER || status == NC_ENOFILTER
                       ? "; write them with zlib, as nccopy -d 4 does"
                       : "");
}

static struct variable place_of(const struct netcdf *c, unsigned n) {
    return n < c->count ? c->variables[n] : (struct variable){ .group = c->id, .id = NC_GLOBAL };
}

static size_t numbers(void *file, unsigned n, const char *name, double *out, size_t most) {
    const struct variable place = place_of(file, n), *v = &place;
    double values[64];
    nc_type type;
    size_t count = 0;
    if (nc_inq_att(v->group, v->id, name, &type, &count) != NC_NOERR || type == NC_CHAR ||
        count > 64 || nc_get_att_double(v->group, v->id, name, values) != NC_NOERR)
        return 0;
    count = count < most ? count : most;
    memcpy(out, values, count * sizeof *out);
    return count;
}

static void text(void *file, unsigned n, const char *name, char *out, size_t capacity) {
    const struct variable place = place_of(file, n), *v = &place;
    char value[1024];
    nc_type type;
    size_t size = 0;
    out[0] = 0;
    if (nc_inq_att(v->group, v->id, name, &type, &size) != NC_NOERR)
        return;
    if (type == NC_CHAR && size < sizeof value &&
        nc_get_att_text(v->group, v->id, name, value) == NC_NOERR) {
        snprintf(out, capacity, "%.*s", (int)size, value);
    } else if (type == NC_STRING && size == 1) {
        char *one = NULL;
        if (nc_get_att_string(v->group, v->id, name, &one) == NC_NOERR && one)
            snprintf(out, capacity, "%s", one);
        nc_free_string(1, &one);
    }
}

__attribute__((visibility("default")))
const struct array_functions splat_netcdf_bridge = { .open = open_file,
                                                     .close = close_file,
                                                     .describe = describe,
                                                     .read = read_box,
                                                     .numbers = numbers,
                                                     .text = text };
