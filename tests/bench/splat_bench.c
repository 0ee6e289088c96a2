/* SPDX-License-Identifier: Apache-2.0
 *
 * splat-bench: draws the cameras of scenes, prints one JSON line a scene. The keys are those of the
 * project's performance page; times are wall milliseconds a frame unless they say cpu.
 */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "bench/scene.h"
#include "protocol/json.h"
#include "sp/encode.h"
#include "sp/renderer.h"

enum { EXIT_USAGE = 2, POOL_BYTES = 256 << 20, LONG_ONLY = 256, STEPS = 24 };

enum edit { EDIT_NONE, EDIT_COLOUR, EDIT_OPACITY, EDIT_RANGE, EDITS };
static const char *const edit_names[EDITS] = { "none", "colour", "opacity", "range" };

struct options {
    struct sp_renderer_options renderer;
    struct bench_overrides overrides;
    struct sp_render_options render;
    unsigned warm;
    enum edit edit; /* what is done to the transfer function before each frame */
    const char *data, *out, *volume;
};

/* Sums over the views of one scene. */
struct result {
    double *ms; /* a view */
    unsigned views;
    double cpu_ms, splats, fragments;
    double stage_ms[SP_STAGES_MAX];
    double cold_classify_ms; /* of the very first frame */
    struct sp_frame_stats last;
};

static const char usage[] =
    "usage: splat-bench [OPTION]... SCENE.json...\n"
    "       splat-bench [OPTION]... --volume demo:NAME|FILE\n"
    "Draws every camera of each scene and prints one JSON line a scene.\n"
    "\n"
    "  --backend NAME      auto (default), cpu, null, ...\n"
    "  --isa NAME          instruction set of the cpu backend: auto (default), scalar, sse41,\n"
    "                      avx2, avx512, neon\n"
    "  --threads N         render threads, 1 to 256; default one a core\n"
    "  --size N            pixels both ways, 1 to 8192; default as the scene says\n"
    "  --views N           at most N cameras, or an orbit of N; default 24\n"
    "  --warm N            frames drawn before measuring; default 2\n"
    "  --mode M            filter: adaptive, ewa, reconstruction, lowpass, ...\n"
    "  --compositing C     sheet, ...\n"
    "  --shading S         none, phong\n"
    "  --coarse N          2^N x 2^N x 2^N voxels averaged into one, 0 (default) to 2\n"
    "  --edit E            none, colour, opacity, range: changes that of the transfer function\n"
    "                      a little before each frame; default none\n"
    "  --data DIR          folder below which the scenes' volumes are found\n"
    "  --volume V          a volume instead of scenes: its default view, in an orbit\n"
    "  --out PREFIX        writes the third view of each scene as PREFIXname.png\n"
    "  --help, --version\n"
    "Exit status: 0 success (a scene without its volume counts as skipped), 1 failure, 2 usage.\n";

static int fail(const struct sp_error *err) {
    fprintf(stderr, "splat-bench: %s: %s\n", err->place[0] ? err->place : sp_code_name(err->code),
            err->text);
    return EXIT_FAILURE;
}

/* A whole number in [low, high]; false after saying what is wrong. */
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

static bool parse_edit(const char *text, enum edit *edit) {
    for (int e = 0; e < EDITS; e++)
        if (strcmp(text, edit_names[e]) == 0) {
            *edit = (enum edit)e;
            return true;
        }
    fprintf(stderr, "splat-bench: --edit: \"%s\" is not none, colour, opacity or range\n", text);
    return false;
}

static bool parse_option(struct options *o, const char *name, const char *value) {
    if (strcmp(name, "threads") == 0)
        return parse_number(name, value, 1, 256, &o->renderer.threads);
    if (strcmp(name, "size") == 0)
        return parse_number(name, value, 1, SP_SIZE_MAX, &o->overrides.size);
    if (strcmp(name, "views") == 0)
        return parse_number(name, value, 1, BENCH_CAMERAS_MAX, &o->overrides.views);
    if (strcmp(name, "coarse") == 0)
        return parse_number(name, value, 0, SP_COARSE_MAX, &o->render.coarse);
    if (strcmp(name, "warm") == 0)
        return parse_number(name, value, 0, 1000, &o->warm);
    if (strcmp(name, "edit") == 0)
        return parse_edit(value, &o->edit);
    const struct {
        const char *name;
        const char **to;
    } texts[] = { { "backend", &o->renderer.backend },
                  { "isa", &o->renderer.isa },
                  { "mode", &o->overrides.mode },
                  { "compositing", &o->overrides.compositing },
                  { "shading", &o->overrides.shading },
                  { "data", &o->data },
                  { "volume", &o->volume },
                  { "out", &o->out } };
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++)
        if (strcmp(name, texts[i].name) == 0)
            *texts[i].to = value;
    return true;
}

