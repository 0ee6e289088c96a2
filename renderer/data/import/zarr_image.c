/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/zarr_image.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "data/volume/anatomy.h"
#include "data/volume/unit.h"

/* What one multiscale image says about its axes. */
struct axes {
    unsigned rank;
    double factor[ZARR_RANK_MAX]; /* from the unit of each axis to the unit of x */
};

static const char *text_of(const json_t *object, const char *key) {
    const char *text = json_string_value(json_object_get(object, key));
    return text ? text : "";
}

/* Units. */

/* The image has the unit of x; other axes are converted to it. */
static void set_units(struct zarr_image *image, struct axes *axes,
                      const char *const names[ZARR_RANK_MAX]) {
    const struct sp_unit *of_x =
        image->axes.space[0] < 0 ? NULL : sp_unit_find(names[image->axes.space[0]]);
    if (image->axes.space[0] >= 0)
        snprintf(image->unit, sizeof image->unit, "%s",
                 of_x ? of_x->symbol : names[image->axes.space[0]]);
    for (int a = 0; a < 3; a++) {
        const int d = image->axes.space[a];
        const struct sp_unit *own = d < 0 ? NULL : sp_unit_find(names[d]);
        if (own && of_x)
            axes->factor[d] = own->meters / of_x->meters;
    }
}

static void parse_time_unit(struct zarr_image *image, const char *name) {
    static const char *const known[][2] = { { "second", "s" },       { "millisecond", "ms" },
                                            { "microsecond", "us" }, { "minute", "min" },
                                            { "hour", "h" },         { "day", "d" } };
    snprintf(image->time_unit, sizeof image->time_unit, "%s", name);
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (strcasecmp(name, known[i][0]) == 0)
            strcpy(image->time_unit, known[i][1]);
}

/* Axes. */

/* The "orientation" of each axis of space (RFC-4): "right-to-left". All or none. */
static void parse_anatomy(struct zarr_image *image, const json_t *axes) {
    static const char *const known[] = { "left-to-right",         "right-to-left",
                                         "posterior-to-anterior", "anterior-to-posterior",
                                         "inferior-to-superior",  "superior-to-inferior" };
    char letters[4] = "";
    for (int a = 0; a < 3; a++) {
        const json_t *axis = json_array_get(axes, (size_t)image->axes.space[a]);
        const json_t *orientation = json_object_get(axis, "orientation");
        for (size_t i = 0; i < sizeof known / sizeof *known; i++)
            if (strcmp(text_of(orientation, "type"), "anatomical") == 0 &&
                strcmp(text_of(orientation, "value"), known[i]) == 0)
                letters[a] = "RLAPSI"[i];
    }
    if (letters[0] && letters[1] && letters[2] && sp_anatomy_is_valid(letters))
        memcpy(image->anatomy, letters, sizeof letters);
}

/* The axes of OME-Zarr: {"name", "type", "unit"}. */
static bool parse_axes(struct zarr_image *image, const struct zarr_node *node, const json_t *json,
                       struct axes *axes, struct sp_error *err) {
    int space[ZARR_RANK_MAX];
    const char *names[ZARR_RANK_MAX], *unit_names[ZARR_RANK_MAX];
    unsigned count = 0;
    axes->rank = (unsigned)json_array_size(json);
    if (axes->rank < 1 || axes->rank > ZARR_RANK_MAX)
        return zarr_node_fail(node, err, SP_ERR_UNSUPPORTED, "/multiscales/0/axes",
                              "must have 1 to %d axes", ZARR_RANK_MAX);
    for (unsigned d = 0; d < axes->rank; d++) {
        const json_t *axis = json_array_get(json, d);
        const char *type = text_of(axis, "type");
        names[d] = json_is_string(axis) ? json_string_value(axis) : text_of(axis, "name");
        unit_names[d] = text_of(axis, "unit");
        axes->factor[d] = 1;
        if (strcmp(type, "channel") == 0 || (!*type && strcmp(names[d], "c") == 0))
            image->axes.channel = (int)d;
        else if (strcmp(type, "time") == 0 || (!*type && strcmp(names[d], "t") == 0))
            image->axes.time = (int)d;
        else
            space[count++] = (int)d;
    }
    if (count < 1 || count > 3)
        return zarr_node_fail(node, err, SP_ERR_UNSUPPORTED, "/multiscales/0/axes",
                              "has %u dimensions of space, outside [1, 3]", count);
    import_axes_place(&image->axes, space, count, names);
    set_units(image, axes, unit_names);
    if (count == 3)
        parse_anatomy(image, json);
    if (image->axes.time >= 0)
        parse_time_unit(image, unit_names[image->axes.time]);
    return true;
}

/* Levels. */

