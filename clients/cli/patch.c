/* SPDX-License-Identifier: Apache-2.0
 *
 * The view of a command: the preset, the file of --view over it, and single options over both.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/commands.h"
#include "cli/output.h"
#include "protocol/limits.h"

/* Reads the file of --view; an empty view if there is none. NULL with *err set on failure. */
static proto_json *read_file(const struct options *options, struct sp_error *err) {
    const char *name = options->view;
    if (!name)
        return proto_json_object();
    if (strcmp(name, "-") == 0)
        name = "standard input";
    size_t size;
    char *text = input_read(options->view, PROTO_BODY_MAX, &size, err);
    if (!text)
        return NULL;
    proto_json *view = proto_json_parse(text, size, err);
    free(text);
    if (!view && err)
        snprintf(err->place, sizeof err->place, "%s", name);
    if (view && proto_json_type(view) != PROTO_JSON_OBJECT) {
        sp_fail(err, SP_ERR_INVALID, name, "must be a view as a JSON object");
        proto_json_free(&view);
    }
    return view;
}

/* Merges the members of `patch` into `into`, object by object. A null stays: it asks the daemon for
 * the default. */
static void merge(proto_json **into, const proto_json *patch) {
    void *at = NULL;
    const char *key;
    const proto_json *value;
    while (proto_json_next(patch, &at, &key, &value)) {
        const proto_json *old = proto_json_get(*into, key);
        bool is_deep = proto_json_type(old) == PROTO_JSON_OBJECT &&
                       proto_json_type(value) == PROTO_JSON_OBJECT;
        proto_json *merged = proto_json_ref((proto_json *)(is_deep ? old : value)); /* old: ours */
        if (is_deep)
            merge(&merged, value);
        proto_json_set(into, key, merged);
    }
}

/* Puts the preset under the view. Takes ownership of `view`; NULL with *err set on failure. */
static proto_json *add_preset(const char *name, struct http *http, proto_json *view,
                              struct sp_error *err) {
    char *path = collection_path(http, "presets", name, err);
    proto_json *preset = path ? http_json(http, "GET", path, NULL, err) : NULL;
    if (preset) {
        merge(&preset, view);
        if (!preset)
            sp_fail(err, SP_ERR_MEMORY, name, "out of memory");
    }
    free(path);
    proto_json_free(&view);
    return preset;
}

void set_member(proto_json **view, const char *name, const char *member, proto_json *value) {
    const proto_json *old = proto_json_get(*view, name);
    proto_json *object = proto_json_type(old) == PROTO_JSON_OBJECT
                             ? proto_json_ref((proto_json *)old) /* ours */
                             : proto_json_object();
    proto_json_set(&object, member, value);
    proto_json_set(view, name, object);
}

/* A position in the view would contradict the angles; --azimuth and the others replace it. */
static void set_camera(const struct options *options, proto_json **view) {
    static const char *const names[CAMERA_OPTIONS] = { "azimuth", "elevation", "distance", "roll" };
    for (int i = 0; i < CAMERA_OPTIONS; i++)
        if (!isnan(options->camera[i]))
            set_member(view, "camera", names[i], proto_json_new_number(options->camera[i]));
}

/* A window in the view belongs to its projection, so --projection drops it; --window sets another.
 */
static void set_projection(const struct options *options, proto_json **view) {
    const double *center_width = options->window;
    const proto_json *old = proto_json_get(proto_json_get(*view, "compositing"), "window");
    bool has_window = !isnan(center_width[0]);
    if (!options->projection && !has_window)
        return;
    if (options->projection)
        set_member(view, "compositing", "mode", proto_json_new_string(options->projection));
    proto_json *window = options->projection || proto_json_type(old) != PROTO_JSON_OBJECT
                             ? proto_json_object()
                             : proto_json_ref((proto_json *)old); /* ours */
    if (has_window) {
        proto_json_set_number(&window, "center", center_width[0]);
        proto_json_set_number(&window, "width", center_width[1]);
    }
    set_member(view, "compositing", "window", window);
}

/* Sets what single options say of the view. */
static void set_options(const struct options *options, proto_json **view) {
    set_camera(options, view);
    if (options->size[0])
        proto_json_set(view, "size", proto_json_integers(options->size, 2));
    if (options->step != STEP_OF_VIEW)
        set_member(view, "time", "step", proto_json_new_integer(options->step));
    set_projection(options, view);
}

/* A window does nothing without a projection. */
static bool check_window(const struct options *options, const proto_json *view,
                         struct sp_error *err) {
    static const char *const projections[] = { "maximum", "minimum", "mean", "sum" };
    const char *mode = text_of(proto_json_get(view, "compositing"), "mode");
    bool is_projection = isnan(options->window[0]);
    for (int i = 0; i < 4; i++)
        is_projection |= strcmp(mode, projections[i]) == 0;
    return is_projection ||
           sp_fail(err, SP_ERR_INVALID, "--window",
                   "is the window of a projection: add --projection maximum, minimum, mean or sum");
}

proto_json *read_view(const struct options *options, struct http *http, struct sp_error *err) {
    proto_json *view = read_file(options, err);
    if (view && options->preset)
        view = add_preset(options->preset, http, view, err);
    if (view) {
        set_options(options, &view);
        if (!view)
            sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
    }
    if (view && !check_window(options, view, err))
        proto_json_free(&view);
    if (view && !layers_apply(options, http, &view, err))
        proto_json_free(&view);
    return view;
}
