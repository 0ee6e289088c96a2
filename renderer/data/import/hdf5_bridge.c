/* SPDX-License-Identifier: Apache-2.0
 *
 * HDF5 files. The library trusts what it reads, so it runs in the sandbox only. It opens other
 * files only for virtual data sets, below the root, and loads no plugin.
 */
#include "data/import/hdf5_dims.h"
#include "data/import/hdf5_filters.h"
#include "data/import/hdf5_list.h"

#include <hdf5.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CACHE_BYTES = 128 << 20, CACHE_SLOTS = 12421, FILTERS_MAX = 32 };

struct hdf5 {
    const struct array_place *place;
    hid_t file;
    struct hdf5_list list;
    unsigned opened; /* the array that is open, + 1; 0 = none */
    hid_t dataset;
};

/* Links to other files are not followed. */
static herr_t refuse_link(const char *parent_file, const char *parent, const char *file,
                          const char *object, unsigned *flags, hid_t access, void *user) {
    (void)parent_file;
    (void)parent;
    (void)file;
    (void)object;
    (void)flags;
    (void)access;
    (void)user;
    return -1;
}

static void close_dataset(struct hdf5 *h) {
    if (h->opened)
        H5Dclose(h->dataset);
    h->opened = 0;
}

static void close_file(void *file) {
    struct hdf5 *h = file;
    close_dataset(h);
    if (h->file >= 0)
        H5Fclose(h->file);
    hdf5_list_finish(&h->list);
    free(h);
    H5close();
}

static void *open_file(const struct array_place *place, struct sp_error *err) {
    struct hdf5 *h = calloc(1, sizeof *h);
    if (!h) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
        return NULL;
    }
    setenv("HDF5_USE_FILE_LOCKING", "FALSE", 1); /* the sandbox allows no locks */
    H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    H5PLset_loading_state(0);
    hdf5_filters_register();
    h->place = place;
    h->file = H5Fopen(place->path, H5F_ACC_RDONLY, H5P_DEFAULT);
    if (h->file >= 0 && hdf5_list_fill(&h->list, h->file))
        return h;
    close_file(h);
    sp_fail(err, SP_ERR_FORMAT, "", "HDF5 cannot open the file: it is damaged or cut off");
    return NULL;
}

/* Opens array n, which stays open until another one is. */
static bool use(struct hdf5 *h, unsigned n) {
    if (h->opened == n + 1)
        return true;
    close_dataset(h);
    hid_t access = H5Pcreate(H5P_DATASET_ACCESS);
    if (access < 0 || n >= h->list.count)
        return false;
    H5Pset_chunk_cache(access, CACHE_SLOTS, CACHE_BYTES, 1);
    H5Pset_elink_cb(access, refuse_link, NULL);
    H5Pset_virtual_prefix(access, h->place->folder);
    h->dataset = H5Dopen2(h->file, h->list.entries[n].name, access);
    H5Pclose(access);
    h->opened = h->dataset >= 0 ? n + 1 : 0;
    if (h->opened)
        hdf5_filters_expect(h->dataset);
    return h->opened;
}

/* True if the type has two floating-point members with the names of a real and an imaginary part.
 */
static bool is_complex(hid_t type, struct import_number *number) {
    if (H5Tget_nmembers(type) != 2)
        return false;
    char *first = H5Tget_member_name(type, 0), *second = H5Tget_member_name(type, 1);
    const bool is_named = first && second && array_names_complex(first, second);
    H5free_memory(first);
    H5free_memory(second);
    hid_t part = is_named ? H5Tget_member_type(type, 0) : -1;
    const bool ok = part >= 0 && H5Tget_class(part) == H5T_FLOAT && H5Tget_size(part) <= 8;
    if (ok) {
        number->kind = IMPORT_COMPLEX;
        number->size = H5Tget_size(part) <= 4 ? 8 : 16;
    }
    hdf5_close(part);
    return ok;
}

/* The type that complex numbers are read as, which the caller closes. HDF5 finds the members by
 * their names. */
