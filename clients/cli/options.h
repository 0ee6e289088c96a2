/* SPDX-License-Identifier: Apache-2.0
 *
 * splatctl controls the daemon from a shell. main.c dispatches; commands.c, collections.c, path.c,
 * measures.c, render.c, slice.c and upload.c are the commands; patch.c, layers.c and channels.c
 * make their view; http.c talks to the daemon; local.c renders without a daemon; output.c writes
 * files completely or not at all; print.c prints tables and JSON; help.c prints the help. Errors
 * are struct sp_error up to main(), which prints `splatctl: place: text`.
 */
#ifndef CLI_OPTIONS_H
#define CLI_OPTIONS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Members of the view's camera that have an option. */
enum camera_option {
    CAMERA_AZIMUTH,
    CAMERA_ELEVATION,
    CAMERA_DISTANCE,
    CAMERA_ROLL,
    CAMERA_OPTIONS
};

/* Options of the command slice, passed to the daemon unchanged; NULL = not given. */
struct slice_options {
    const char *axis, *index, *origin, *normal, *up, *spacing, *window;
};

enum { LAYERS_MAX = 8 }; /* of a view */
#define STEP_OF_VIEW UINT32_MAX

struct surface_option {
    double value;
    double color[3]; /* [0, 1]; NAN = the default */
    double opacity;  /* [0, 1]; NAN = the default */
};

struct channel_option {
    const char *source; /* an id or a source, not terminated */
    size_t source_bytes;
    double color[3];  /* [0, 1]; NAN = the next colour of a list */
    double low, high; /* ends of the opacity ramp, data unit; NAN = the default */
    double opacity;   /* [0, 1), at `high` */
};

enum { CHANNELS_MAX = LAYERS_MAX - 1 }; /* beside the volume */

/* Layers that are added to the layers of the view. */
struct layer_options {
    struct surface_option surfaces[LAYERS_MAX];
    int surface_count;
    struct channel_option channels[CHANNELS_MAX];
    int channel_count;
    double low, high;        /* of a shell, [0, 1]; NAN = no shell */
    bool is_fast;            /* detail of the shell */
    const char *style;       /* of vectors; NULL = no vectors */
    double stretch, density; /* of vectors; NAN = the default */
    bool no_volume;
    const char *color_by; /* of vectors and points: "magnitude", an id or a source; NULL = values */
};

struct options {
    const char *url, *token; /* NULL = from the environment, else the default */
    const char *command;     /* NULL = none */
    const char *argument;    /* of the command: a path, id or name; NULL = none */
    char **arguments;        /* of upload and convert: all; the first is `argument` */
    int argument_count;
    const char *id; /* of a camera path on the daemon, or of the volume to upload */
    const char *volume, *view, *out, *format, *backend, *gpu, *isa;
    const char *preset;            /* under the view; NULL = none */
    double camera[CAMERA_OPTIONS]; /* NAN = not given */
    unsigned step;                 /* of a time series; STEP_OF_VIEW = not given */
    struct slice_options slice;
    struct layer_options layers;
    const char *projection; /* one of the names of compositing.mode; NULL = not given */
    double window[2];       /* of the projection: centre, width; NAN = not given */
    uint32_t size[2];       /* {0, 0} = the size of the view */
    unsigned quality;       /* 0 = the default */
    unsigned threads;       /* 0 = one per core */
    unsigned timeout_s;
    bool local, json, no_wait, delete, help, version;
};

/* Parses the command line. False after a message on standard error if it is wrong (exit status 2).
 * Strings point into argv. */
bool options_parse(struct options *options, int argc, char **argv);

/* The values of --surface, --shell and --vectors (layers.c), and --channel (channels.c). False
 * after a message. */
bool layers_parse_surface(struct options *options, const char *text);
bool layers_parse_shell(struct options *options, const char *text);
bool layers_parse_vectors(struct options *options, const char *text);
bool channels_parse(struct options *options, const char *text);

/* Print `splatctl: what: why; see splatctl --help` to standard error. The first returns 2, the exit
 * status; the second false. */
__attribute__((format(printf, 2, 3))) int usage_error(const char *what, const char *format, ...);
__attribute__((format(printf, 2, 3))) bool refuse_option(const char *what, const char *format, ...);

#endif