static bool add_level(struct zarr_image *image, const struct zarr_store *store, const char *path,
                      struct sp_error *err) {
    struct zarr_node node;
    const enum zarr_found found = zarr_node_open(&node, store, path, err);
    if (found == ZARR_MISSING)
        return zarr_fail(store, err, SP_ERR_NOT_FOUND, path, "",
                         "the metadata names this array, but it is missing");
    if (found == ZARR_FAILED)
        return false;
    struct zarr_level *level = &image->levels[image->level_count];
    bool ok = node.is_array ||
              zarr_node_fail(&node, err, SP_ERR_FORMAT, "", "the metadata is not that of an array");
    ok = ok && zarr_array_parse(&level->array, &node, err);
    const struct zarr_array *first = &image->levels[0].array;
    if (ok && (level->array.rank != first->rank || level->array.number.kind != first->number.kind ||
               level->array.number.size != first->number.size))
        ok = zarr_node_fail(&node, err, SP_ERR_FORMAT, "/shape",
                            "the levels of an image must have one type and number of dimensions");
    image->level_count += ok;
    zarr_node_close(&node);
    return ok;
}

/* Applies the transformations of a level or of the image to the scale and translation. */
static bool transform(const struct zarr_node *node, const json_t *list, unsigned rank,
                      const char *pointer, double *scale, double *shift, struct sp_error *err) {
    const json_t *one;
    size_t i;
    json_array_foreach(list, i, one) {
        const char *type = text_of(one, "type");
        const bool is_scale = strcmp(type, "scale") == 0;
        const json_t *numbers = json_object_get(one, is_scale ? "scale" : "translation");
        if (strcmp(type, "identity") == 0)
            continue;
        if ((!is_scale && strcmp(type, "translation") != 0) || json_array_size(numbers) != rank)
            return zarr_node_fail(node, err, SP_ERR_UNSUPPORTED, pointer,
                                  "must be \"scale\" or \"translation\" of %u numbers", rank);
        for (unsigned d = 0; d < rank; d++) {
            const double value = json_number_value(json_array_get(numbers, d));
            if (!isfinite(value) || (is_scale && value == 0))
                return zarr_node_fail(node, err, SP_ERR_FORMAT, pointer,
                                      "number %u must be finite, and of a scale not 0", d);
            scale[d] *= is_scale ? value : 1;
            shift[d] = is_scale ? shift[d] * value : shift[d] + value;
        }
    }
    return true;
}

static void place_level(const struct zarr_image *image, struct zarr_level *level,
                        const double *scale, const double *shift, const double *factor) {
    for (int a = 0; a < 3; a++) {
        const int d = image->axes.space[a];
        const uint64_t size = d < 0 ? 1 : level->array.shape[d];
        level->dims[a] = size > UINT32_MAX ? UINT32_MAX : (uint32_t)size;
        level->spacing[a] = d < 0 ? 1 : fabs(scale[d]) * factor[d];
        level->is_turned[a] = d >= 0 && scale[d] < 0;
        level->origin[a] = d < 0 ? 0 : shift[d] * factor[d];
    }
    if (image->axes.space[2] < 0) /* a flat image is as thick as its pixels are wide */
        level->spacing[2] = level->spacing[0];
}

/* `only`: the path of the one level that is taken; NULL = all. */
static bool parse_levels(struct zarr_image *image, const struct zarr_node *node,
                         const json_t *multiscale, const struct axes *axes, const char *only,
                         struct sp_error *err) {
    const json_t *dataset;
    size_t i;
    json_array_foreach(json_object_get(multiscale, "datasets"), i, dataset) {
        char path[ZARR_KEY_BYTES], pointer[64];
        double scale[ZARR_RANK_MAX], shift[ZARR_RANK_MAX] = { 0 };
        struct zarr_level *level = &image->levels[image->level_count];
        const bool is_first = image->level_count == 0;
        snprintf(pointer, sizeof pointer, "/multiscales/0/datasets/%zu", i);
        if (image->level_count >= ZARR_LEVELS_MAX)
            break;
        if (only && strcmp(text_of(dataset, "path"), only) != 0)
            continue;
        if (!zarr_key(path, node->path, text_of(dataset, "path")))
            return zarr_node_fail(node, err, SP_ERR_INVALID, pointer, "the path is too long");
        for (unsigned d = 0; d < axes->rank; d++)
            scale[d] = 1;
        if (!add_level(image, node->store, path, err))
            return false;
        if (level->array.rank != axes->rank)
            return zarr_node_fail(node, err, SP_ERR_FORMAT, pointer,
                                  "the array has %u dimensions, the image %u axes",
                                  level->array.rank, axes->rank);
        if (!is_first && image->axes.time >= 0 &&
            level->array.shape[image->axes.time] < image->levels[0].array.shape[image->axes.time])
            return zarr_node_fail(node, err, SP_ERR_FORMAT, pointer,
                                  "has fewer steps in time than level 0");
        if (!transform(node, json_object_get(dataset, "coordinateTransformations"), axes->rank,
                       pointer, scale, shift, err) ||
            !transform(node, json_object_get(multiscale, "coordinateTransformations"), axes->rank,
                       "/multiscales/0/coordinateTransformations", scale, shift, err))
            return false;
        place_level(image, level, scale, shift, axes->factor);
        if (is_first && image->axes.time >= 0) {
            image->first_time = shift[image->axes.time];
            image->interval = scale[image->axes.time];
        }
    }
    return image->level_count > 0 ||
           zarr_node_fail(node, err, SP_ERR_FORMAT, "/multiscales/0/datasets",
                          "the list of levels is empty");
}

