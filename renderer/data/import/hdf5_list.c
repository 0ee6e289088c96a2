/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/hdf5_list.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/grow.h"
#include "data/import/hdf5_dims.h"

enum { DEFAULT_DEPTH = 8, SOURCES_MAX = 1 << 16 };

/* Listing. */

static struct hdf5_entry *add(struct hdf5_list *list, const char *name) {
    if (!sp_grow(&list->entries, list->count, sizeof *list->entries))
        return NULL;
    struct hdf5_entry *entry = &list->entries[list->count++];
    *entry = (struct hdf5_entry){ .address = HADDR_UNDEF };
    snprintf(entry->name, sizeof entry->name, "/%.*s", ARRAY_NAME_BYTES - 2, name);
    return entry;
}

/* Takes the signal of a group of NeXus. */
static void look_at_group(struct hdf5_list *list, hid_t root, const char *name) {
    char signal[ARRAY_NAME_BYTES];
    hid_t group = H5Oopen(root, name, H5P_DEFAULT);
    if (group < 0)
        return;
    hdf5_text(group, "signal", signal, sizeof signal);
    if (*signal) {
        list->signals++;
        if (snprintf(list->signal, sizeof list->signal, "/%s/%s", name, signal) >=
            (int)sizeof list->signal)
            list->signal[0] = 0;
    }
    H5Oclose(group);
}

/* A data set: an alias if it was there before by another name. */
static bool add_object(struct hdf5_list *list, hid_t root, const char *name, bool is_link) {
    H5O_info_t info;
    if (H5Oget_info_by_name2(root, name, &info, H5O_INFO_BASIC, H5P_DEFAULT) < 0)
        return true;
    if (info.type == H5O_TYPE_GROUP && !is_link)
        look_at_group(list, root, name);
    if (info.type != H5O_TYPE_DATASET)
        return true;
    bool is_alias = is_link;
    for (unsigned i = 0; i < list->count && !is_alias; i++)
        is_alias = list->entries[i].address == info.addr && !list->entries[i].is_alias;
    struct hdf5_entry *entry = add(list, name);
    if (!entry)
        return false;
    entry->is_alias = is_alias;
    entry->address = info.addr;
    return true;
}

/* A link to a place in this file or in another one. */
static bool add_link(struct hdf5_list *list, hid_t root, const char *name, const H5L_info_t *info) {
    char value[1024];
    const char *file = NULL, *object = value;
    unsigned flags;
    if (info->type == H5L_TYPE_SOFT && H5Oexists_by_name(root, name, H5P_DEFAULT) > 0)
        return add_object(list, root, name, true);
    if (info->u.val_size > sizeof value ||
        H5Lget_val(root, name, value, sizeof value, H5P_DEFAULT) < 0 ||
        (info->type == H5L_TYPE_EXTERNAL &&
         H5Lunpack_elink_val(value, info->u.val_size, &flags, &file, &object) < 0))
        return true;
    struct hdf5_entry *entry = add(list, name);
    if (!entry)
        return false;
    entry->is_alias = true;
    if (file)
        snprintf(entry->problem, sizeof entry->problem,
                 "it is a link to %.60s in the file %.60s; links to other files are not followed: "
                 "open that file",
                 object, file);
    else
        snprintf(entry->problem, sizeof entry->problem,
                 "it is a link to %.100s, which is not in the file", value);
    return true;
}

static herr_t visit(hid_t root, const char *name, const H5L_info_t *info, void *user) {
    struct hdf5_list *list = user;
    bool ok = true;
    if (strlen(name) + 2 > ARRAY_NAME_BYTES)
        return 0;
    if (info->type == H5L_TYPE_HARD)
        ok = add_object(list, root, name, false);
    else if (info->type == H5L_TYPE_SOFT || info->type == H5L_TYPE_EXTERNAL)
        ok = add_link(list, root, name, info);
    return ok ? list->count == ARRAYS_MAX : -1;
}

/* Follows the attribute "default" of groups to the signal of NXdata. */
static void follow_default(hid_t file, char path[ARRAY_NAME_BYTES]) {
    char group[ARRAY_NAME_BYTES] = "/", name[ARRAY_NAME_BYTES], next[2 * ARRAY_NAME_BYTES + 2];
    for (int depth = 0; depth < DEFAULT_DEPTH; depth++) {
        hid_t object = H5Oopen(file, group, H5P_DEFAULT);
        if (object < 0)
            return;
        hdf5_text(object, "signal", name, sizeof name);
        const bool is_signal = *name;
        if (!is_signal)
            hdf5_text(object, "default", name, sizeof name);
        H5Oclose(object);
        const bool is_root = strcmp(group, "/") == 0;
        snprintf(next, sizeof next, "%s%s%s", *name == '/' || is_root ? "" : group,
                 *name == '/' ? "" : "/", name);
        if (!*name || strlen(next) >= ARRAY_NAME_BYTES)
            return;
        strcpy(is_signal ? path : group, next);
        if (is_signal)
            return;
    }
}

bool hdf5_list_fill(struct hdf5_list *list, hid_t file) {
    char path[ARRAY_NAME_BYTES] = "";
    if (H5Lvisit(file, H5_INDEX_NAME, H5_ITER_NATIVE, visit, list) < 0)
        return false;
    follow_default(file, path);
    if (!*path && list->signals == 1)
        memcpy(path, list->signal, sizeof path);
    if (!*path && H5Lexists(file, "/ITKImage", H5P_DEFAULT) > 0)
        snprintf(path, sizeof path, "/ITKImage/0/VoxelData");
    for (unsigned i = 0; i < list->count && *path; i++)
        if (strcmp(list->entries[i].name, path) == 0)
            list->preferred = i + 1;
    return true;
}

