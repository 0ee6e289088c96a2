/* SPDX-License-Identifier: Apache-2.0
 *
 * The layers of a view from the command line: --surface, --shell, --vectors, --color-by and
 * --no-volume; channels.c has --channel. Streaks take the place of the volume, which would hide
 * them.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/commands.h"
#include "sp/view.h"

bool parse_finite(const char **text, double *out) {
    char *end;
    *out = strtod(*text, &end);
    bool ok = end != *text && isfinite(*out);
    *text = end;
    return ok;
}

bool parse_color(const char **text, double color[3]) {
    const char *at = *text + (**text == '#' ? 1 : 0);
    if (strspn(at, "0123456789abcdefABCDEF") != 6)
        return false;
    unsigned long all = strtoul(at, NULL, 16);
    for (int c = 0; c < 3; c++)
        color[c] = (double)(all >> (16 - 8 * c) & 255) / 255;
    *text = at + 6;
    return true;
}

bool parse_comma(const char **text) {
    bool ok = **text == ',';
    *text += ok ? 1 : 0;
    return ok;
}

bool layers_parse_surface(struct options *options, const char *text) {
    struct layer_options *layers = &options->layers;
    struct surface_option surface = { .color = { NAN, NAN, NAN }, .opacity = NAN };
    const char *at = text;
    if (layers->surface_count == LAYERS_MAX)
        return refuse_option("--surface", "a view has at most %d layers", LAYERS_MAX);
    bool ok = parse_finite(&at, &surface.value);
    if (ok && parse_comma(&at))
        ok = *at == ',' || parse_color(&at, surface.color); /* VALUE,,OPACITY: the default */
    if (ok && parse_comma(&at))
        ok = parse_finite(&at, &surface.opacity) && surface.opacity >= 0 && surface.opacity <= 1;
    if (!ok || *at)
        return refuse_option(
            "--surface",
            "\"%s\" is not VALUE[,COLOR[,OPACITY]], such as 120,ff8040,0.5 with a colour "
            "RRGGBB in hexadecimal digits and an opacity in [0, 1]",
            text);
    layers->surfaces[layers->surface_count++] = surface;
    return true;
}

bool layers_parse_shell(struct options *options, const char *text) {
    struct layer_options *layers = &options->layers;
    const char *at = text;
    double low, high;
    if (!isnan(layers->low))
        return refuse_option("--shell", "a view has at most one shell");
    bool ok = parse_finite(&at, &low) && parse_comma(&at) && parse_finite(&at, &high) && low >= 0 &&
              low <= high && high <= 1;
    bool is_fast = strcmp(at, ",fast") == 0;
    if (!ok || (*at && !is_fast && strcmp(at, ",high") != 0))
        return refuse_option(
            "--shell",
            "\"%s\" is not LOW,HIGH[,fast], such as 0.05,0.95, with 0 <= LOW <= HIGH <= 1", text);
    layers->low = low;
    layers->high = high;
    layers->is_fast = is_fast;
    return true;
}

bool layers_parse_vectors(struct options *options, const char *text) {
    struct layer_options *layers = &options->layers;
    static const char *const styles[] = { "modulate", "blend" };
    size_t length = strcspn(text, ",");
    const char *at = text + length, *style = NULL;
    if (layers->style)
        return refuse_option("--vectors", "a view has at most one layer of vectors");
    for (size_t i = 0; i < sizeof styles / sizeof styles[0]; i++)
        if (length == strlen(styles[i]) && strncmp(text, styles[i], length) == 0)
            style = styles[i];
    double stretch = NAN, density = NAN;
    bool ok = style;
    if (ok && parse_comma(&at))
        ok = parse_finite(&at, &stretch) && stretch >= 1 && stretch <= 8;
    if (ok && parse_comma(&at))
        ok = parse_finite(&at, &density) && density >= 0 && density <= 1;
    if (!ok || *at)
        return refuse_option(
            "--vectors",
            "\"%s\" is not STYLE[,STRETCH[,DENSITY]], such as modulate,4,0.2, with a style "
            "modulate or blend, a stretch in [1, 8] and a density in [0, 1]",
            text);
    layers->style = style;
    layers->stretch = stretch;
    layers->density = density;
    return true;
}

static bool is_type(const proto_json *layer, const char *type) {
    const char *own = proto_json_string(proto_json_get(layer, "type"));
    return own && strcmp(own, type) == 0;
}

static void append_surface(proto_json **list, const struct surface_option *surface) {
    proto_json *layer = proto_json_object();
    proto_json_set_string(&layer, "type", "surface");
    proto_json_set_number(&layer, "value", surface->value);
    if (!isnan(surface->color[0]))
        proto_json_set(&layer, "color", proto_json_numbers(surface->color, 3));
    if (!isnan(surface->opacity))
        proto_json_set_number(&layer, "opacity", surface->opacity);
    proto_json_append(list, layer);
}