/* Channels. */

static bool reserve_names(struct zarr_image *image, unsigned count) {
    char(*larger)[SP_FIELD_BYTES] = realloc(image->names, (size_t)count * sizeof *larger);
    if (!larger)
        return false;
    memset(larger + image->name_count, 0, (size_t)(count - image->name_count) * sizeof *larger);
    image->names = larger;
    return true;
}

static bool has_name(const struct zarr_image *image, const char *name) {
    for (unsigned i = 0; i < image->name_count; i++)
        if (strcmp(image->names[i], name) == 0)
            return true;
    return false;
}

/* The channels have the labels of "omero" if these are there and differ. */
static bool parse_channels(struct zarr_image *image, const struct zarr_node *node,
                           const json_t *omero, struct sp_error *err) {
    const struct zarr_array *a = &image->levels[0].array;
    const uint64_t count = image->axes.channel < 0 ? 1 : a->shape[image->axes.channel];
    if (count > ZARR_CHANNELS_MAX)
        return zarr_node_fail(node, err, SP_ERR_UNSUPPORTED, "/shape",
                              "the image has more than %d channels, the limit", ZARR_CHANNELS_MAX);
    image->channels = (uint32_t)count;
    image->steps = image->axes.time < 0 ? 1 : a->shape[image->axes.time];
    if (!reserve_names(image, image->channels))
        return sp_fail(err, SP_ERR_MEMORY, node->store->title, "out of memory for channels");
    for (unsigned i = 0; i < image->channels; i++) {
        const json_t *one = json_array_get(json_object_get(omero, "channels"), i);
        char name[SP_FIELD_BYTES] = "";
        import_name(name, text_of(one, "label"));
        if (image->channels > 1 && (!name[0] || has_name(image, name)))
            snprintf(name, sizeof name, "channel %u", i + 1);
        memcpy(image->names[image->name_count++], name, sizeof name);
    }
    return true;
}

static bool open_multiscale(struct zarr_image *image, const struct zarr_node *node,
                            const json_t *ome, const char *only, struct sp_error *err) {
    const json_t *multiscale = json_array_get(json_object_get(ome, "multiscales"), 0);
    const json_t *listed = json_object_get(multiscale, "axes");
    struct axes axes = { .rank = 0 };
    image->are_labels = json_is_object(json_object_get(ome, "image-label"));
    json_t *five = json_pack("[sssss]", "t", "c", "z", "y", "x"); /* before OME-Zarr 0.3 */
    const bool ok = parse_axes(image, node, listed ? listed : five, &axes, err);
    json_decref(five);
    if (!ok || !parse_levels(image, node, multiscale, &axes, only, err))
        return false;
    for (unsigned i = 1; image->axes.channel >= 0 && i < image->level_count; i++)
        if (image->levels[i].array.shape[image->axes.channel] !=
            image->levels[0].array.shape[image->axes.channel])
            return zarr_node_fail(node, err, SP_ERR_FORMAT, "/multiscales/0/datasets",
                                  "level %u has another number of channels than level 0", i);
    return parse_channels(image, node, json_object_get(ome, "omero"), err);
}

/* Plain arrays and groups. */

bool zarr_image_use_array(struct zarr_image *image, const struct zarr_array *array,
                          const struct import_axes *axes) {
    image->levels = calloc(1, sizeof *image->levels);
    if (!image->levels)
        return false;
    image->level_count = 1;
    image->axes = *axes;
    image->levels[0].array = *array;
    for (int a = 0; a < 3; a++) {
        image->levels[0].dims[a] = axes->space[a] < 0 ? 1 : (uint32_t)array->shape[axes->space[a]];
        image->levels[0].spacing[a] = 1;
    }
    return true;
}

