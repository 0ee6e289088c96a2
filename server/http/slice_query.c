/* SPDX-License-Identifier: Apache-2.0 */
#include "http/slice_query.h"

#include <string.h>

#include "http/headers.h"

/* Refuses the form of a parameter with what it must be. */
static bool refuse(struct sp_error *err, const char *name, const char *text, const char *wanted) {
    return sp_fail(err, SP_ERR_FORMAT, name, "\"%.60s\" must be %s", text, wanted);
}

/* Reads `count` numbers, if the parameter is given. */
static bool read_numbers(srv_query_get *get, void *user, const char *name, unsigned count,
                         double *numbers, bool *is_given, struct sp_error *err) {
    const char *text = get(user, name);
    *is_given = text != NULL;
    return !text || srv_query_numbers(text, count, numbers) ||
           refuse(err, name, text,
                  count == 1   ? "a number"
                  : count == 2 ? "two numbers, separated by a comma"
                               : "three numbers, separated by commas");
}

/* Reads a whole number in [0, UINT32_MAX], if the parameter is given. */
static bool read_count(srv_query_get *get, void *user, const char *name, uint32_t *number,
                       bool *is_given, struct sp_error *err) {
    double value = 0;
    if (!read_numbers(get, user, name, 1, &value, is_given, err))
        return false;
    if (!(value >= 0 && value <= UINT32_MAX) || value != (double)(uint32_t)value)
        return refuse(err, name, get(user, name), "a whole number from 0 on");
    *number = (uint32_t)value;
    return true;
}

static bool read_format(struct srv_slice_query *query, srv_query_get *get, void *user,
                        struct sp_error *err) {
    static const char *const names[] = { "png", "jpeg", "raw" };
    const char *text = get(user, "format");
    for (unsigned i = 0; text && i < 3; i++)
        if (strcmp(text, names[i]) == 0) {
            query->format = (enum srv_slice_format)i;
            return true;
        }
    return !text || refuse(err, "format", text, "png, jpeg or raw");
}

static bool read_color(struct srv_slice_query *query, srv_query_get *get, void *user,
                       struct sp_error *err) {
    const char *text = get(user, "color");
    query->is_colored = text && strcmp(text, "transfer") == 0;
    return !text || query->is_colored || strcmp(text, "grey") == 0 ||
           refuse(err, "color", text, "grey or transfer");
}

static bool read_plane(struct srv_slice_query *query, srv_query_get *get, void *user,
                       struct sp_error *err) {
    struct sp_slice_plane *plane = &query->plane;
    const char *size = get(user, "size");
    bool has_origin, has_normal, has_up, has_spacing;
    if (!read_numbers(get, user, "origin", 3, plane->origin, &has_origin, err) ||
        !read_numbers(get, user, "normal", 3, plane->normal, &has_normal, err) ||
        !read_numbers(get, user, "up", 3, plane->up, &has_up, err) ||
        !read_numbers(get, user, "spacing", 1, &plane->spacing, &has_spacing, err))
        return false;
    if (!has_origin || !has_normal || !size)
        return sp_fail(err, SP_ERR_INVALID,
                       !has_origin   ? "origin"
                       : !has_normal ? "normal"
                                     : "size",
                       "give axis= and index=, or origin=, normal= and size=");
    if (has_spacing && !(plane->spacing > 0))
        return refuse(err, "spacing", get(user, "spacing"), "above 0");
    return srv_query_size(size, plane->size) ||
           refuse(err, "size", size, "WIDTH,HEIGHT: two whole numbers of pixels");
}

bool srv_slice_query_read(struct srv_slice_query *query, srv_query_get *get, void *user,
                          struct sp_error *err) {
    bool has_axis, has_index, has_window;
    *query = (struct srv_slice_query){ .format = SRV_SLICE_PNG };
    if (!read_format(query, get, user, err) || !read_color(query, get, user, err) ||
        !read_numbers(get, user, "window", 2, query->window, &has_window, err) ||
        !read_count(get, user, "axis", &query->axis, &has_axis, err) ||
        !read_count(get, user, "index", &query->index, &has_index, err))
        return false;
    if (!read_count(get, user, "level", &query->level, &query->has_level, err))
        return false;
    if (has_window && !(query->window[1] > 0))
        return refuse(err, "window", get(user, "window"), "CENTRE,WIDTH with a width above 0");
    static const char *const of_planes[] = { "origin", "normal", "up", "size", "spacing" };
    query->is_oblique = !has_axis && !has_index;
    if (query->is_oblique)
        return query->has_level
                   ? sp_fail(err, SP_ERR_INVALID, "level",
                             "belongs to axis= and index=; an oblique slice has its spacing=")
                   : read_plane(query, get, user, err);
    if (!has_axis || !has_index)
        return sp_fail(err, SP_ERR_INVALID, has_axis ? "index" : "axis",
                       "give axis= and index= together");
    for (size_t i = 0; i < sizeof of_planes / sizeof *of_planes; i++)
        if (get(user, of_planes[i]))
            return sp_fail(err, SP_ERR_INVALID, of_planes[i],
                           "belongs to an oblique slice: leave out axis= and index=");
    return true;
}

bool srv_slice_query_resolve(const struct srv_slice_query *query, const struct sp_volume_info *info,
                             struct sp_slice *slice, struct sp_error *err) {
    return query->is_oblique
               ? sp_slice_init_oblique(slice, info, &query->plane, err)
               : sp_slice_init_orthogonal(slice, info, query->axis, query->index, err);
}