static void append_shell(proto_json **list, const struct layer_options *options) {
    proto_json *layer = proto_json_object();
    proto_json_set_string(&layer, "type", "shell");
    proto_json_set_number(&layer, "low", options->low);
    proto_json_set_number(&layer, "high", options->high);
    proto_json_set_string(&layer, "detail", options->is_fast ? "fast" : "high");
    proto_json_append(list, layer);
}

static void append_vectors(proto_json **list, const struct layer_options *options) {
    proto_json *layer = proto_json_object();
    proto_json_set_string(&layer, "type", "vectors");
    proto_json_set_string(&layer, "style", options->style);
    if (!isnan(options->stretch))
        proto_json_set_number(&layer, "stretch", options->stretch);
    if (!isnan(options->density))
        proto_json_set_number(&layer, "density", options->density);
    proto_json_append(list, layer);
}

/* Copies the layers of the view, or the default ones: without the volume for --no-volume, and
 * without the layers that --shell and --vectors replace. */
static proto_json *copy_layers(const struct layer_options *options, const proto_json *old) {
    proto_json *list = proto_json_array();
    for (size_t i = 0; i < proto_json_size(old); i++) {
        const proto_json *layer = proto_json_at(old, i);
        bool is_dropped = (options->no_volume && is_type(layer, "volume")) ||
                          (!isnan(options->low) && is_type(layer, "shell")) ||
                          (options->style && is_type(layer, "vectors"));
        if (!is_dropped)
            proto_json_append(&list, proto_json_ref((proto_json *)layer)); /* only read */
    }
    if (!old && !options->no_volume && !options->style) {
        proto_json *volume = proto_json_object();
        proto_json_set_string(&volume, "type", "volume");
        proto_json_append(&list, volume);
    }
    return list;
}

/* Sets `color_by` of the layers that have it. Loads the volume that it names if necessary. */
static bool set_color_by(const struct options *options, struct http *http, proto_json *view,
                         struct sp_error *err) {
    const char *wanted = options->layers.color_by;
    const proto_json *layers = proto_json_get(view, "layers");
    const bool is_loaded = options->local || strcmp(wanted, SP_COLOR_BY_LENGTH) == 0;
    bool is_found = false, ok = true;
    char *id = is_loaded ? strdup(wanted) : resolve_volume(http, options, wanted, false, true, err);
    for (size_t i = 0; id && i < proto_json_size(layers); i++) {
        proto_json *layer = proto_json_ref((proto_json *)proto_json_at(layers, i)); /* ours */
        if (is_type(layer, "vectors") || is_type(layer, "points")) {
            is_found = true;
            proto_json_set_string(&layer, "color_by", id);
        }
        ok = ok && layer;
        proto_json_free(&layer);
    }
    if (id && !ok)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
    if (id && !is_found)
        ok = sp_fail(err, SP_ERR_INVALID, "--color-by",
                     "needs --vectors, or a view with layers of vectors or points");
    ok = ok && id;
    free(id);
    return ok;
}

static bool add_layers(const struct options *options, struct http *http, proto_json **view,
                       struct sp_error *err) {
    const struct layer_options *layers = &options->layers;
    const proto_json *old = proto_json_get(*view, "layers");
    if (!layers->surface_count && !layers->channel_count && isnan(layers->low) && !layers->style &&
        !layers->no_volume)
        return true;
    if (proto_json_type(old) == PROTO_JSON_NULL)
        old = NULL;
    if (old && proto_json_type(old) != PROTO_JSON_ARRAY)
        return sp_fail(err, SP_ERR_INVALID, "/layers", "must be an array, not %s",
                       proto_json_type_name(proto_json_type(old)));
    proto_json *list = copy_layers(layers, old);
    for (int i = 0; i < layers->surface_count; i++)
        append_surface(&list, &layers->surfaces[i]);
    if (!isnan(layers->low))
        append_shell(&list, layers);
    if (layers->style)
        append_vectors(&list, layers);
    bool ok = channels_append(options, http, view, &list, err);
    if (ok && proto_json_size(list) == 0)
        ok = sp_fail(err, SP_ERR_INVALID, "--no-volume",
                     "leaves nothing to draw: add --surface, --shell, --vectors or --channel");
    if (!ok) {
        proto_json_free(&list);
        return false;
    }
    proto_json_set(view, "layers", list);
    return *view || sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
}

bool layers_apply(const struct options *options, struct http *http, proto_json **view,
                  struct sp_error *err) {
    return add_layers(options, http, view, err) &&
           (!options->layers.color_by || set_color_by(options, http, *view, err));
}
