/* SPDX-License-Identifier: Apache-2.0
 *
 * --channel: other volumes on the same grid, mixed with the volume in one image.
 */
#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "cli/commands.h"

static const double OPACITY_DEFAULT = 0.5;

/* Colours for channels that name none, in the order of the options, as microscopists choose them.
 */
static const double palette[][3] = { { 0, 1, 0 }, { 1, 0, 1 }, { 0, 1, 1 }, { 1, 1, 0 },
                                     { 1, 0, 0 }, { 0, 0, 1 }, { 1, 1, 1 } };
enum { PALETTE_COLORS = sizeof palette / sizeof palette[0] };

/* A field whose name ends in one of these, such as "rgb red", has its colour. */
static const struct named {
    const char *name;
    double color[3];
} named[] = { { "red", { 1, 0, 0 } },  { "green", { 0, 1, 0 } },   { "blue", { 0, 0, 1 } },
              { "cyan", { 0, 1, 1 } }, { "magenta", { 1, 0, 1 } }, { "yellow", { 1, 1, 0 } },
              { "white", { 1, 1, 1 } } };

/* Reads COLOR[,LOW,HIGH[,OPACITY]] to the end of the text. */
static bool parse_look(const char *at, struct channel_option *channel) {
    bool ok = *at == ',' || parse_color(&at, channel->color); /* ,,LOW,HIGH: the default colour */
    if (ok && parse_comma(&at)) {
        channel->opacity = OPACITY_DEFAULT;
        ok = parse_finite(&at, &channel->low) && parse_comma(&at) &&
             parse_finite(&at, &channel->high);
        if (ok && parse_comma(&at))
            ok = parse_finite(&at, &channel->opacity);
        ok = ok && channel->low < channel->high && channel->opacity >= 0 && channel->opacity < 1;
    }
    return ok && *at == 0;
}

/* A source may have commas: it ends before the first one that a look follows. */
bool channels_parse(struct options *options, const char *text) {
    struct layer_options *layers = &options->layers;
    const struct channel_option plain = { .source = text,
                                          .source_bytes = strlen(text),
                                          .color = { NAN, NAN, NAN },
                                          .low = NAN,
                                          .high = NAN };
    struct channel_option channel = plain;
    const char *comma = strchr(text, ',');
    bool ok = !comma && *text;
    if (layers->channel_count == CHANNELS_MAX)
        return refuse_option("--channel", "a view has at most %d channels beside the volume",
                             CHANNELS_MAX);
    for (; comma && !ok; comma = strchr(comma + 1, ',')) {
        channel = plain;
        channel.source_bytes = (size_t)(comma - text);
        ok = comma > text && parse_look(comma + 1, &channel);
    }
    if (!ok)
        return refuse_option(
            "--channel",
            "\"%s\" is not SOURCE[,COLOR[,LOW,HIGH[,OPACITY]]], such as "
            "cells.tif?field=GFP,00ff00,100,4000,0.5, with a colour RRGGBB in hexadecimal "
            "digits, LOW < HIGH and an opacity in [0, 1); a source with commas needs a "
            "colour",
            text);
    layers->channels[layers->channel_count++] = channel;
    return true;
}

static bool is_color(const proto_json *color, const double wanted[3]) {
    bool ok = proto_json_size(color) == 3;
    for (size_t c = 0; ok && c < 3; c++) {
        double value;
        ok = proto_json_number(proto_json_at(color, c), &value) && fabs(value - wanted[c]) < 0.01;
    }
    return ok;
}

/* True if the last of the points has this colour. */
static bool ends_with(const proto_json *points, const double color[3]) {
    size_t count = proto_json_size(points);
    return count > 0 && is_color(proto_json_get(proto_json_at(points, count - 1), "color"), color);
}

/* True if the volume, by the points of the view, a channel of the list or one of the options has
 * the colour. */