static hid_t complex_type(hid_t type, size_t size) {
    const hid_t part = size == 8 ? H5T_NATIVE_FLOAT : H5T_NATIVE_DOUBLE;
    hid_t out = H5Tcreate(H5T_COMPOUND, size);
    for (unsigned i = 0; out >= 0 && i < 2; i++) {
        char *name = H5Tget_member_name(type, i);
        if (name)
            H5Tinsert(out, name, i * size / 2, part);
        H5free_memory(name);
    }
    return out;
}

/* The type that names of numbers have in memory, which the caller closes: HDF5 does not convert
 * them to numbers. h5py writes booleans so. */
static hid_t enum_type(hid_t type) {
    return H5Tget_native_type(type, H5T_DIR_ASCEND);
}

/* The type that numbers of `type` are read as, which the caller closes; −1 = these are none. */
static hid_t read_type(hid_t type, struct import_number *number) {
    const H5T_class_t kind = H5Tget_class(type);
    const size_t size = H5Tget_size(type);
    hid_t native = -1;
    if (kind == H5T_ENUM) {
        hid_t base = H5Tget_super(type), same = base >= 0 ? read_type(base, number) : -1;
        if (same >= 0)
            native = enum_type(type);
        hdf5_close(same);
        hdf5_close(base);
        return native;
    }
    if (kind == H5T_COMPOUND)
        return is_complex(type, number) ? complex_type(type, number->size) : -1;
    const bool is_signed = kind == H5T_INTEGER && H5Tget_sign(type) == H5T_SGN_2;
    if (kind == H5T_FLOAT && size >= 1 && size <= 16) { /* long ones lose digits */
        *number = (struct import_number){ IMPORT_FLOAT, size <= 4 ? 4 : 8 };
        native = size <= 4 ? H5T_NATIVE_FLOAT : H5T_NATIVE_DOUBLE;
    } else if ((kind == H5T_INTEGER || kind == H5T_BITFIELD) && size >= 1 && size <= 8) {
        const int step = size == 1 ? 0 : size == 2 ? 1 : size <= 4 ? 2 : 3;
        const hid_t types[3][4] = {
            { H5T_NATIVE_UINT8, H5T_NATIVE_UINT16, H5T_NATIVE_UINT32, H5T_NATIVE_UINT64 },
            { H5T_NATIVE_INT8, H5T_NATIVE_INT16, H5T_NATIVE_INT32, H5T_NATIVE_INT64 },
            { H5T_NATIVE_B8, H5T_NATIVE_B16, H5T_NATIVE_B32, H5T_NATIVE_B64 }
        };
        number->kind = is_signed ? IMPORT_SIGNED : IMPORT_UNSIGNED;
        number->size = (size_t)1 << step;
        native = types[kind == H5T_BITFIELD ? 2 : is_signed][step];
    }
    return native < 0 ? -1 : H5Tcopy(native);
}

/* Why a type cannot be read. */
static void explain_type(hid_t type, char *out, size_t capacity) {
    const H5T_class_t kind = H5Tget_class(type);
    size_t used;
    switch (kind) {
    case H5T_STRING:
        snprintf(out, capacity, "it has no numbers but text");
        return;
    case H5T_COMPOUND:
        used = (size_t)snprintf(out, capacity, "it has no numbers but rows of the columns");
        for (int i = 0; i < H5Tget_nmembers(type) && used < capacity; i++) {
            char *name = H5Tget_member_name(type, (unsigned)i);
            used += (size_t)snprintf(out + used, capacity - used, "%s%.24s", i ? ", " : " ",
                                     name ? name : "?");
            H5free_memory(name);
        }
        return;
    case H5T_VLEN:
        snprintf(out, capacity, "it has no numbers but lists of varying length");
        return;
    case H5T_REFERENCE:
        snprintf(out, capacity, "it has no numbers but references to other objects");
        return;
    default:
        snprintf(out, capacity, "it has no numbers of up to 64 bits");
    }
}

static const char *filter_name(H5Z_filter_t filter) {
    static const struct {
        int id;
        const char *name;
    } known[] = { { H5Z_FILTER_SZIP, "SZIP" },
                  { 32000, "LZF" },
                  { 32001, "Blosc" },
                  { 32004, "LZ4" },
                  { 307, "bzip2" },
                  { 32008, "bitshuffle" },
                  { 32013, "ZFP" },
                  { 32015, "zstd" },
                  { 32019, "JPEG" },
                  { 32026, "Blosc2" },
                  { 32028, "JPEG 2000" } };
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (known[i].id == filter)
            return known[i].name;
    return "unknown";
}