void hdf5_list_finish(struct hdf5_list *list) {
    for (unsigned i = 0; i < list->count; i++)
        free(list->entries[i].info);
    free(list->entries);
    list->entries = NULL;
    list->count = 0;
}

/* NeXus. */

/* Names dimension d after an axis beside the signal. "." stands for none. */
static void name_axis(const char *group, const char *axis, unsigned d, struct array_info *info) {
    if (!*axis || strcmp(axis, ".") == 0 || d >= info->rank)
        return;
    if (!info->dims[d][0])
        snprintf(info->dims[d], sizeof info->dims[d], "%.100s", axis);
    if (!info->scales[d][0] && snprintf(info->scales[d], sizeof info->scales[d], "%s/%.100s", group,
                                        axis) >= (int)sizeof info->scales[d])
        info->scales[d][0] = 0;
}

/* The older way: "y:x" or "[y, x]" of the signal. */
static void parse_axes(const char *group, char *text, struct array_info *info) {
    unsigned d = 0;
    char *left = NULL;
    for (char *axis = strtok_r(text, ":,[] ", &left); axis; axis = strtok_r(NULL, ":,[] ", &left))
        name_axis(group, axis, d++, info);
}

void hdf5_read_nexus(hid_t file, hid_t dataset, struct array_info *info) {
    char group[ARRAY_NAME_BYTES], signal[ARRAY_NAME_BYTES], text[1024];
    char axes[IMPORT_RANK_MAX][ARRAY_NAME_BYTES];
    snprintf(group, sizeof group, "%s", info->name);
    char *own = strrchr(group, '/');
    if (!own)
        return;
    *own++ = 0;
    hid_t parent = H5Oopen(file, *group ? group : "/", H5P_DEFAULT);
    if (parent < 0)
        return;
    hdf5_text(parent, "signal", signal, sizeof signal);
    hdf5_text(dataset, "axes", text, sizeof text);
    if (strcmp(signal, own) == 0) {
        const unsigned count = hdf5_texts(parent, "axes", axes);
        for (unsigned d = 0; d < count && count == info->rank; d++)
            name_axis(group, axes[d], d, info);
    }
    if (*text)
        parse_axes(group, text, info);
    H5Oclose(parent);
}

/* Numbers in other files. */

/* Checks one part of a virtual data set. */
static bool check_source(const struct array_place *place, hid_t own, const char *file,
                         const char *name, char *problem, size_t capacity) {
    char real[PATH_MAX];
    if (strcmp(file, ".") != 0 && !place->find(place, file, real)) {
        snprintf(problem, capacity,
                 "it is a virtual data set that needs the file %.100s, which is missing or lies "
                 "outside of the folder; put it beside this file",
                 file);
        return false;
    }
    hid_t source = strcmp(file, ".") == 0 ? own : H5Fopen(real, H5F_ACC_RDONLY, H5P_DEFAULT);
    hid_t dataset = source >= 0 ? H5Dopen2(source, name, H5P_DEFAULT) : -1;
    const bool ok = dataset >= 0;
    if (ok)
        H5Dclose(dataset);
    else
        snprintf(problem, capacity,
                 "it is a virtual data set that needs the array %.60s of the file %.80s, which "
                 "cannot be opened",
                 name, file);
    if (source >= 0 && source != own)
        H5Fclose(source);
    return ok;
}

static void check_virtual(const struct array_place *place, hid_t file, hid_t properties,
                          char *problem, size_t capacity) {
    char name[PATH_MAX], last[PATH_MAX] = "", array[1024];
    size_t count = 0;
    bool ok = H5Pget_virtual_count(properties, &count) >= 0;
    for (size_t i = 0; ok && i < count; i++) {
        const ssize_t got[2] = { H5Pget_virtual_filename(properties, i, name, sizeof name),
                                 H5Pget_virtual_dsetname(properties, i, array, sizeof array) };
        ok = got[0] > 0 && got[0] < (ssize_t)sizeof name && got[1] > 0 &&
             got[1] < (ssize_t)sizeof array;
        if (ok && (i >= SOURCES_MAX || strchr(name, '%') || strchr(array, '%'))) {
            snprintf(
                problem, capacity,
                "it is a virtual data set of files that are counted, such as %.80s; save it as "
                "one array",
                name);
            return;
        }
        if (ok && strcmp(name, last) != 0 &&
            !check_source(place, file, name, array, problem, capacity))
            return;
        memcpy(last, name, sizeof last);
    }
    if (!ok)
        snprintf(problem, capacity, "its list of sources is damaged");
}

void hdf5_check_sources(const struct array_place *place, hid_t file, hid_t properties,
                        char *problem, size_t capacity) {
    char name[256] = "";
    off_t offset = 0;
    hsize_t size = 0;
    if (H5Pget_layout(properties) == H5D_VIRTUAL) {
        check_virtual(place, file, properties, problem, capacity);
        return;
    }
    H5Pget_external(properties, 0, sizeof name - 1, name, &offset, &size);
    snprintf(problem, capacity,
             "its numbers are in the file %.80s (external storage); save it as an array in this "
             "file, as h5copy and h5py do",
             name);
}
