/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/commands.h"
#include "cli/output.h"
#include "protocol/limits.h"
#include "protocol/view.h"

bool write_image(const struct options *options, const struct image *image, const char *format,
                 struct sp_error *err) {
    if (!output_write(options->out, image->bytes, image->size, err))
        return false;
    if (!options->json || strcmp(options->out, "-") == 0)
        return true;
    proto_json *report = proto_json_object();
    bool ok = proto_json_set_string(report, "out", options->out) &&
              proto_json_set_string(report, "format", format) &&
              proto_json_set_integer(report, "bytes", (int64_t)image->size) &&
              proto_json_set_string(report, "backend", image->backend);
    char *end;
    double ms = strtod(image->render_time, &end), splats = strtod(image->splats, NULL);
    if (ok && end != image->render_time)
        ok = proto_json_set_number(report, "render_ms", ms);
    if (ok && image->splats[0])
        ok = proto_json_set_number(report, "splats", splats);
    char *text = ok ? proto_json_to_text(report, NULL) : NULL;
    ok = text && puts(text) >= 0 && fflush(stdout) == 0;
    free(text);
    proto_json_free(&report);
    return ok || sp_fail(err, SP_ERR_IO, "standard output", "cannot write");
}

proto_json *read_view(const struct options *options, struct sp_error *err) {
    proto_json *view = NULL;
    const char *name = options->view;
    if (name && strcmp(name, "-") == 0)
        name = "standard input";
    if (!options->view) {
        view = proto_json_object();
    } else {
        size_t size;
        char *text = input_read(options->view, PROTO_BODY_MAX, &size, err);
        if (!text)
            return NULL;
        view = proto_json_parse(text, size, err);
        free(text);
        if (!view) {
            if (err)
                snprintf(err->place, sizeof err->place, "%s", name);
            return NULL;
        }
    }
    if (view && proto_json_type(view) != PROTO_JSON_OBJECT) {
        sp_fail(err, SP_ERR_INVALID, name, "must be a view as a JSON object");
        proto_json_free(&view);
        return NULL;
    }
    bool ok = view != NULL;
    if (ok && options->size[0]) {
        proto_json *size = proto_json_array();
        ok = proto_json_append_integer(size, options->size[0]) &&
             proto_json_append_integer(size, options->size[1]);
        ok = proto_json_set(view, "size", size) && ok;
    }
    if (!ok) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
        proto_json_free(&view);
    }
    return view;
}

static bool render_remote(const struct options *options, const char *source, proto_json *view,
                          enum sp_image_format format, struct sp_error *err) {
    struct http *http = http_create(options->url, options->token, options->timeout_s, err);
    char *id = http ? resolve_volume(http, options, source, false, true, err) : NULL;
    char *body =
        id && proto_json_set_string(view, "volume", id) ? proto_json_to_text(view, NULL) : NULL;
    struct http_response response = { 0 };
    bool ok = false;
    const struct sp_image_format_info *info = sp_image_format_info(format);
    char path[96];
    int n = snprintf(path, sizeof path, "/render?format=%s", info->name);
    if (options->quality)
        snprintf(path + n, sizeof path - (size_t)n, "&quality=%d", options->quality);
    if (body)
        ok = http_request(http, "POST", path, info->mime, body, &response, err);
    else if (id)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
    if (ok && strcmp(response.type, info->mime) != 0)
        ok = sp_fail(err, SP_ERR_FORMAT, "POST /render", "the answer is %s, not %s",
                     response.type[0] ? response.type : "of no type", info->mime);
    if (ok) {
        struct image image = { .bytes = response.body, .size = response.size };
        memcpy(image.backend, response.backend, sizeof image.backend);
        memcpy(image.render_time, response.render_time, sizeof image.render_time);
        memcpy(image.splats, response.splats, sizeof image.splats);
        ok = write_image(options, &image, info->name, err);
    }
    http_response_finish(&response);
    free(body);
    free(id);
    http_destroy(&http);
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
    proto_json *view = read_view(options, err);
    if (!view)
        return 1;
    const char *named = proto_view_volume(view);
    char *source = options->volume ? strdup(options->volume) : named ? strdup(named) : NULL;
    int status = 1;
    if (!source)
        status = usage_error("render", "needs --volume, because the view names none");
    else if (options->local)
        status = render_local(options, source, view, format, err);
    else
        status = render_remote(options, source, view, format, err) ? 0 : 1;
    free(source);
    proto_json_free(&view);
    return status;
}
