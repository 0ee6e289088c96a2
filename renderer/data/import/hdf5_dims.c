/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/hdf5_dims.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { TEXT_BYTES = 8192 };

/* The NAME of scales that NetCDF writes for dimensions without coordinates. */
static const char no_variable[] = "This is a netCDF dimension but not a netCDF variable";

/* An attribute of texts. */
struct texts {
    hid_t attribute, type, space;
    hssize_t count; /* 0 = there is none */
    size_t size;    /* bytes of each, if they have a fixed length */
    bool is_variable;
};

static void open_texts(struct texts *t, hid_t object, const char *name) {
    *t = (struct texts){ .attribute = -1, .type = -1, .space = -1 };
    if (H5Aexists(object, name) > 0)
        t->attribute = H5Aopen(object, name, H5P_DEFAULT);
    if (t->attribute < 0)
        return;
    t->type = H5Aget_type(t->attribute);
    t->space = H5Aget_space(t->attribute);
    if (t->type < 0 || t->space < 0 || H5Tget_class(t->type) != H5T_STRING)
        return;
    const hssize_t count = H5Sget_simple_extent_npoints(t->space);
    t->is_variable = H5Tis_variable_str(t->type) > 0;
    t->size = H5Tget_size(t->type);
    t->count = count > 0 && t->size > 0 ? count : 0;
}

static void close_texts(struct texts *t) {
    hdf5_close(t->space);
    hdf5_close(t->type);
    hdf5_close(t->attribute);
}

void hdf5_text(hid_t object, const char *name, char *out, size_t capacity) {
    char fixed[TEXT_BYTES];
    struct texts t;
    out[0] = 0;
    open_texts(&t, object, name);
    const bool fits = t.count > 0 && t.size <= sizeof fixed / (size_t)t.count;
    if (t.count == 1 && t.is_variable) {
        char *one = NULL;
        if (H5Aread(t.attribute, t.type, &one) >= 0 && one)
            snprintf(out, capacity, "%s", one);
        H5free_memory(one);
    } else if (!t.is_variable && fits && (t.count == 1 || t.size == 1) &&
               H5Aread(t.attribute, t.type, fixed) >= 0) {
        snprintf(out, capacity, "%.*s", (int)(t.size * (size_t)t.count), fixed);
    }
    close_texts(&t);
}

unsigned hdf5_texts(hid_t object, const char *name, char out[IMPORT_RANK_MAX][ARRAY_NAME_BYTES]) {
    char fixed[TEXT_BYTES], *list[IMPORT_RANK_MAX] = { NULL };
    struct texts t;
    open_texts(&t, object, name);
    bool ok = t.count > 0 && t.count <= IMPORT_RANK_MAX;
    const unsigned count = ok ? (unsigned)t.count : 0;
    if (ok && t.is_variable)
        ok = H5Aread(t.attribute, t.type, list) >= 0;
    else if (ok)
        ok = t.size <= sizeof fixed / count && H5Aread(t.attribute, t.type, fixed) >= 0;
    for (unsigned i = 0; i < count && ok; i++)
        snprintf(out[i], ARRAY_NAME_BYTES, "%.*s",
                 t.is_variable ? ARRAY_NAME_BYTES - 1 : (int)t.size,
                 t.is_variable ? (list[i] ? list[i] : "") : fixed + i * t.size);
    for (unsigned i = 0; i < IMPORT_RANK_MAX; i++)
        H5free_memory(list[i]);
    close_texts(&t);
    return ok ? count : 0;
}

/* The names of dimensions that h5py and others write. */
static void read_own_labels(hid_t dataset, struct array_info *info) {
    char labels[IMPORT_RANK_MAX][ARRAY_NAME_BYTES];
    if (hdf5_texts(dataset, "DIMENSION_LABELS", labels) == info->rank)
        memcpy(info->dims, labels, info->rank * sizeof labels[0]);
}

