/* SPDX-License-Identifier: Apache-2.0 */
#include "cli/options.h"
#include "sp/volume.h"

#include <errno.h>
#include <getopt.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SIZE_MAX_PX = 8192 };

enum option_id {
    OPT_URL = 1,
    OPT_TOKEN,
    OPT_VOLUME,
    OPT_VIEW,
    OPT_OUT,
    OPT_SIZE,
    OPT_FORMAT,
    OPT_QUALITY,
    OPT_LOCAL,
    OPT_THREADS,
    OPT_BACKEND,
    OPT_GPU,
    OPT_ISA,
    OPT_TIMEOUT,
    OPT_JSON,
    OPT_NO_WAIT,
    OPT_DELETE,
    OPT_ID,
    OPT_PRESET,
    OPT_AZIMUTH,
    OPT_ELEVATION,
    OPT_DISTANCE,
    OPT_ROLL,
    OPT_AXIS,
    OPT_INDEX,
    OPT_ORIGIN,
    OPT_NORMAL,
    OPT_UP,
    OPT_SPACING,
    OPT_WINDOW,
    OPT_STEP,
    OPT_PROJECTION,
    OPT_SURFACE,
    OPT_SHELL,
    OPT_VECTORS,
    OPT_COLOR_BY,
    OPT_CHANNEL,
    OPT_NO_VOLUME,
    OPT_HELP,
    OPT_VERSION
};

static const struct option known[] = {
    { "url", required_argument, NULL, OPT_URL },
    { "token", required_argument, NULL, OPT_TOKEN },
    { "volume", required_argument, NULL, OPT_VOLUME },
    { "view", required_argument, NULL, OPT_VIEW },
    { "out", required_argument, NULL, OPT_OUT },
    { "size", required_argument, NULL, OPT_SIZE },
    { "format", required_argument, NULL, OPT_FORMAT },
    { "quality", required_argument, NULL, OPT_QUALITY },
    { "local", no_argument, NULL, OPT_LOCAL },
    { "threads", required_argument, NULL, OPT_THREADS },
    { "backend", required_argument, NULL, OPT_BACKEND },
    { "gpu", required_argument, NULL, OPT_GPU },
    { "isa", required_argument, NULL, OPT_ISA },
    { "timeout", required_argument, NULL, OPT_TIMEOUT },
    { "json", no_argument, NULL, OPT_JSON },
    { "no-wait", no_argument, NULL, OPT_NO_WAIT },
    { "delete", no_argument, NULL, OPT_DELETE },
    { "id", required_argument, NULL, OPT_ID },
    { "preset", required_argument, NULL, OPT_PRESET },
    { "azimuth", required_argument, NULL, OPT_AZIMUTH },
    { "elevation", required_argument, NULL, OPT_ELEVATION },
    { "distance", required_argument, NULL, OPT_DISTANCE },
    { "roll", required_argument, NULL, OPT_ROLL },
    { "axis", required_argument, NULL, OPT_AXIS },
    { "index", required_argument, NULL, OPT_INDEX },
    { "origin", required_argument, NULL, OPT_ORIGIN },
    { "normal", required_argument, NULL, OPT_NORMAL },
    { "up", required_argument, NULL, OPT_UP },
    { "spacing", required_argument, NULL, OPT_SPACING },
    { "window", required_argument, NULL, OPT_WINDOW },
    { "step", required_argument, NULL, OPT_STEP },
    { "projection", required_argument, NULL, OPT_PROJECTION },
    { "surface", required_argument, NULL, OPT_SURFACE },
    { "shell", required_argument, NULL, OPT_SHELL },
    { "vectors", required_argument, NULL, OPT_VECTORS },
    { "color-by", required_argument, NULL, OPT_COLOR_BY },
    { "channel", required_argument, NULL, OPT_CHANNEL },
    { "no-volume", no_argument, NULL, OPT_NO_VOLUME },
    { "help", no_argument, NULL, OPT_HELP },
    { "version", no_argument, NULL, OPT_VERSION },
    { NULL, 0, NULL, 0 },
};

