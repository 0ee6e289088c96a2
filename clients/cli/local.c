/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "cli/commands.h"
#include "cli/print.h"
#include "protocol/view.h"
#include "sp/encode.h"
#include "sp/renderer.h"

enum { QUALITY_DEFAULT = 90 };

static bool show_progress(void *user, double fraction) {
    if (isatty(STDERR_FILENO))
        fprintf(stderr, "\rloading %s %3.0f %%%s", (const char *)user, fraction * 100,
                fraction >= 1 ? "\n" : "");
    return true;
}

static struct sp_renderer *create_renderer(const struct options *options, struct sp_error *err) {
    const struct sp_renderer_options how = { .backend = options->backend,
                                             .gpu = options->gpu,
                                             .isa = options->isa,
                                             .threads = options->threads };
    return sp_renderer_create(&how, err);
}

/* The volumes of a frame: the volume of the view, and the volumes that its layers name. */
struct volumes {
    const struct options *options;
    struct sp_volume *own;
    struct {
        char id[SP_NAME_BYTES];
        struct sp_volume *volume;
    } others[2 * SP_LAYERS_MAX]; /* a layer names up to two */
    uint32_t count;
    struct sp_error err; /* why the last one was not found */
};

/* Writes what write_image() tells of a volume that is larger than memory to `texts`. */
static void describe_bricks(const struct sp_frame_bricks *bricks, char texts[3][24],
                            struct image *image) {
    snprintf(texts[0], sizeof texts[0], "%u", bricks->level);
    snprintf(texts[1], sizeof texts[1], "%u", bricks->asked);
    snprintf(texts[2], sizeof texts[2], "%" PRIu64, bricks->lost);
    image->level = texts[0];
    image->asked = texts[1];
    image->lost = texts[2];
}

static bool encode_and_write(const struct options *options, const struct sp_frame *frame,
                             enum sp_image_format format, struct sp_error *err) {
    struct sp_encoder *encoder = sp_encoder_create(err);
    struct image image = { 0 };
    char texts[3][24];
    const uint8_t *bytes;
    bool ok = encoder && sp_encode(encoder, frame, format,
                                   options->quality ? options->quality : QUALITY_DEFAULT, &bytes,
                                   &image.size, err);
    if (ok) {
        image.bytes = bytes;
        snprintf(image.backend, sizeof image.backend, "%s%s%s", frame->stats.backend,
                 frame->stats.isa[0] ? " " : "", frame->stats.isa);
        image.is_incomplete = !sp_frame_bricks_is_complete(&frame->stats.bricks);
        if (frame->stats.bricks.memory_bytes > 0)
            describe_bricks(&frame->stats.bricks, texts, &image);
        snprintf(image.render_time, sizeof image.render_time, "%.3f", frame->stats.render_ms);
        snprintf(image.splats, sizeof image.splats, "%" PRIu64, frame->stats.splats);
        ok = write_image(options, &image, sp_image_format_info(format)->name, err);
    }
    sp_encoder_destroy(&encoder);
    return ok;
}

/* Refuses a volume that is larger than the memory of the machine before it is allocated. */
static bool reserve(void *user, uint64_t bytes, struct sp_error *err) {
    long pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
    uint64_t memory = pages > 0 && page > 0 ? (uint64_t)pages * (uint64_t)page : UINT64_MAX;
    return bytes <= memory ||
           sp_fail(err, SP_ERR_BUDGET, user,
                   "needs %" PRIu64 " bytes of memory; the machine has %" PRIu64, bytes, memory);
}

/* `step` may be NULL: sp_load_options chooses. */
static struct sp_volume *load_step(const struct options *options, const char *source,
                                   const uint32_t *step, struct sp_error *err) {
    char host[SP_SOURCE_HOST_BYTES]; /* the user who passes an address allows its host */
    const struct sp_load_options how = { .reserve = reserve,
                                         .allowed_hosts = host,
                                         .step = step ? *step : 0,
                                         .has_step = step,
                                         .progress = show_progress,
                                         .user = (void *)source, /* only read */
                                         .timeout_ms = (int)options->timeout_s * 1000 };
    return sp_source_host(source, host, err) ? sp_volume_load(source, &how, err) : NULL;
}

struct sp_volume *load_local(const struct options *options, const char *source,
                             struct sp_error *err) {
    return load_step(options, source, NULL, err);
}

/* Loads a volume and prints its warnings. */
static struct sp_volume *load_telling(const struct options *options, const char *source,
                                      struct sp_error *err) {
    struct sp_volume *volume = load_local(options, source, err);
    const struct sp_volume_info *info = volume ? sp_volume_info(volume) : NULL;
    for (int i = 0; info && i < SP_WARNINGS_MAX && info->warnings[i][0]; i++)
        print_warning(source, info->warnings[i]);
    return volume;
}