/* The k-th of a row of small edits, each different from the one before. */
static void edit_transfer(struct sp_transfer_function *tf, enum edit edit, const double range[2],
                          unsigned k) {
    unsigned step = k % STEPS + 1; /* then back to the first */
    struct sp_tf_point *p = &tf->points[tf->point_count / 2];
    if (edit == EDIT_COLOUR)
        p->color[1] = 0.5f * (p->color[1] + (float)step / STEPS);
    if (edit == EDIT_OPACITY)
        p->opacity *= 1 - 0.5f * (float)step / STEPS;
    if (edit != EDIT_RANGE)
        return;
    for (uint32_t i = 0; i + 1 < tf->point_count; i++)
        if (!(tf->points[i].opacity > 0) && tf->points[i + 1].opacity > 0) {
            double room = tf->points[i + 1].value - tf->points[i].value;
            tf->points[i].value += step * fmin((range[1] - range[0]) / 256, 0.9 * room / STEPS);
            return;
        }
}

/* Draws camera k, frame n of all; the frame is the caller's. */
static struct sp_frame *draw(struct sp_renderer *renderer, struct sp_frame_pool *pool,
                             const struct bench_scene *scene, const struct options *o, unsigned k,
                             unsigned n, struct sp_error *err) {
    struct sp_view view = scene->view;
    view.camera = scene->cameras[k % scene->camera_count];
    edit_transfer(&view.transfer_function, o->edit, sp_volume_info(scene->volume)->range, n);
    return sp_renderer_render(renderer, scene->volume, &view, pool, &o->render, err);
}

static bool measure(struct result *r, struct sp_renderer *renderer, struct sp_frame_pool *pool,
                    const struct bench_scene *scene, const struct options *o,
                    struct sp_error *err) {
    for (unsigned k = 0; k < o->warm + scene->camera_count; k++) {
        unsigned camera = k < o->warm ? k : k - o->warm;
        struct sp_frame *frame = draw(renderer, pool, scene, o, camera, k, err);
        if (!frame)
            return false;
        const struct sp_frame_stats *stats = &frame->stats;
        if (k == 0 && stats->stage_count > 0)
            r->cold_classify_ms = stats->stages[0].ms;
        if (k >= o->warm) {
            r->ms[r->views++] = stats->render_ms;
            r->cpu_ms += stats->cpu_ms;
            r->splats += (double)stats->splats;
            r->fragments += (double)stats->fragments;
            for (uint32_t i = 0; i < stats->stage_count; i++)
                r->stage_ms[i] += stats->stages[i].ms;
            r->last = *stats;
        }
        sp_frame_unref(&frame);
    }
    return true;
}

static bool write_png(const struct options *o, const struct bench_scene *scene,
                      struct sp_renderer *renderer, struct sp_frame_pool *pool,
                      struct sp_error *err) {
    struct sp_encoder *encoder = sp_encoder_create(err);
    struct sp_frame *frame = encoder ? draw(renderer, pool, scene, o, 2, 2, err) : NULL;
    const uint8_t *bytes;
    size_t size;
    char *path = NULL;
    bool ok = frame && sp_encode(encoder, frame, SP_IMAGE_PNG, 100, &bytes, &size, err);
    if (ok && asprintf(&path, "%s%s.png", o->out, scene->name) > 0) {
        for (char *c = path + strlen(o->out); *c; c++)
            if (*c == '/' || *c == ':' || *c == '?')
                *c = '-';
        FILE *file = fopen(path, "wb");
        ok = file && fwrite(bytes, 1, size, file) == size;
        if (file && fclose(file) != 0)
            ok = false;
        if (!ok)
            sp_fail(err, SP_ERR_IO, path, "cannot be written");
    }
    free(path);
    sp_frame_unref(&frame);
    sp_encoder_destroy(&encoder);
    return ok;
}