/* Reads the path of a scale, and its name where the dimension has no label. */
static void read_scale(hid_t file, const hobj_ref_t *reference, unsigned d,
                       struct array_info *info) {
    char path[ARRAY_NAME_BYTES], name[ARRAY_NAME_BYTES];
    hid_t scale = H5Rdereference2(file, H5P_DEFAULT, H5R_OBJECT, reference);
    if (scale < 0)
        return;
    const ssize_t length = H5Iget_name(scale, path, sizeof path);
    if (length > 0 && length < (ssize_t)sizeof path && H5Iget_type(scale) == H5I_DATASET) {
        hdf5_text(scale, "NAME", name, sizeof name);
        const bool has_values = strncmp(name, no_variable, strlen(no_variable)) != 0;
        if (has_values)
            memcpy(info->scales[d], path, sizeof path);
        if (!info->dims[d][0])
            snprintf(info->dims[d], sizeof info->dims[d], "%s",
                     has_values && name[0] ? name : strrchr(path, '/') + 1);
    }
    H5Oclose(scale);
}

/* The references to scales that H5DSattach_scale() and NetCDF write: a list per dimension, of which
 * the first scale counts. */
static void read_scales(hid_t file, hid_t dataset, struct array_info *info) {
    static const char name[] = "DIMENSION_LIST";
    hvl_t lists[IMPORT_RANK_MAX];
    memset(lists, 0, sizeof lists);
    hid_t attribute = H5Aexists(dataset, name) > 0 ? H5Aopen(dataset, name, H5P_DEFAULT) : -1;
    if (attribute < 0)
        return;
    hid_t type = H5Aget_type(attribute), space = H5Aget_space(attribute);
    hid_t base = type >= 0 && H5Tget_class(type) == H5T_VLEN ? H5Tget_super(type) : -1;
    const bool are_lists = base >= 0 && H5Tequal(base, H5T_STD_REF_OBJ) > 0 && space >= 0 &&
                           H5Sget_simple_extent_npoints(space) == (hssize_t)info->rank;
    if (are_lists && H5Aread(attribute, type, lists) >= 0) {
        for (unsigned d = 0; d < info->rank; d++)
            if (lists[d].len > 0)
                read_scale(file, lists[d].p, d, info);
        H5Dvlen_reclaim(type, space, H5P_DEFAULT, lists);
    }
    hdf5_close(base);
    hdf5_close(space);
    hdf5_close(type);
    H5Aclose(attribute);
}

void hdf5_read_dimensions(hid_t file, hid_t dataset, struct array_info *info) {
    char text[sizeof no_variable];
    hdf5_text(dataset, "NAME", text, sizeof text);
    if (strcmp(text, no_variable) == 0)
        snprintf(info->problem, sizeof info->problem,
                 "it is a dimension of NetCDF without coordinates");
    hdf5_text(dataset, "CLASS", text, sizeof text);
    info->is_scale = strcmp(text, "DIMENSION_SCALE") == 0;
    info->has_default_fill = H5Aexists(file, "_NCProperties") > 0;
    read_own_labels(dataset, info);
    read_scales(file, dataset, info);
}

/* The labels of an object, which are in the order of Fortran if it says so. */
static void read_labels_of(hid_t object, struct array_info *info) {
    char labels[IMPORT_RANK_MAX][ARRAY_NAME_BYTES], order[8];
    if (H5Aexists(object, "gridSpacing") <= 0 ||
        hdf5_texts(object, "axisLabels", labels) != info->rank)
        return;
    hdf5_text(object, "dataOrder", order, sizeof order);
    for (unsigned d = 0; d < info->rank; d++)
        memcpy(info->dims[d], labels[order[0] == 'F' ? info->rank - 1 - d : d], sizeof labels[0]);
}

void hdf5_read_labels(hid_t file, hid_t dataset, struct array_info *info) {
    char group[ARRAY_NAME_BYTES];
    if (info->rank < 2 || info->dims[0][0]) /* the array of coordinates also has one dimension */
        return;
    read_labels_of(dataset, info);
    snprintf(group, sizeof group, "%s", info->name);
    char *own = strrchr(group, '/');
    if (info->dims[0][0] || !own)
        return;
    own[own == group] = 0;
    const hid_t parent = H5Oopen(file, group, H5P_DEFAULT);
    if (parent < 0)
        return;
    read_labels_of(parent, info);
    H5Oclose(parent);
}
