/* SPDX-License-Identifier: Apache-2.0 */
#include "cli/options.h"
#include "sp/volume.h"

#include <errno.h>
#include <getopt.h>
#include <math.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SIZE_MAX_PX = 8192 };

static void print_usage_error(const char *what, const char *format, va_list args) {
    fprintf(stderr, "splatctl: %s: ", what);
    vfprintf(stderr, format, args);
    fputs("; see splatctl --help\n", stderr);
}

int usage_error(const char *what, const char *format, ...) {
    va_list args;
    va_start(args, format);
    print_usage_error(what, format, args);
    va_end(args);
    return 2;
}

bool refuse_option(const char *what, const char *format, ...) {
    va_list args;
    va_start(args, format);
    print_usage_error(what, format, args);
    va_end(args);
    return false;
}

/* Parses a decimal number in [low, high]; *end points behind it. */
static bool parse_number(const char *text, long low, long high, const char **end, unsigned *out) {
    char *stop;
    errno = 0;
    long number = strtol(text, &stop, 10);
    *end = stop;
    *out = (unsigned)number;
    return *text >= '0' && *text <= '9' && errno == 0 && number >= low && number <= high;
}

/* Accepts WIDTHxHEIGHT, WIDTH,HEIGHT, and one number for a square. */
static bool parse_size(struct options *o, const char *text) {
    const char *end;
    bool ok = parse_number(text, 1, SIZE_MAX_PX, &end, &o->size[0]);
    if (ok && *end == 0)
        o->size[1] = o->size[0];
    else
        ok = ok && (*end == 'x' || *end == ',') &&
             parse_number(end + 1, 1, SIZE_MAX_PX, &end, &o->size[1]) && *end == 0;
    return ok || refuse_option("--size", "\"%s\" is not WIDTHxHEIGHT with both in [1, %d]", text,
                               SIZE_MAX_PX);
}

static bool parse_projection(struct options *o, const char *text) {
    static const char *const names[] = { "maximum", "minimum", "mean", "sum" };
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (strcmp(text, names[i]) == 0)
            o->projection = names[i];
    return (o->projection && strcmp(text, o->projection) == 0) ||
           refuse_option("--projection", "\"%s\" is not maximum, minimum, mean or sum", text);
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
    return refuse_option("--window",
                         "\"%s\" is not CENTRE,WIDTH with a width above 0, such as 40,400", text);
}

enum kind {
    TEXT,   /* const char * */
    FLAG,   /* bool; no value */
    WHOLE,  /* unsigned in [low, high] */
    NUMBER, /* double; the daemon checks its range */
    OTHER   /* parse() */
};

#define AT(field) offsetof(struct options, field)