static int compare(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double round2(double x) {
    return round(x * 100) / 100;
}

static double mean_of(const double *ms, unsigned n) {
    double sum = 0;
    for (unsigned i = 0; i < n; i++)
        sum += ms[i];
    return sum / n;
}

/* One line on standard output. */
static bool print_json(proto_json *json, struct sp_error *err) {
    char *text = proto_json_to_text(json, NULL);
    proto_json_free(&json);
    if (!text)
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory for the result");
    printf("%s\n", text);
    fflush(stdout);
    free(text);
    return true;
}

static proto_json *encode_stages(const struct result *r) {
    proto_json *stages = proto_json_object();
    for (uint32_t i = 0; i < r->last.stage_count; i++)
        proto_json_set_number(stages, r->last.stages[i].name, round2(r->stage_ms[i] / r->views));
    return stages;
}

static proto_json *encode_result(const struct bench_scene *scene, const struct result *r,
                                 uint64_t bytes) {
    static const char *const modes[] = { "adaptive", "ewa",  "reconstruction",
                                         "lowpass",  "swan", "none" };
    static const char *const compositings[] = { "splat", "sheet", "slab" };
    const struct sp_view *view = &scene->view;
    const struct sp_frame_stats *stats = &r->last;
    double mean = mean_of(r->ms, r->views);
    qsort(r->ms, r->views, sizeof *r->ms, compare);
    double median = (r->ms[(r->views - 1) / 2] + r->ms[r->views / 2]) / 2;
    double p95 = r->ms[(unsigned)ceil(0.95 * r->views) - 1];
    struct rusage usage_of_process;
    getrusage(RUSAGE_SELF, &usage_of_process);
    proto_json *j = proto_json_object();
    proto_json_set_string(j, "scene", scene->name);
    proto_json_set_string(j, "backend", stats->backend);
    proto_json_set_string(j, "device", stats->device);
    proto_json_set_string(j, "isa", stats->isa);
    proto_json_set_integer(j, "threads", stats->threads);
    proto_json_set_integer(j, "size", view->size[0]);
    proto_json_set_string(j, "mode", modes[view->filter.mode]);
    proto_json_set_string(j, "compositing", compositings[view->compositing.mode]);
    proto_json_set_string(j, "shading", view->shading.mode == SP_SHADING_PHONG ? "phong" : "none");
    proto_json_set_integer(j, "coarse", stats->coarse);
    proto_json_set_integer(j, "views", r->views);
    proto_json_set_number(j, "splats", round(r->splats / r->views));
    proto_json_set_integer(j, "visible_voxels", (int64_t)stats->visible_voxels);
    proto_json_set_number(j, "fragments", round(r->fragments / r->views));
    proto_json_set_number(j, "median_ms", round2(median));
    proto_json_set_number(j, "p95_ms", round2(p95));
    proto_json_set_number(j, "mean_ms", round2(mean));
    proto_json_set_number(j, "cpu_ms", round2(r->cpu_ms / r->views));
    proto_json_set_number(j, "fps", round2(median > 0 ? 1000 / median : 0));
    proto_json_set(j, "stages", encode_stages(r));
    proto_json_set_number(j, "cold_classify_ms", round2(r->cold_classify_ms));
    proto_json_set_integer(j, "bytes", (int64_t)bytes);
    proto_json_set_integer(j, "peak_rss", (int64_t)usage_of_process.ru_maxrss * 1024);
    return j;
}

static bool run_scene(const struct bench_scene *scene, const struct options *o,
                      struct sp_renderer *renderer, struct sp_frame_pool *pool,
                      struct sp_error *err) {
    if (scene->skipped[0]) {
        proto_json *json = proto_json_object();
        proto_json_set_string(json, "scene", scene->name);
        proto_json_set_string(json, "skipped", scene->skipped);
        return print_json(json, err);
    }
    struct result r = { .ms = calloc(scene->camera_count, sizeof(double)) };
    bool ok = r.ms ? measure(&r, renderer, pool, scene, o, err)
                   : sp_fail(err, SP_ERR_MEMORY, "", "no memory for the result");
    if (ok) {
        uint64_t bytes = sp_volume_info(scene->volume)->voxel_bytes +
                         sp_renderer_memory(renderer, scene->volume);
        ok = print_json(encode_result(scene, &r, bytes), err);
        if (scene->visible_voxels >= 0 && !o->edit && r.last.coarse == 0 && r.last.backend &&
            strcmp(r.last.backend, "null") != 0 &&
            r.last.visible_voxels != (uint64_t)scene->visible_voxels)
            fprintf(stderr, "splat-bench: %s: %llu voxels are visible, the scene says %lld\n",
                    scene->name, (unsigned long long)r.last.visible_voxels,
                    (long long)scene->visible_voxels);
    }
    free(r.ms);
    if (ok && o->out)
        ok = write_png(o, scene, renderer, pool, err);
    sp_renderer_forget(renderer, scene->volume);
    return ok;
}

static int run(const struct options *o, char **files, int count) {
    struct sp_error err;
    struct sp_renderer *renderer = sp_renderer_create(&o->renderer, &err);
    struct sp_frame_pool *pool = renderer ? sp_frame_pool_create(POOL_BYTES, &err) : NULL;
    int status = pool ? EXIT_SUCCESS : fail(&err);
    for (int i = 0; pool && i < (o->volume ? 1 : count); i++) {
        struct bench_scene scene;
        bool ok = o->volume
                      ? bench_scene_open_volume(&scene, o->volume, o->data, &o->overrides, &err)
                      : bench_scene_open(&scene, files[i], o->data, &o->overrides, &err);
        if (ok) {
            ok = run_scene(&scene, o, renderer, pool, &err);
            bench_scene_close(&scene);
        }
        if (!ok) {
            const char *source = o->volume ? o->volume : files[i];
            bool known = !err.place[0] || strcmp(err.place, source) == 0;
            fprintf(stderr, "splat-bench: %s%s%s: %s\n", source, known ? "" : ": ",
                    known ? "" : err.place, err.text);
            status = EXIT_FAILURE;
        }
    }
    sp_frame_pool_destroy(&pool);
    sp_renderer_destroy(&renderer);
    return status;
}

int main(int argc, char **argv) {
    static const struct option flags[] = {
        { "backend", required_argument, NULL, LONG_ONLY },
        { "isa", required_argument, NULL, LONG_ONLY },
        { "threads", required_argument, NULL, LONG_ONLY },
        { "size", required_argument, NULL, LONG_ONLY },
        { "views", required_argument, NULL, LONG_ONLY },
        { "warm", required_argument, NULL, LONG_ONLY },
        { "mode", required_argument, NULL, LONG_ONLY },
        { "compositing", required_argument, NULL, LONG_ONLY },
        { "shading", required_argument, NULL, LONG_ONLY },
        { "coarse", required_argument, NULL, LONG_ONLY },
        { "edit", required_argument, NULL, LONG_ONLY },
        { "data", required_argument, NULL, LONG_ONLY },
        { "volume", required_argument, NULL, LONG_ONLY },
        { "out", required_argument, NULL, LONG_ONLY },
        { "help", no_argument, NULL, 'h' },
        { "version", no_argument, NULL, 'v' },
        { NULL, 0, NULL, 0 },
    };
    struct options o = { .warm = 2 };
    int which = 0, c;
    while ((c = getopt_long(argc, argv, "", flags, &which)) != -1) {
        if (c == 'h') {
            fputs(usage, stdout);
            return EXIT_SUCCESS;
        }
        if (c == 'v') {
            puts("splat-bench " SPLATD_VERSION);
            return EXIT_SUCCESS;
        }
        if (c != LONG_ONLY || !parse_option(&o, flags[which].name, optarg))
            return EXIT_USAGE;
    }
    if (o.volume ? optind < argc : optind >= argc) {
        fputs("splat-bench: name scene files, or one volume with --volume; --help explains\n",
              stderr);
        return EXIT_USAGE;
    }
    return run(&o, argv + optind, argc - optind);
}