static bool is_used(const struct layer_options *layers, const proto_json *view,
                    const proto_json *list, const double color[3]) {
    bool is = ends_with(proto_json_get(proto_json_get(view, "transfer_function"), "points"), color);
    for (size_t i = 0; i < proto_json_size(list); i++) {
        const proto_json *layer = proto_json_at(list, i);
        if (strcmp(text_of(layer, "type"), "channel") == 0)
            is |= is_color(proto_json_get(layer, "color"), color) ||
                  ends_with(proto_json_get(layer, "points"), color);
    }
    for (int i = 0; i < layers->channel_count; i++)
        is |= memcmp(layers->channels[i].color, color, sizeof layers->channels[i].color) == 0;
    return is;
}

/* The colour that the last word of the field's name, after "field=" in the source, tells; NULL =
 * none. */
static const double *color_of_field(const struct channel_option *channel) {
    static const char key[] = "field=";
    const char *field = strstr(channel->source, key);
    const char *limit = channel->source + channel->source_bytes;
    if (!field || field > limit)
        return NULL;
    field += strlen(key);
    const char *end = memchr(field, '&', (size_t)(limit - field));
    end = end ? end : limit;
    const char *word = end;
    while (word > field && isalpha((unsigned char)word[-1]))
        word--;
    for (size_t i = 0; i < sizeof named / sizeof *named; i++)
        if ((size_t)(end - word) == strlen(named[i].name) &&
            strncasecmp(word, named[i].name, (size_t)(end - word)) == 0)
            return named[i].color;
    return NULL;
}

static const double *choose_color(const struct layer_options *layers,
                                  const struct channel_option *channel, const proto_json *view,
                                  const proto_json *list) {
    if (!isnan(channel->color[0]))
        return channel->color;
    const double *own = color_of_field(channel);
    if (own)
        return own;
    for (size_t i = 0; i < PALETTE_COLORS; i++)
        if (!is_used(layers, view, list, palette[i]))
            return palette[i];
    return palette[PALETTE_COLORS - 1];
}

static void append_point(proto_json **points, double value, double opacity, const double color[3]) {
    proto_json *point = proto_json_object();
    proto_json_set_number(&point, "value", value);
    proto_json_set_number(&point, "opacity", opacity);
    proto_json_set(&point, "color", proto_json_numbers(color, 3));
    proto_json_append(points, point);
}

static void append_channel(const struct channel_option *channel, const char *id,
                           const double color[3], proto_json **list) {
    proto_json *layer = proto_json_object();
    proto_json_set_string(&layer, "type", "channel");
    proto_json_set_string(&layer, "id", id);
    proto_json_set(&layer, "color", proto_json_numbers(color, 3));
    if (!isnan(channel->low)) {
        proto_json *points = proto_json_array();
        append_point(&points, channel->low, 0, color);
        append_point(&points, channel->high, channel->opacity, color);
        proto_json_set(&layer, "points", points);
    }
    proto_json_append(list, layer);
}

/* Grey channels cannot be told apart, so a projection of --projection is in colour, unless the view
 * says something else. A sum has no colours. */
static void set_colors(const struct options *options, proto_json **view) {
    if (options->projection && strcmp(options->projection, "sum") != 0 &&
        !proto_json_get(proto_json_get(*view, "compositing"), "colors"))
        set_member(view, "compositing", "colors", proto_json_new_string("transfer_function"));
}

bool channels_append(const struct options *options, struct http *http, proto_json **view,
                     proto_json **list, struct sp_error *err) {
    const struct layer_options *layers = &options->layers;
    for (int i = 0; i < layers->channel_count; i++) {
        const struct channel_option *channel = &layers->channels[i];
        char *source = strndup(channel->source, channel->source_bytes);
        char *id = source;
        if (source && !options->local) {
            id = resolve_volume(http, options, source, false, true, err);
            free(source);
            if (!id)
                return false;
        }
        if (id)
            append_channel(channel, id, choose_color(layers, channel, *view, *list), list);
        else
            proto_json_free(list);
        free(id);
    }
    if (layers->channel_count > 0)
        set_colors(options, view);
    return (*list && *view) || sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
}
