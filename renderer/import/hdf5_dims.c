/* SPDX-License-Identifier: Apache-2.0 */
#include "import/hdf5_dims.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { TEXT_BYTES = 8192 };

/* The NAME of scales that NetCDF writes for dimensions without coordinates. */
static const char no_variable[] = "This is a netCDF dimension but not a netCDF variable";

void hdf5_text(hid_t object, const char *name, char *out, size_t capacity) {
    char fixed[TEXT_BYTES];
    out[0] = 0;
    hid_t attribute = H5Aexists(object, name) > 0 ? H5Aopen(object, name, H5P_DEFAULT) : -1;
    if (attribute < 0)
        return;
    hid_t type = H5Aget_type(attribute), space = H5Aget_space(attribute);
    const size_t size = type >= 0 ? H5Tget_size(type) : 0;
    const bool is_text = size > 0 && H5Tget_class(type) == H5T_STRING && space >= 0 &&
                         H5Sget_simple_extent_npoints(space) == 1;
    if (is_text && H5Tis_variable_str(type) > 0) {
        char *one = NULL;
        if (H5Aread(attribute, type, &one) >= 0 && one)
            snprintf(out, capacity, "%s", one);
        H5free_memory(one);
    } else if (is_text && size <= sizeof fixed && H5Aread(attribute, type, fixed) >= 0) {
        snprintf(out, capacity, "%.*s", (int)size, fixed);
    }
    if (space >= 0)
        H5Sclose(space);
    if (type >= 0)
        H5Tclose(type);
    H5Aclose(attribute);
}

/* Reads the names of dimensions that h5py and others write. */
static void take_labels(hid_t dataset, struct array_info *info) {
    static const char name[] = "DIMENSION_LABELS";
    char *labels[IMPORT_RANK_MAX] = { NULL };
    hid_t attribute =
        H5Aexists(dataset, name) > 0 ? H5Aopen(dataset, name, H5P_DEFAULT) : (hid_t)-1;
    if (attribute < 0)
        return;
    hid_t type = H5Aget_type(attribute), space = H5Aget_space(attribute);
    const bool is_list = type >= 0 && space >= 0 && H5Tis_variable_str(type) > 0 &&
                         H5Sget_simple_extent_npoints(space) == (hssize_t)info->rank;
    if (is_list && H5Aread(attribute, type, labels) >= 0)
        for (unsigned d = 0; d < info->rank; d++)
            snprintf(info->dims[d], sizeof info->dims[d], "%s", labels[d] ? labels[d] : "");
    for (unsigned d = 0; d < IMPORT_RANK_MAX; d++)
        H5free_memory(labels[d]);
    if (space >= 0)
        H5Sclose(space);
    if (type >= 0)
        H5Tclose(type);
    H5Aclose(attribute);
}

/* Takes the path of a scale, and its name where the dimension has no label. */
static void take_scale(hid_t file, const hobj_ref_t *reference, unsigned d,
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
static void take_scales(hid_t file, hid_t dataset, struct array_info *info) {
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
                take_scale(file, lists[d].p, d, info);
        H5Dvlen_reclaim(type, space, H5P_DEFAULT, lists);
    }
    if (base >= 0)
        H5Tclose(base);
    if (space >= 0)
        H5Sclose(space);
    if (type >= 0)
        H5Tclose(type);
    H5Aclose(attribute);
}

void hdf5_take_dimensions(hid_t file, hid_t dataset, struct array_info *info) {
    char text[32];
    hdf5_text(dataset, "CLASS", text, sizeof text);
    info->is_scale = strcmp(text, "DIMENSION_SCALE") == 0;
    info->has_default_fill = H5Aexists(file, "_NCProperties") > 0;
    take_labels(dataset, info);
    take_scales(file, dataset, info);
}