/* Reads the chunks, and finds what cannot be read. */
static void look_at_storage(const struct hdf5 *h, struct array_info *info) {
    hsize_t chunk[IMPORT_RANK_MAX];
    hid_t list = H5Dget_create_plist(h->dataset);
    if (list < 0)
        return;
    const H5D_layout_t layout = H5Pget_layout(list);
    if (layout == H5D_CHUNKED && H5Pget_chunk(list, (int)info->rank, chunk) >= 0)
        for (unsigned d = 0; d < info->rank; d++)
            info->chunk[d] = chunk[d];
    if (layout == H5D_VIRTUAL || H5Pget_external_count(list) > 0)
        hdf5_check_sources(h->place, h->file, list, info->problem, sizeof info->problem);
    const int filters = H5Pget_nfilters(list);
    info->is_packed = filters > 0;
    for (int i = 0; i < filters && i < FILTERS_MAX; i++) {
        unsigned flags = 0;
        size_t count = 0;
        const H5Z_filter_t filter =
            H5Pget_filter2(list, (unsigned)i, &flags, &count, NULL, 0, NULL, NULL);
        if (filter < 0 || H5Zfilter_avail(filter) <= 0)
            snprintf(info->problem, sizeof info->problem,
                     "the compression %s (filter %d) is not supported; write it with gzip, as "
                     "h5repack -f GZIP=4 does",
                     filter_name(filter), (int)filter);
    }
    H5Pclose(list);
}

static void look_at(struct hdf5 *h, unsigned n, struct array_info *info) {
    const struct hdf5_entry *entry = &h->list.entries[n];
    snprintf(info->name, sizeof info->name, "%s", entry->name);
    info->is_alias = entry->is_alias;
    info->is_preferred = h->list.preferred == n + 1;
    snprintf(info->problem, sizeof info->problem, "%s", entry->problem);
    if (info->problem[0])
        return;
    snprintf(info->problem, sizeof info->problem, "it cannot be opened");
    if (!use(h, n))
        return;
    hid_t type = H5Dget_type(h->dataset), space = H5Dget_space(h->dataset);
    hsize_t shape[H5S_MAX_RANK];
    const int rank = space >= 0 ? H5Sget_simple_extent_ndims(space) : -1;
    info->problem[0] = 0;
    hid_t native = type >= 0 ? read_type(type, &info->number) : -1;
    if (type < 0 || rank < 0) {
        snprintf(info->problem, sizeof info->problem, "it has no numbers");
    } else if (native < 0) {
        explain_type(type, info->problem, sizeof info->problem);
    } else if (rank > IMPORT_RANK_MAX || H5Sget_simple_extent_dims(space, shape, NULL) < 0) {
        snprintf(info->problem, sizeof info->problem, "it has %d dimensions, more than %d", rank,
                 IMPORT_RANK_MAX);
    } else {
        info->rank = (unsigned)rank;
        for (int d = 0; d < rank; d++)
            info->shape[d] = shape[d];
        look_at_storage(h, info);
        hdf5_read_dimensions(h->file, h->dataset, info);
        hdf5_read_nexus(h->file, h->dataset, info);
        hdf5_read_labels(h->file, h->dataset, info);
    }
    info->is_number = !info->problem[0];
    hdf5_close(native);
    hdf5_close(space);
    hdf5_close(type);
}

/* Descriptions are kept: callers ask for all of them again and again. */
static bool describe(void *file, unsigned n, struct array_info *info) {
    struct hdf5 *h = file;
    if (n >= h->list.count)
        return false;
    struct array_info **kept = &h->list.entries[n].info;
    if (!*kept && (*kept = calloc(1, sizeof **kept)))
        look_at(h, n, *kept);
    if (*kept)
        *info = **kept;
    else
        *info = (struct array_info){ .problem = "out of memory" };
    return true;
}

