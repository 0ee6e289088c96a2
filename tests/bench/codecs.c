/* SPDX-License-Identifier: Apache-2.0
 *
 * Measures bytes and time per frame of every codec of the stream. The camera orbits a volume by a
 * typical step of a mouse drag per frame. Prints CSV:
 *
 *   splat-codecs [--size PX] [--frames N] [--degrees N] VOLUME...
 *
 * key_bytes is the size of the first frame; the other columns are means over the later frames
 * (image codecs treat all frames alike). cpu_ms sums all threads. The quality is 60, as
 * for a changing view, and 90, as for a view at rest, with each chroma subsampling. Video is
 * measured only at 60, because only changing views use it. EXR encodes float frames.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bench/scene.h"
#include "sp/encode.h"
#include "sp/renderer.h"
#include "sp/video.h"

enum { FRAMES_MAX = 256, POOL_BYTES = 256 << 20, EXIT_USAGE = 2 };

struct run {
    unsigned size, count;
    double degrees;
    const char *scene;
    struct sp_frame *frames[FRAMES_MAX];
};

struct total {
    size_t key_bytes, bytes;
    double ms, cpu_ms;
};

static double read_ms(clockid_t clock) {
    struct timespec t;
    clock_gettime(clock, &t);
    return (double)t.tv_sec * 1e3 + (double)t.tv_nsec / 1e6;
}

static void turn(struct sp_camera *camera, const struct sp_camera *from, double degrees) {
    double c = cos(degrees * acos(-1) / 180), s = sin(degrees * acos(-1) / 180);
    double x = from->position[0] - from->target[0], z = from->position[2] - from->target[2];
    *camera = *from;
    camera->position[0] = from->target[0] + c * x + s * z;
    camera->position[2] = from->target[2] - s * x + c * z;
}

static bool draw(struct run *run, const char *source, enum sp_pixel_format format,
                 struct sp_error *err) {
    const struct bench_overrides overrides = { .size = run->size };
    struct sp_renderer_options options = { .backend = "cpu" };
    struct bench_scene scene;
    if (!bench_scene_open_volume(&scene, source, NULL, &overrides, err))
        return false;
    if (scene.skipped[0]) {
        bench_scene_close(&scene);
        return sp_fail(err, SP_ERR_NOT_FOUND, source, "there is no such volume");
    }
    struct sp_frame_pool *pool = sp_frame_pool_create(POOL_BYTES, err);
    struct sp_renderer *renderer = pool ? sp_renderer_create(&options, err) : NULL;
    struct sp_render_options render = { .format = format };
    const struct sp_camera from = scene.view.camera;
    bool ok = renderer != NULL;
    for (unsigned i = 0; ok && i < run->count; i++) {
        struct sp_view view = scene.view;
        turn(&view.camera, &from, i * run->degrees);
        run->frames[i] = sp_renderer_render(renderer, scene.volume, &view, pool, &render, err);
        ok = run->frames[i] != NULL;
    }
    sp_renderer_destroy(&renderer);
    sp_frame_pool_destroy(&pool);
    bench_scene_close(&scene);
    return ok;
}

struct moment {
    double ms, cpu_ms;
};

static struct moment now(void) {
    return (struct moment){ read_ms(CLOCK_MONOTONIC), read_ms(CLOCK_PROCESS_CPUTIME_ID) };
}

static void add(struct total *total, unsigned i, size_t bytes, const struct moment *since) {
    struct moment end = now();
    if (i == 0)
        total->key_bytes = bytes;
    total->bytes += i ? bytes : 0;
    total->ms += i ? end.ms - since->ms : 0;
    total->cpu_ms += i ? end.cpu_ms - since->cpu_ms : 0;
}

static void print(const struct run *run, const char *codec, int quality, const struct total *t) {
    unsigned n = run->count - 1;
    printf("%s,%u,%s,%d,%zu,%zu,%.2f,%.2f\n", run->scene, run->size, codec, quality, t->key_bytes,
           t->bytes / n, t->ms / n, t->cpu_ms / n);
    fflush(stdout);
}

static bool run_still(const struct run *run, enum sp_image_format format, int quality,
                      enum sp_chroma chroma, struct sp_error *err) {
    struct sp_encoder *encoder = sp_encoder_create(err);
    char name[32];
    struct total total = { 0 };
    const uint8_t *bytes;
    size_t size;
    bool ok = encoder != NULL;
    if (ok)
        sp_encoder_set_chroma(encoder, chroma);
    for (unsigned i = 0; ok && i < run->count; i++) {
        struct moment start = now();
        ok = sp_encode(encoder, run->frames[i], format, quality, &bytes, &size, err);
        if (ok)
            add(&total, i, size, &start);
    }
    sp_encoder_destroy(&encoder);
    snprintf(name, sizeof name, "%s%s%s", sp_image_format_info(format)->name,
             format == SP_IMAGE_JPEG ? " " : "",
             format == SP_IMAGE_JPEG ? sp_chroma_name(chroma) : "");
    if (ok)
        print(run, name, quality, &total);
    return ok;
}

static bool run_video(const struct run *run, enum sp_video_codec codec, struct sp_error *err) {
    enum { QUALITY = 60, THREADS = 2 };
    struct sp_video *video = sp_video_create(codec, THREADS, err);
    struct sp_video_packet packet;
    struct total total = { 0 };
    bool ok = video != NULL;
    for (unsigned i = 0; ok && i < run->count; i++) {
        struct moment start = now();
        ok = sp_video_encode(video, run->frames[i], QUALITY, false, &packet, err);
        if (ok)
            add(&total, i, packet.size, &start);
    }
    sp_video_destroy(&video);
    if (ok)
        print(run, sp_video_codec_name(codec), QUALITY, &total);
    return ok;
}

static void drop(struct run *run) {
    for (unsigned i = 0; i < run->count; i++)
        sp_frame_unref(&run->frames[i]);
}

static bool run_volume(struct run *run, const char *source, struct sp_error *err) {
    const char *slash = strrchr(source, '/');
    run->scene = slash ? slash + 1 : source;
    bool ok = draw(run, source, SP_RGBA8, err);
    for (int c = SP_CHROMA_444; ok && c < SP_CHROMA_COUNT; c++)
        ok = run_still(run, SP_IMAGE_JPEG, 60, (enum sp_chroma)c, err) &&
             run_still(run, SP_IMAGE_JPEG, 90, (enum sp_chroma)c, err);
    ok = ok && run_still(run, SP_IMAGE_WEBP, 60, SP_CHROMA_AUTO, err) &&
         run_still(run, SP_IMAGE_PNG, 100, SP_CHROMA_AUTO, err);
    for (int codec = 0; ok && codec < SP_VIDEO_CODEC_COUNT; codec++)
        if (sp_video_is_available((enum sp_video_codec)codec))
            ok = run_video(run, (enum sp_video_codec)codec, err);
    drop(run);
    ok = ok && draw(run, source, SP_RGBAF32, err) &&
         run_still(run, SP_IMAGE_EXR, 100, SP_CHROMA_AUTO, err);
    drop(run);
    return ok;
}

static int usage(void) {
    fprintf(stderr, "usage: splat-codecs [--size PX] [--frames N] [--degrees N] VOLUME...\n");
    return EXIT_USAGE;
}

int main(int argc, char **argv) {
    static struct run run = { .size = 1024, .count = 31, .degrees = 2 };
    struct sp_error err = { .code = SP_OK };
    int at = 1;
    for (; at + 1 < argc && strncmp(argv[at], "--", 2) == 0; at += 2) {
        double value = atof(argv[at + 1]);
        if (strcmp(argv[at], "--size") == 0 && value >= 1 && value <= 8192)
            run.size = (unsigned)value;
        else if (strcmp(argv[at], "--frames") == 0 && value >= 2 && value <= FRAMES_MAX)
            run.count = (unsigned)value;
        else if (strcmp(argv[at], "--degrees") == 0 && fabs(value) <= 360)
            run.degrees = value;
        else
            return usage();
    }
    if (at >= argc || argv[at][0] == '-')
        return usage();
    printf("scene,size,codec,quality,key_bytes,bytes,ms,cpu_ms\n");
    for (; at < argc; at++)
        if (!run_volume(&run, argv[at], &err)) {
            fprintf(stderr, "splat-codecs: %s%s%s\n", err.place, err.place[0] ? ": " : "",
                    err.text);
            return EXIT_FAILURE;
        }
    return EXIT_SUCCESS;
}