int usage_error(const char *what, const char *format, ...) {
    va_list args;
    va_start(args, format);
    fprintf(stderr, "splatctl: %s: ", what);
    vfprintf(stderr, format, args);
    fputs("; see splatctl --help\n", stderr);
    va_end(args);
    return 2;
}

/* Parses a decimal number in [low, high]; *end points behind it. */
static bool parse_number(const char *text, long low, long high, const char **end, long *out) {
    char *stop;
    errno = 0;
    *out = strtol(text, &stop, 10);
    *end = stop;
    return *text >= '0' && *text <= '9' && errno == 0 && *out >= low && *out <= high;
}

static bool parse_whole(const char *name, const char *text, long low, long high, long *out) {
    const char *end;
    if (parse_number(text, low, high, &end, out) && *end == 0)
        return true;
    usage_error(name, "\"%s\" is not a number in [%ld, %ld]", text, low, high);
    return false;
}

/* Accepts WIDTHxHEIGHT, WIDTH,HEIGHT, and one number for a square. */
static bool parse_size(const char *text, uint32_t size[2]) {
    const char *end;
    long width, height;
    bool ok = parse_number(text, 1, SIZE_MAX_PX, &end, &width);
    if (ok && *end == 0)
        height = width;
    else
        ok = ok && (*end == 'x' || *end == ',') &&
             parse_number(end + 1, 1, SIZE_MAX_PX, &end, &height) && *end == 0;
    if (!ok) {
        usage_error("--size", "\"%s\" is not WIDTHxHEIGHT with both in [1, %d]", text, SIZE_MAX_PX);
        return false;
    }
    size[0] = (uint32_t)width;
    size[1] = (uint32_t)height;
    return true;
}

/* The daemon checks the range of a member of the camera. */
static bool parse_camera(const char *name, const char *text, double *out) {
    char *end;
    *out = strtod(text, &end);
    if (end != text && *end == 0 && isfinite(*out))
        return true;
    usage_error(name, "\"%s\" is not a number", text);
    return false;
}

static bool parse_projection(const char *text, const char **out) {
    static const char *const names[] = { "maximum", "minimum", "mean", "sum" };
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (strcmp(text, names[i]) == 0) {
            *out = names[i];
            return true;
        }
    usage_error("--projection", "\"%s\" is not maximum, minimum, mean or sum", text);
    return false;
}

/* The daemon gets the text for a slice, and the numbers for a projection. */
static bool parse_window(struct options *o, const char *text) {
    char *comma, *end;
    o->slice.window = text;
    o->window[0] = strtod(text, &comma);
    o->window[1] = *comma == ',' ? strtod(comma + 1, &end) : NAN;
    if (comma != text && *comma == ',' && end != comma + 1 && *end == 0 && isfinite(o->window[0]) &&
        isfinite(o->window[1]) && o->window[1] > 0)
        return true;
    usage_error("--window", "\"%s\" is not CENTRE,WIDTH with a width above 0, such as 40,400",
                text);
    return false;
}

/* Sets an option that is a text or a flag. False if it is another one. */
static bool apply_plain(struct options *o, enum option_id id, const char *value) {
    const char **const texts[OPT_VERSION + 1] = {
        [OPT_URL] = &o->url,
        [OPT_TOKEN] = &o->token,
        [OPT_VOLUME] = &o->volume,
        [OPT_VIEW] = &o->view,
        [OPT_OUT] = &o->out,
        [OPT_FORMAT] = &o->format,
        [OPT_BACKEND] = &o->backend,
        [OPT_GPU] = &o->gpu,
        [OPT_ISA] = &o->isa,
        [OPT_ID] = &o->id,
        [OPT_PRESET] = &o->preset,
        [OPT_AXIS] = &o->slice.axis,
        [OPT_INDEX] = &o->slice.index,
        [OPT_ORIGIN] = &o->slice.origin,
        [OPT_NORMAL] = &o->slice.normal,
        [OPT_UP] = &o->slice.up,
        [OPT_SPACING] = &o->slice.spacing,
    };
    bool *const flags[OPT_VERSION + 1] = {
        [OPT_NO_VOLUME] = &o->layers.no_volume,
        [OPT_LOCAL] = &o->local,
        [OPT_JSON] = &o->json,
        [OPT_NO_WAIT] = &o->no_wait,
        [OPT_DELETE] = &o->delete,
        [OPT_HELP] = &o->help,
        [OPT_VERSION] = &o->version,
    };
    if (texts[id])
        *texts[id] = value;
    else if (flags[id])
        *flags[id] = true;
    return texts[id] || flags[id];
}

