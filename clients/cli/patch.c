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
 * the default. False when out of memory. */
static bool merge(proto_json *into, const proto_json *patch) {
    void *at = NULL;
    const char *key;
    const proto_json *value;
    bool ok = true;
    while (ok && proto_json_next(patch, &at, &key, &value)) {
        const proto_json *old = proto_json_get(into, key);
        if (proto_json_type(old) == PROTO_JSON_OBJECT &&
            proto_json_type(value) == PROTO_JSON_OBJECT)
            ok = merge((proto_json *)old, value); /* `into` is ours */
        else
            ok = proto_json_set(into, key, proto_json_ref((proto_json *)value));
    }
    return ok;
}

/* Puts the preset under the view. Takes ownership of `view`; NULL with *err set on failure. */
static proto_json *add_preset(const char *name, struct http *http, proto_json *view,
                              struct sp_error *err) {
    char *path = collection_path(http, "presets", name, err);
    proto_json *preset = path ? http_json(http, "GET", path, NULL, err) : NULL;
    if (preset && !merge(preset, view)) {
        sp_fail(err, SP_ERR_MEMORY, name, "out of memory");
        proto_json_free(&preset);
    }
    free(path);
    proto_json_free(&view);
    return preset;
}

/* Returns the object of the view, which replaces what is none. */
static proto_json *object_of(proto_json *view, const char *name) {
    if (proto_json_type(proto_json_get(view, name)) != PROTO_JSON_OBJECT &&
        !proto_json_set(view, name, proto_json_object()))
        return NULL;
    return (proto_json *)proto_json_get(view, name); /* `view` is ours */
}

/* A position in the view would contradict the angles; --azimuth and the others replace it. */
static bool set_camera(const struct options *options, proto_json *view) {
    static const char *const names[CAMERA_OPTIONS] = { "azimuth", "elevation", "distance", "roll" };
    bool ok = true;
    for (int i = 0; i < CAMERA_OPTIONS; i++) {
        if (isnan(options->camera[i]))
            continue;
        proto_json *camera = object_of(view, "camera");
        ok = ok && camera && proto_json_set_number(camera, names[i], options->camera[i]);
    }
    return ok;
}

static bool set_step(const struct options *options, proto_json *view) {
    proto_json *time = options->has_step ? object_of(view, "time") : NULL;
    return !options->has_step || (time && proto_json_set_integer(time, "step", options->step));
}

static bool set_size(const struct options *options, proto_json *view) {
    if (!options->size[0])
        return true;
    proto_json *size = proto_json_array();
    bool ok = proto_json_append_integer(size, options->size[0]) &&
              proto_json_append_integer(size, options->size[1]);
    return proto_json_set(view, "size", size) && ok;
}

/* A window in the view belongs to its projection; that of --projection has a window of its own. */
static bool set_projection(const struct options *options, proto_json *view) {
    if (!options->projection && isnan(options->window[0]))
        return true;
    proto_json *compositing = object_of(view, "compositing");
    bool ok = compositing != NULL;
    if (ok && options->projection)
        ok = proto_json_set_string(compositing, "mode", options->projection) &&
             proto_json_set(compositing, "window", proto_json_object());
    proto_json *window = ok ? object_of(compositing, "window") : NULL;
    if (ok && !isnan(options->window[0]))
        ok = proto_json_set_number(window, "center", options->window[0]) &&
             proto_json_set_number(window, "width", options->window[1]);
    return ok && window;
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
    if (view && (!set_camera(options, view) || !set_size(options, view) ||
                 !set_step(options, view) || !set_projection(options, view))) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
        proto_json_free(&view);
    }
    if (view && !check_window(options, view, err))
        proto_json_free(&view);
    if (view && !layers_apply(options, http, view, err))
        proto_json_free(&view);
    return view;
}