static bool read_chosen(struct hdf5 *h, unsigned n, const uint64_t *start, const uint64_t *count,
                        void *out) {
    struct import_number number;
    hsize_t first[IMPORT_RANK_MAX], size[IMPORT_RANK_MAX];
    if (!use(h, n))
        return false;
    hid_t type = H5Dget_type(h->dataset), space = H5Dget_space(h->dataset), memory = -1;
    hid_t own = type >= 0 ? read_type(type, &number) : -1;
    const int rank = space >= 0 ? H5Sget_simple_extent_ndims(space) : -1;
    bool ok = own >= 0 && H5Tget_size(own) == number.size && rank >= 1 && rank <= IMPORT_RANK_MAX;
    for (int d = 0; ok && d < rank; d++) {
        first[d] = start[d];
        size[d] = count[d];
    }
    ok = ok && (memory = H5Screate_simple(rank, size, NULL)) >= 0 &&
         H5Sselect_hyperslab(space, H5S_SELECT_SET, first, NULL, size, NULL) >= 0 &&
         H5Dread(h->dataset, own, memory, space, H5P_DEFAULT, out) >= 0;
    hdf5_close(own);
    hdf5_close(memory);
    hdf5_close(space);
    hdf5_close(type);
    return ok;
}

static bool read_box(void *file, unsigned n, const uint64_t *start, const uint64_t *count,
                     void *out, struct sp_error *err) {
    return read_chosen(file, n, start, count, out) ||
           sp_fail(err, SP_ERR_FORMAT, "",
                   "HDF5 cannot read the numbers: they are damaged or cut off");
}

static size_t numbers_of(hid_t object, const char *name, double *out, size_t most) {
    struct import_number number;
    double values[64];
    hid_t attribute = H5Aexists(object, name) > 0 ? H5Aopen(object, name, H5P_DEFAULT) : -1;
    if (attribute < 0)
        return 0;
    hid_t space = H5Aget_space(attribute), type = H5Aget_type(attribute);
    const hssize_t count = space >= 0 ? H5Sget_simple_extent_npoints(space) : -1;
    hid_t native = type >= 0 ? read_type(type, &number) : -1;
    const bool ok = count >= 1 && count <= 64 && native >= 0 && number.kind != IMPORT_COMPLEX &&
                    H5Aread(attribute, H5T_NATIVE_DOUBLE, values) >= 0;
    const size_t got = !ok ? 0 : (size_t)count < most ? (size_t)count : most;
    memcpy(out, values, got * sizeof *out);
    hdf5_close(native);
    hdf5_close(space);
    hdf5_close(type);
    H5Aclose(attribute);
    return got;
}

static size_t numbers(void *file, unsigned n, const char *name, double *out, size_t most) {
    struct hdf5 *h = file;
    if (n == ARRAY_OF_FILE) /* the root group */
        return numbers_of(h->file, name, out, most);
    return use(h, n) ? numbers_of(h->dataset, name, out, most) : 0;
}

static hid_t open_group(const struct hdf5 *h, const char *group) {
    const bool is_there = strcmp(group, "/") == 0 || H5Lexists(h->file, group, H5P_DEFAULT) > 0;
    return is_there ? H5Oopen(h->file, group, H5P_DEFAULT) : -1;
}

static size_t group_numbers(void *file, const char *group, const char *name, double *out,
                            size_t most) {
    const hid_t object = open_group(file, group);
    if (object < 0)
        return 0;
    const size_t got = numbers_of(object, name, out, most);
    H5Oclose(object);
    return got;
}

static void text(void *file, unsigned n, const char *name, char *out, size_t capacity) {
    struct hdf5 *h = file;
    out[0] = 0;
    if (n == ARRAY_OF_FILE || use(h, n))
        hdf5_text(n == ARRAY_OF_FILE ? h->file : h->dataset, name, out, capacity);
}

static void group_text(void *file, const char *group, const char *name, char *out,
                       size_t capacity) {
    out[0] = 0;
    const hid_t object = open_group(file, group);
    if (object < 0)
        return;
    hdf5_text(object, name, out, capacity);
    H5Oclose(object);
}

__attribute__((visibility("default")))
const struct array_functions splat_hdf5_bridge = { .open = open_file,
                                                   .close = close_file,
                                                   .describe = describe,
                                                   .read = read_box,
                                                   .numbers = numbers,
                                                   .text = text,
                                                   .group_text = group_text,
                                                   .group_numbers = group_numbers };