static const json_t *ome_of(const struct zarr_node *node) {
    const json_t *of_v3 = json_object_get(node->attributes, "ome");
    return of_v3 ? of_v3 : node->attributes;
}

static bool open_node(struct zarr_image *image, const struct zarr_node *node, bool is_nested,
                      struct sp_error *err) {
    const json_t *ome = ome_of(node);
    if (!node->is_array && json_array_size(json_object_get(ome, "multiscales")) > 0)
        return open_multiscale(image, node, ome, NULL, err);
    if (!node->is_array && (json_object_get(ome, "plate") || json_object_get(ome, "well")))
        return zarr_node_fail(node, err, SP_ERR_UNSUPPORTED, "",
                              "this is a plate or well of several images; open one of them, such "
                              "as the folder A/1/0 of a plate");
    if (!node->is_array && json_object_get(ome, "bioformats2raw.layout") && !is_nested) {
        struct zarr_node first;
        if (zarr_node_open(&first, node->store, "0", err) == ZARR_FOUND) {
            const bool ok = open_node(image, &first, true, err);
            zarr_node_close(&first);
            return ok;
        }
        return zarr_node_fail(node, err, SP_ERR_NOT_FOUND, "", "the first image, 0, is missing");
    }
    image->is_plain = true;
    return true;
}

static bool init(struct zarr_image *image, const struct zarr_node *node, struct sp_error *err) {
    *image = (struct zarr_image){ .steps = 1 };
    image->axes = (struct import_axes){ .space = { -1, -1, -1 }, .channel = -1, .time = -1 };
    image->levels = calloc(ZARR_LEVELS_MAX, sizeof *image->levels);
    return image->levels || sp_fail(err, SP_ERR_MEMORY, node->store->title, "out of memory");
}

enum zarr_found zarr_image_open_level(struct zarr_image *image, const struct zarr_node *node,
                                      const char *path, struct sp_error *err) {
    const json_t *ome = ome_of(node), *dataset;
    const json_t *multiscale = json_array_get(json_object_get(ome, "multiscales"), 0);
    bool is_listed = false;
    size_t i;
    json_array_foreach(json_object_get(multiscale, "datasets"), i, dataset) {
        is_listed |= strcmp(text_of(dataset, "path"), path) == 0;
    }
    if (node->is_array || !is_listed)
        return ZARR_MISSING;
    if (init(image, node, err) && open_multiscale(image, node, ome, path, err))
        return ZARR_FOUND;
    zarr_image_close(image);
    return ZARR_FAILED;
}

bool zarr_image_open(struct zarr_image *image, const struct zarr_node *node, struct sp_error *err) {
    if (!init(image, node, err))
        return false;
    const bool ok = open_node(image, node, false, err);
    if (!ok || image->is_plain) {
        free(image->levels);
        image->levels = NULL;
    }
    if (!ok)
        zarr_image_close(image);
    return ok;
}

bool zarr_image_choose(struct zarr_image *image, const struct import_file *file,
                       struct import_header *header, struct sp_error *err) {
    const uint64_t *shape = image->levels[0].array.shape;
    const int channel = image->axes.channel, time = image->axes.time;
    if (!import_axes_choose(&image->axes, file, shape, header, err))
        return false;
    if (image->axes.channel == channel && image->axes.time == time)
        return true;
    if (image->axes.space[2] < 0 && image->level_count > 1 && channel < 0 && time < 0)
        return sp_fail(err, SP_ERR_UNSUPPORTED, file->title,
                       "?as=%s: the image has levels of detail, whose z axis is one of space",
                       import_as_name(file->selection.as));
    image->levels[0].dims[2] = image->axes.space[2] < 0 ? 1 : image->levels[0].dims[2];
    const uint64_t count = image->axes.channel < 0 ? 1 : shape[image->axes.channel];
    if (count > ZARR_CHANNELS_MAX)
        return sp_fail(err, SP_ERR_UNSUPPORTED, file->title, "?as=%s: more than %d channels",
                       import_as_name(file->selection.as), ZARR_CHANNELS_MAX);
    image->channels = (uint32_t)count;
    image->steps = image->axes.time < 0 ? 1 : shape[image->axes.time];
    image->interval = 0; /* the interval belongs to the other axis */
    image->name_count = 0;
    if (!reserve_names(image, image->channels))
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for channels");
    for (unsigned i = 0; i < image->channels; i++) {
        char *name = image->names[image->name_count++];
        name[0] = 0;
        if (image->channels > 1)
            snprintf(name, SP_FIELD_BYTES, "channel %u", i + 1);
    }
    return true;
}

void zarr_image_close(struct zarr_image *image) {
    free(image->levels);
    free(image->names);
    image->levels = NULL;
    image->names = NULL;
}