/* Sets an option that is a number. False after a message if the value is wrong. */
static bool apply_number(struct options *o, enum option_id id, const char *value) {
    long number = 0;
    bool ok = true;
    switch (id) {
    case OPT_SIZE:
        return parse_size(value, o->size);
    case OPT_QUALITY:
        ok = parse_whole("--quality", value, 1, 100, &number);
        o->quality = (int)number;
        return ok;
    case OPT_THREADS:
        ok = parse_whole("--threads", value, 1, 256, &number);
        o->threads = (unsigned)number;
        return ok;
    case OPT_TIMEOUT:
        ok = parse_whole("--timeout", value, 1, 86400, &number);
        o->timeout_s = (unsigned)number;
        return ok;
    case OPT_AZIMUTH:
        return parse_camera("--azimuth", value, &o->camera[CAMERA_AZIMUTH]);
    case OPT_ELEVATION:
        return parse_camera("--elevation", value, &o->camera[CAMERA_ELEVATION]);
    case OPT_DISTANCE:
        return parse_camera("--distance", value, &o->camera[CAMERA_DISTANCE]);
    case OPT_ROLL:
        return parse_camera("--roll", value, &o->camera[CAMERA_ROLL]);
    case OPT_PROJECTION:
        return parse_projection(value, &o->projection);
    case OPT_STEP:
        ok = parse_whole("--step", value, 0, SP_STEPS_MAX - 1, &number);
        o->step = (unsigned)number;
        o->has_step = ok;
        return ok;
    case OPT_WINDOW:
        return parse_window(o, value);
    case OPT_SURFACE:
        return layers_parse_surface(&o->layers, value);
    case OPT_SHELL:
        return layers_parse_shell(&o->layers, value);
    case OPT_COLOR_BY:
        o->layers.color_by = value;
        return true;
    case OPT_CHANNEL:
        return channels_parse(&o->layers, value);
    case OPT_VECTORS:
        return layers_parse_vectors(&o->layers, value);
    default:
        return false;
    }
}

static bool apply_option(struct options *o, int id, const char *value) {
    return apply_plain(o, (enum option_id)id, value) || apply_number(o, (enum option_id)id, value);
}

bool options_parse(struct options *options, int argc, char **argv) {
    *options = (struct options){ .timeout_s = 300,
                                 .camera = { NAN, NAN, NAN, NAN },
                                 .window = { NAN, NAN },
                                 .layers = { .low = NAN, .high = NAN } };
    opterr = 0;
    for (int id; (id = getopt_long(argc, argv, ":", known, NULL)) != -1;) {
        const char *given = argv[optind - 1];
        if (id == ':') {
            usage_error(given, "needs a value");
            return false;
        }
        if (id == '?') {
            usage_error(given, "is not an option; a file of this name is given as ./NAME");
            return false;
        }
        if (!apply_option(options, id, optarg))
            return false;
    }
    if (optind < argc)
        options->command = argv[optind++];
    options->arguments = argv + optind;
    options->argument_count = argc - optind;
    bool takes_many = options->command && (strcmp(options->command, "upload") == 0 ||
                                           strcmp(options->command, "convert") == 0);
    if (optind < argc)
        options->argument = argv[optind++];
    if (optind < argc && !takes_many) {
        usage_error(argv[optind], "is one argument too many");
        return false;
    }
    return true;
}