/* Loads a volume that is shown beside another one, in the time step of that, or in its last one. */
static struct sp_volume *load_beside(const struct options *options, const char *source,
                                     const struct sp_steps *other, struct sp_error *err) {
    struct sp_volume *volume = load_telling(options, source, err);
    const uint32_t count = volume ? sp_volume_info(volume)->steps.count : 0;
    const uint32_t step = other->index < count ? other->index : count - 1;
    if (other->count < 2 || count < 2 || step == sp_volume_info(volume)->steps.index)
        return volume;
    sp_volume_unref(&volume);
    return load_step(options, source, &step, err);
}

/* The volume that a layer names: the id is a source as for --volume. Loads each once. */
static struct sp_volume *find_or_load(void *user, const char *id) {
    struct volumes *v = user;
    for (uint32_t i = 0; i < v->count; i++)
        if (strcmp(v->others[i].id, id) == 0)
            return sp_volume_ref(v->others[i].volume);
    struct sp_volume *volume = load_beside(v->options, id, &sp_volume_info(v->own)->steps, &v->err);
    if (!volume)
        return NULL;
    snprintf(v->others[v->count].id, sizeof v->others[0].id, "%s", id);
    v->others[v->count++].volume = volume;
    return sp_volume_ref(volume);
}

/* Renders one frame; NULL with *err set on failure. */
static struct sp_frame *render_frame(struct sp_renderer *renderer, struct volumes *volumes,
                                     const struct sp_view *view, enum sp_image_format format,
                                     struct sp_frame_pool *pool, struct sp_error *err) {
    const bool wants_float = sp_image_format_info(format)->wants_float;
    const struct sp_render_options what = { .format = wants_float ? SP_RGBAF32 : SP_RGBA8,
                                            .wants_depth = format == SP_IMAGE_EXR,
                                            .find = find_or_load,
                                            .user = volumes };
    struct sp_frame *frame = sp_renderer_render(renderer, volumes->own, view, pool, &what, err);
    if (!frame && err->code == SP_ERR_VOLUME_UNKNOWN && volumes->err.code != SP_OK)
        *err = volumes->err; /* the renderer knows only that there is none */
    return frame;
}

/* Replaces the volume by the time step of the view. The default view shows the step of the file
 * that the source names, or else the first step. */
static bool choose_step(struct volumes *volumes, const char *source, const struct sp_view *view,
                        struct sp_error *err) {
    const struct sp_volume_info *info = sp_volume_info(volumes->own);
    if (!sp_view_fits(view, info, err))
        return false;
    if (view->time.step == info->steps.index)
        return true;
    sp_volume_unref(&volumes->own);
    volumes->own = load_step(volumes->options, source, &view->time.step, err);
    return volumes->own != NULL;
}

static bool render_view(const struct options *options, struct sp_renderer *renderer,
                        struct volumes *volumes, const char *source, const proto_json *patch,
                        enum sp_image_format format, struct sp_error *err) {
    struct sp_view defaults, view;
    sp_view_choose(&defaults, volumes->own, sp_volume_info(volumes->own)->name);
    view = defaults;
    struct sp_frame *frame = NULL;
    struct sp_frame_pool *pool = sp_frame_pool_create(0, err);
    if (pool && proto_view_apply(patch, &defaults, &view, err) &&
        choose_step(volumes, source, &view, err))
        frame = render_frame(renderer, volumes, &view, format, pool, err);
    bool ok = frame && encode_and_write(options, frame, format, err);
    sp_frame_unref(&frame);
    sp_frame_pool_destroy(&pool);
    return ok;
}

static bool load_and_render(const struct options *options, struct sp_renderer *renderer,
                            const char *source, const proto_json *patch,
                            enum sp_image_format format, struct sp_error *err) {
    struct volumes volumes = { .options = options, .own = load_telling(options, source, err) };
    bool ok = volumes.own && render_view(options, renderer, &volumes, source, patch, format, err);
    for (uint32_t i = 0; i < volumes.count; i++)
        sp_volume_unref(&volumes.others[i].volume);
    sp_volume_unref(&volumes.own);
    return ok;
}

int render_local(const struct options *options, const char *source, const proto_json *patch,
                 enum sp_image_format format, struct sp_error *err) {
    struct sp_renderer *renderer = create_renderer(options, err);
    if (!renderer)
        return err->code == SP_ERR_INVALID ? usage_error("render", "%s", err->text) : 1;
    bool ok = load_and_render(options, renderer, source, patch, format, err);
    sp_renderer_destroy(&renderer);
    return ok ? 0 : 1;
}
