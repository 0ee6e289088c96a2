/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "cli/commands.h"
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

/* Renders one frame; NULL with *err set on failure. */
static struct sp_frame *render_frame(struct sp_renderer *renderer, struct sp_volume *volume,
                                     const struct sp_view *view, enum sp_image_format format,
                                     struct sp_frame_pool *pool, struct sp_error *err) {
    const struct sp_render_options what = { .format = sp_image_format_info(format)->wants_float
                                                          ? SP_RGBAF32
                                                          : SP_RGBA8 };
    return sp_renderer_render(renderer, volume, view, pool, &what, err);
}

static bool encode_and_write(const struct options *options, const struct sp_frame *frame,
                             enum sp_image_format format, struct sp_error *err) {
    struct sp_encoder *encoder = sp_encoder_create(err);
    struct image image = { 0 };
    const uint8_t *bytes;
    bool ok = encoder && sp_encode(encoder, frame, format,
                                   options->quality ? options->quality : QUALITY_DEFAULT, &bytes,
                                   &image.size, err);
    if (ok) {
        image.bytes = bytes;
        snprintf(image.backend, sizeof image.backend, "%s%s%s", frame->stats.backend,
                 frame->stats.isa[0] ? " " : "", frame->stats.isa);
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

static bool load_and_render(const struct options *options, struct sp_renderer *renderer,
                            const char *source, const proto_json *patch,
                            enum sp_image_format format, struct sp_error *err) {
    const struct sp_load_options load = { .reserve = reserve,
                                          .progress = show_progress,
                                          .user = (void *)source, /* only read */
                                          .timeout_ms = (int)options->timeout_s * 1000 };
    struct sp_volume *volume = sp_volume_load(source, &load, err);
    if (!volume)
        return false;
    const struct sp_volume_info *info = sp_volume_info(volume);
    struct sp_view defaults, view;
    sp_view_choose(&defaults, volume, info->name);
    view = defaults;
    struct sp_frame *frame = NULL;
    struct sp_frame_pool *pool = sp_frame_pool_create(0, err);
    if (pool && proto_view_apply(patch, &defaults, &view, err))
        frame = render_frame(renderer, volume, &view, format, pool, err);
    bool ok = frame && encode_and_write(options, frame, format, err);
    sp_frame_unref(&frame);
    sp_frame_pool_destroy(&pool);
    sp_volume_unref(&volume);
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
