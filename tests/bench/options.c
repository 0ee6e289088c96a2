/* SPDX-License-Identifier: Apache-2.0 */
#include "bench/options.h"
#include "sp/inflight.h"

#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { LONG_ONLY = 256, CANCEL_MAX = 10000, WARM_MAX = 1000 };

static const char *const edit_names[EDITS] = { "none", "colour", "opacity", "range" };

static const char usage[] =
    "usage: splat-bench [OPTION]... SCENE.json...\n"
    "       splat-bench [OPTION]... --volume demo:NAME|FILE\n"
    "Renders every camera of each scene and prints one JSON line per scene.\n"
    "\n"
    "  --backend NAME      auto (default), gl, gl-software, cpu, null\n"
    "  --gpu N             GPU to use, numbered as in \"splatd --probe\"; default auto\n"
    "  --isa NAME          highest instruction set of the cpu backend; default auto\n"
    "  --threads N         render threads, 1 to 256; default one per core\n"
    "  --size N            width and height in px, 1 to 8192; default from the scene\n"
    "  --views N           at most N cameras, or an orbit of N; default 24\n"
    "  --warm N            frames rendered before measuring; default 2\n"
    "  --in-flight N       frames in flight at once, 1 (default) to 4, if the backend\n"
    "                      supports it; times are then the total divided by the frames\n"
    "  --mode M            filter: adaptive, ewa, reconstruction, lowpass, ...\n"
    "  --compositing C     sheet, ...\n"
    "  --order O           transfer function per voxel or pixel: pre, post, auto\n"
    "  --shading S         none, phong\n"
    "  --layers L          volume, shell or a JSON list of layers; default from the scene\n"
    "  --lod L             level of detail: auto, off; default from the scene\n"
    "  --coarse N          2^N x 2^N x 2^N voxels averaged into one, 0 (default) to 2\n"
    "  --depth N           1: frames have depth and spread; default 0\n"
    "  --draft N           1: drafts, as of moving views; default 0\n"
    "  --edit E            none, colour, opacity, range: slightly changes that part of the\n"
    "                      transfer function before each frame; default none\n"
    "  --cold              evicts cached data of the volume before each frame\n"
    "  --against KEY=VALUE alternates with the same setting except for that option (mode,\n"
    "                      compositing, order, shading, layers, lod, coarse, depth,\n"
    "                      draft or edit); compares times and images\n"
    "  --cancel N          then starts N frames, cancels each at a random moment, and prints\n"
    "                      how long the call takes to return\n"
    "  --data DIR          folder that contains the volumes of the scenes\n"
    "  --volume V          a volume instead of scenes: an orbit from its default view\n"
    "  --out PREFIX        writes the third image of each scene as PREFIXname.png\n"
    "  --save-volume PREFIX  writes the volume of each scene as PREFIXname.nrrd\n"
    "  --help, --version\n"
    "Exit status: 0 success (a scene without its volume counts as skipped), 1 failure, 2 usage.\n";

/* Parses a whole number in [low, high]; false after printing an error. */
static bool parse_number(const char *flag, const char *text, unsigned low, unsigned high,
                         unsigned *out) {
    char *end;
    unsigned long n = strtoul(text, &end, 10);
    if (*text < '0' || *text > '9' || *end || n < low || n > high) {
        fprintf(stderr, "splat-bench: --%s: \"%s\" is not a number from %u to %u\n", flag, text,
                low, high);
        return false;
    }
    *out = (unsigned)n;
    return true;
}

static bool parse_switch(const char *name, const char *value, bool *out) {
    unsigned number;
    if (!parse_number(name, value, 0, 1, &number))
        return false;
    *out = number;
    return true;
}

static bool parse_edit(const char *text, enum bench_edit *edit) {
    for (int e = 0; e < EDITS; e++)
        if (strcmp(text, edit_names[e]) == 0) {
            *edit = (enum bench_edit)e;
            return true;
        }
    fprintf(stderr, "splat-bench: --edit: \"%s\" is not none, colour, opacity or range\n", text);
    return false;
}

/* Sets an option that --against can change. *known says whether the name is one of these. */
static bool parse_setting(struct bench_setting *s, const char *name, const char *value,
                          bool *known) {
    const struct {
        const char *name;
        const char **to;
    } texts[] = { { "mode", &s->overrides.mode },     { "compositing", &s->overrides.compositing },
                  { "order", &s->overrides.order },   { "shading", &s->overrides.shading },
                  { "layers", &s->overrides.layers }, { "lod", &s->overrides.lod } };
    *known = true;
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++)
        if (strcmp(name, texts[i].name) == 0) {
            *texts[i].to = value;
            return true;
        }
    if (strcmp(name, "coarse") == 0)
        return parse_number(name, value, 0, SP_MIP_LEVEL_MAX, &s->render.mip_level);
    if (strcmp(name, "edit") == 0)
        return parse_edit(value, &s->edit);
    if (strcmp(name, "depth") == 0)
        return parse_switch(name, value, &s->render.wants_depth);
    if (strcmp(name, "draft") == 0)
        return parse_switch(name, value, &s->render.draft);
    *known = false;
    return false;
}