static const struct setting {
    const char *name;
    enum kind kind;
    size_t offset; /* in struct options */
    long low, high;
    bool (*parse)(struct options *o, const char *text); /* false after a message */
} settings[] = {
    { "url", TEXT, AT(url), 0, 0, NULL },
    { "token", TEXT, AT(token), 0, 0, NULL },
    { "volume", TEXT, AT(volume), 0, 0, NULL },
    { "view", TEXT, AT(view), 0, 0, NULL },
    { "out", TEXT, AT(out), 0, 0, NULL },
    { "size", OTHER, 0, 0, 0, parse_size },
    { "format", TEXT, AT(format), 0, 0, NULL },
    { "quality", WHOLE, AT(quality), 1, 100, NULL },
    { "local", FLAG, AT(local), 0, 0, NULL },
    { "threads", WHOLE, AT(threads), 1, 256, NULL },
    { "backend", TEXT, AT(backend), 0, 0, NULL },
    { "gpu", TEXT, AT(gpu), 0, 0, NULL },
    { "isa", TEXT, AT(isa), 0, 0, NULL },
    { "timeout", WHOLE, AT(timeout_s), 1, 86400, NULL },
    { "json", FLAG, AT(json), 0, 0, NULL },
    { "no-wait", FLAG, AT(no_wait), 0, 0, NULL },
    { "delete", FLAG, AT(delete), 0, 0, NULL },
    { "id", TEXT, AT(id), 0, 0, NULL },
    { "preset", TEXT, AT(preset), 0, 0, NULL },
    { "azimuth", NUMBER, AT(camera[CAMERA_AZIMUTH]), 0, 0, NULL },
    { "elevation", NUMBER, AT(camera[CAMERA_ELEVATION]), 0, 0, NULL },
    { "distance", NUMBER, AT(camera[CAMERA_DISTANCE]), 0, 0, NULL },
    { "roll", NUMBER, AT(camera[CAMERA_ROLL]), 0, 0, NULL },
    { "axis", TEXT, AT(slice.axis), 0, 0, NULL },
    { "index", TEXT, AT(slice.index), 0, 0, NULL },
    { "origin", TEXT, AT(slice.origin), 0, 0, NULL },
    { "normal", TEXT, AT(slice.normal), 0, 0, NULL },
    { "up", TEXT, AT(slice.up), 0, 0, NULL },
    { "spacing", TEXT, AT(slice.spacing), 0, 0, NULL },
    { "window", OTHER, 0, 0, 0, parse_window },
    { "step", WHOLE, AT(step), 0, SP_STEPS_MAX - 1, NULL },
    { "projection", OTHER, 0, 0, 0, parse_projection },
    { "surface", OTHER, 0, 0, 0, layers_parse_surface },
    { "shell", OTHER, 0, 0, 0, layers_parse_shell },
    { "vectors", OTHER, 0, 0, 0, layers_parse_vectors },
    { "color-by", TEXT, AT(layers.color_by), 0, 0, NULL },
    { "channel", OTHER, 0, 0, 0, channels_parse },
    { "no-volume", FLAG, AT(layers.no_volume), 0, 0, NULL },
    { "help", FLAG, AT(help), 0, 0, NULL },
    { "version", FLAG, AT(version), 0, 0, NULL },
};
enum { SETTINGS = sizeof settings / sizeof *settings };

/* False after a message if the value is wrong. */
static bool apply(struct options *o, const struct setting *setting, const char *text) {
    void *value = (char *)o + setting->offset;
    char name[32];
    const char *end;
    snprintf(name, sizeof name, "--%s", setting->name);
    switch (setting->kind) {
    case TEXT:
        *(const char **)value = text;
        return true;
    case FLAG:
        *(bool *)value = true;
        return true;
    case WHOLE:
        return (parse_number(text, setting->low, setting->high, &end, value) && *end == 0) ||
               refuse_option(name, "\"%s\" is not a number in [%ld, %ld]", text, setting->low,
                             setting->high);
    case NUMBER:
        *(double *)value = strtod(text, (char **)&end);
        return (end != text && *end == 0 && isfinite(*(double *)value)) ||
               refuse_option(name, "\"%s\" is not a number", text);
    case OTHER:
        break;
    }
    return setting->parse(o, text);
}

bool options_parse(struct options *options, int argc, char **argv) {
    struct option known[SETTINGS + 1] = { 0 };
    *options = (struct options){ .timeout_s = 300,
                                 .step = STEP_OF_VIEW,
                                 .camera = { NAN, NAN, NAN, NAN },
                                 .window = { NAN, NAN },
                                 .layers = { .low = NAN, .high = NAN } };
    for (size_t i = 0; i < SETTINGS; i++) {
        known[i].name = settings[i].name;
        known[i].has_arg = settings[i].kind == FLAG ? no_argument : required_argument;
    }
    opterr = 0;
    for (int id, i = 0; (id = getopt_long(argc, argv, ":", known, &i)) != -1;) {
        const char *given = argv[optind - 1];
        if (id == ':')
            return refuse_option(given, "needs a value");
        if (id == '?')
            return refuse_option(given, "is not an option; a file of this name is given as ./NAME");
        if (!apply(options, &settings[i], optarg))
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
    return optind == argc || takes_many || refuse_option(argv[optind], "is one argument too many");
}
