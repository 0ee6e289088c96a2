/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/commands.h"
#include "cli/output.h"
#include "protocol/view.h"

/* Says why an image is coarser than it should be. */
static void report_incomplete(const struct options *options, const struct image *image) {
    const unsigned long level = image->level ? strtoul(image->level, NULL, 10) : 0;
    const unsigned long asked = image->asked ? strtoul(image->asked, NULL, 10) : 0;
    fprintf(stderr, "splatctl: %s: ", options->out);
    if (image->lost && strtoul(image->lost, NULL, 10) > 0)
        fprintf(stderr,
                "%s bricks of the volume are damaged or cannot be read; the image is coarse "
                "there\n",
                image->lost);
    else if (level > asked)
        fprintf(stderr,
                "the image is coarser than its pixels: level %lu of the volume instead of %lu, "
                "because the memory does not suffice; give splatd a larger --memory, or show "
                "less\n",
                level, asked);
    else
        fprintf(stderr, "parts of the image are coarse, because finer samples of the volume were "
                        "still being read; try again\n");
}

/* What --json tells of a volume that is larger than memory. */
static void report_level(const struct image *image, proto_json **report) {
    if (!image->level || !image->level[0])
        return;
    proto_json_set_bool(report, "complete", !image->is_incomplete);
    proto_json_set_integer(report, "level", strtol(image->level, NULL, 10));
    proto_json_set_integer(report, "asked", strtol(image->asked, NULL, 10));
    proto_json_set_integer(report, "lost", strtol(image->lost, NULL, 10));
}

bool write_image(const struct options *options, const struct image *image, const char *format,
                 struct sp_error *err) {
    if (!output_write(options->out, image->bytes, image->size, err))
        return false;
    if (image->is_incomplete)
        report_incomplete(options, image);
    if (!options->json || strcmp(options->out, "-") == 0)
        return true;
    proto_json *report = proto_json_object();
    proto_json_set_string(&report, "out", options->out);
    proto_json_set_string(&report, "format", format);
    proto_json_set_integer(&report, "bytes", (int64_t)image->size);
    proto_json_set_string(&report, "backend", image->backend);
    char *end;
    double ms = strtod(image->render_time, &end), splats = strtod(image->splats, NULL);
    if (end != image->render_time)
        proto_json_set_number(&report, "render_ms", ms);
    if (image->splats[0])
        proto_json_set_number(&report, "splats", splats);
    report_level(image, &report);
    bool ok = print_line(report, err);
    proto_json_free(&report);
    return ok;
}

static bool render_remote(const struct options *options, struct http *http, const char *source,
                          proto_json **view, enum sp_image_format format, struct sp_error *err) {
    char *id = resolve_volume(http, options, source, false, true, err);
    if (id)
        proto_json_set_string(view, "volume", id);
    char *body = id ? proto_json_to_text(*view, NULL) : NULL;
    struct http_response response = { 0 };
    bool ok = false;
    const struct sp_image_format_info *info = sp_image_format_info(format);
    char path[96];
    int n = snprintf(path, sizeof path, "/render?format=%s", info->name);
    if (options->quality)
        snprintf(path + n, sizeof path - (size_t)n, "&quality=%u", options->quality);
    if (body)
        ok = http_request(http, "POST", path, info->mime, body, &response, err);
    else if (id)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
    if (ok && strcmp(response.type, info->mime) != 0)
        ok = sp_fail(err, SP_ERR_FORMAT, "POST /render", "the answer is %s, not %s",
                     response.type[0] ? response.type : "of no type", info->mime);
    if (ok) {
        struct image image = { .bytes = response.body,
                               .size = response.size,
                               .level = response.level,
                               .asked = response.asked,
                               .lost = response.lost };
        memcpy(image.backend, response.backend, sizeof image.backend);
        image.is_incomplete = strcmp(response.complete, "false") == 0;
        memcpy(image.render_time, response.render_time, sizeof image.render_time);
        memcpy(image.splats, response.splats, sizeof image.splats);
        ok = write_image(options, &image, info->name, err);
    }
    http_response_finish(&response);
    free(body);
    free(id);
    return ok;
}

/* The image format by --format, else by the suffix of --out, else PNG. SP_IMAGE_FORMAT_COUNT =
 * unknown. */
static enum sp_image_format pick_format(const struct options *options) {
    if (options->format)
        return sp_image_format_find(options->format);
    const char *name = strrchr(options->out, '/');
    const char *ending = strrchr(name ? name : options->out, '.');
    return ending ? sp_image_format_find(ending) : SP_IMAGE_PNG;
}

/* Renders the view of the command line in this process or by the daemon. Returns an exit status. */
static int draw(const struct options *options, enum sp_image_format format, struct sp_error *err) {
    struct http *http = options->local ? NULL : connect_to_daemon(options, err);
    proto_json *view = http || options->local ? read_view(options, http, err) : NULL;
    const char *named = view ? proto_view_volume(view) : NULL;
    char *source = options->volume ? strdup(options->volume) : named ? strdup(named) : NULL;
    int status = 1;
    if (view && !source)
        status = usage_error("render", "needs --volume, because the view names none");
    else if (view && options->local)
        status = render_local(options, source, view, format, err);
    else if (view)
        status = render_remote(options, http, source, &view, format, err) ? 0 : 1;
    free(source);
    proto_json_free(&view);
    http_destroy(&http);
    return status;
}

int command_render(const struct options *options, struct sp_error *err) {
    if (options->argument)
        return usage_error(options->argument, "render takes options only; did you mean --volume?");
    if (!options->out)
        return usage_error("render", "needs --out FILE, or --out - for standard output");
    enum sp_image_format format = pick_format(options);
    if (format == SP_IMAGE_FORMAT_COUNT)
        return usage_error(options->format ? options->format : options->out,
                           "is not an image format; use jpeg, png, webp or exr (--format)");
    if (!options->local && (options->threads || options->backend || options->gpu || options->isa))
        return usage_error("--threads, --backend, --gpu and --isa",
                           "need --local; otherwise the daemon chooses");
    if (options->local && options->preset)
        return usage_error("--preset", "is stored by the daemon; --local has none");
    return draw(options, format, err);
}