static bool parse_option(struct bench_options *o, const char *name, const char *value) {
    bool known, ok = parse_setting(&o->setting, name, value, &known);
    if (known)
        return ok;
    if (strcmp(name, "cold") == 0) {
        o->cold = true;
        return true;
    }
    if (strcmp(name, "threads") == 0)
        return parse_number(name, value, 1, 256, &o->renderer.threads);
    if (strcmp(name, "size") == 0)
        return parse_number(name, value, 1, SP_SIZE_MAX, &o->setting.overrides.size);
    if (strcmp(name, "views") == 0)
        return parse_number(name, value, 1, BENCH_CAMERAS_MAX, &o->setting.overrides.views);
    if (strcmp(name, "warm") == 0)
        return parse_number(name, value, 0, WARM_MAX, &o->warm);
    if (strcmp(name, "in-flight") == 0)
        return parse_number(name, value, 1, SP_IN_FLIGHT_MAX, &o->in_flight);
    if (strcmp(name, "cancel") == 0)
        return parse_number(name, value, 1, CANCEL_MAX, &o->cancel);
    const struct {
        const char *name;
        const char **to;
    } texts[] = { { "backend", &o->renderer.backend },
                  { "gpu", &o->renderer.gpu },
                  { "isa", &o->renderer.isa },
                  { "against", &o->against_text },
                  { "data", &o->data },
                  { "volume", &o->volume },
                  { "out", &o->out },
                  { "save-volume", &o->save_volume } };
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++)
        if (strcmp(name, texts[i].name) == 0)
            *texts[i].to = value;
    return true;
}

/* Parses the setting to compare with: the other options with one change. */
static bool parse_against(struct bench_options *o) {
    if (!o->against_text)
        return true;
    const char *equals = strchr(o->against_text, '=');
    char name[16] = "";
    bool known = false, ok = false;
    o->against = o->setting;
    if (equals && (size_t)(equals - o->against_text) < sizeof name) {
        memcpy(name, o->against_text, (size_t)(equals - o->against_text));
        ok = parse_setting(&o->against, name, equals + 1, &known);
    }
    if (!known)
        fprintf(stderr,
                "splat-bench: --against: \"%s\" is not KEY=VALUE with one of mode, compositing, "
                "order, shading, layers, lod, coarse, depth, draft, edit\n",
                o->against_text);
    return ok;
}

enum bench_parsed bench_options_parse(struct bench_options *o, int argc, char **argv) {
    static const struct option flags[] = {
        { "backend", required_argument, NULL, LONG_ONLY },
        { "gpu", required_argument, NULL, LONG_ONLY },
        { "isa", required_argument, NULL, LONG_ONLY },
        { "threads", required_argument, NULL, LONG_ONLY },
        { "size", required_argument, NULL, LONG_ONLY },
        { "views", required_argument, NULL, LONG_ONLY },
        { "warm", required_argument, NULL, LONG_ONLY },
        { "in-flight", required_argument, NULL, LONG_ONLY },
        { "mode", required_argument, NULL, LONG_ONLY },
        { "compositing", required_argument, NULL, LONG_ONLY },
        { "order", required_argument, NULL, LONG_ONLY },
        { "shading", required_argument, NULL, LONG_ONLY },
        { "layers", required_argument, NULL, LONG_ONLY },
        { "lod", required_argument, NULL, LONG_ONLY },
        { "coarse", required_argument, NULL, LONG_ONLY },
        { "depth", required_argument, NULL, LONG_ONLY },
        { "draft", required_argument, NULL, LONG_ONLY },
        { "edit", required_argument, NULL, LONG_ONLY },
        { "cold", no_argument, NULL, LONG_ONLY },
        { "against", required_argument, NULL, LONG_ONLY },
        { "cancel", required_argument, NULL, LONG_ONLY },
        { "data", required_argument, NULL, LONG_ONLY },
        { "volume", required_argument, NULL, LONG_ONLY },
        { "out", required_argument, NULL, LONG_ONLY },
        { "save-volume", required_argument, NULL, LONG_ONLY },
        { "help", no_argument, NULL, 'h' },
        { "version", no_argument, NULL, 'v' },
        { NULL, 0, NULL, 0 },
    };
    *o = (struct bench_options){ .warm = 2, .in_flight = 1 };
    int which = 0, c;
    while ((c = getopt_long(argc, argv, "", flags, &which)) != -1) {
        if (c == 'h') {
            fputs(usage, stdout);
            return BENCH_DONE;
        }
        if (c == 'v') {
            puts("splat-bench " SPLATD_VERSION);
            return BENCH_DONE;
        }
        if (c != LONG_ONLY || !parse_option(o, flags[which].name, optarg))
            return BENCH_WRONG;
    }
    if (!parse_against(o))
        return BENCH_WRONG;
    o->first_file = optind;
    if (o->volume ? optind < argc : optind >= argc) {
        fputs("splat-bench: name scene files, or one volume with --volume; --help explains\n",
              stderr);
        return BENCH_WRONG;
    }
    return BENCH_RUN;
}
