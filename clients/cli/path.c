/* SPDX-License-Identifier: Apache-2.0
 *
 * Camera paths: sends one, waits while the daemon draws it, and fetches what it made.
 */
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "commands.h"
#include "output.h"
#include "protocol/limits.h"
#include "sp/encode.h"

enum { POLL_MS = 200 };

struct fetching {
    const struct options *options;
    struct http *http;
    char id[64], format[8];
    int64_t frames, done;
    int64_t fetched; /* frames that lie in the folder */
    bool is_movie;
};

/* On one line of a terminal; nothing elsewhere. */
static void show_progress(const struct fetching *f, bool is_last) {
    if (isatty(STDERR_FILENO))
        fprintf(stderr, "\rframe %" PRId64 " of %" PRId64 "%s", f->done, f->frames,
                is_last ? "\n" : "");
}

/* GET of what a path made, into a file. */
static bool fetch(struct fetching *f, const char *what, const char *file, struct sp_error *err) {
    struct http_response response;
    char path[160];
    snprintf(path, sizeof path, "/paths/%s/%s", f->id, what);
    bool ok = http_request(f->http, "GET", path, "*/*", NULL, &response, err) &&
              output_write(file, response.body ? response.body : "", response.size, err);
    http_response_finish(&response);
    return ok;
}

/* The frames that are drawn and not in the folder yet. */
static bool fetch_frames(struct fetching *f, struct sp_error *err) {
    const struct sp_image_format_info *info = sp_image_format_info(sp_image_format_find(f->format));
    for (; f->fetched < f->done; f->fetched++) {
        char what[32], *file = NULL;
        snprintf(what, sizeof what, "frames/%" PRId64, f->fetched);
        if (asprintf(&file, "%s/%06" PRId64 "%s", f->options->out, f->fetched, info->extension) < 0)
            return sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
        bool ok = fetch(f, what, file, err);
        free(file);
        if (!ok)
            return false;
    }
    return true;
}

/* Reads a state; *is_over when nothing more will come. */
static bool look(struct fetching *f, const proto_json *state, bool *is_over, struct sp_error *err) {
    const char *name = text_of(state, "state");
    proto_json_integer(proto_json_get(state, "frames"), &f->frames);
    proto_json_integer(proto_json_get(state, "done"), &f->done);
    *is_over = strcmp(name, "done") == 0;
    show_progress(f, *is_over);
    if (strcmp(name, "failed") == 0)
        return sp_fail(err, SP_ERR_INVALID, f->id, "%s", text_of(state, "reason"));
    return true;
}

/* Until it is drawn. Steals `state`. */
static bool follow(struct fetching *f, proto_json *state, struct sp_error *err) {
    char path[96];
    bool is_over = false, ok = true;
    snprintf(path, sizeof path, "/paths/%s", f->id);
    while (ok && state) {
        ok = look(f, state, &is_over, err) && (f->is_movie || fetch_frames(f, err));
        proto_json_free(&state);
        if (!ok || is_over)
            break;
        nanosleep(&(struct timespec){ .tv_nsec = POLL_MS * 1000000L }, NULL);
        state = http_json(f->http, "GET", path, NULL, err);
        ok = state != NULL;
    }
    return ok && (!f->is_movie || fetch(f, "movie", f->options->out, err));
}

/* Frames need a folder. */
static bool prepare_out(const struct fetching *f, struct sp_error *err) {
    const char *out = f->options->out;
    if (f->is_movie || mkdir(out, 0777) == 0 || errno == EEXIST)
        return true;
    return sp_fail(err, SP_ERR_IO, out, "cannot make this folder: %s", strerror(errno));
}

/* The document of the command line as text; NULL with *err set. */
static char *read_path(const struct options *options, bool *is_movie, struct sp_error *err) {
    size_t size;
    char *text = input_read(options->argument, PROTO_BODY_MAX, &size, err);
    proto_json *json = text ? proto_json_parse(text, size, err) : NULL;
    if (text && !json && err)
        snprintf(err->place, sizeof err->place, "%s", options->argument);
    *is_movie = strcmp(text_of(json, "format"), "webm") == 0;
    free(text);
    text = json ? proto_json_to_text(json, NULL) : NULL;
    if (json && !text)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
    proto_json_free(&json);
    return text;
}

static bool draw_path(struct fetching *f, const char *body, struct sp_error *err) {
    proto_json *state = http_json(f->http, "POST", "/paths", body, err);
    if (!state)
        return false;
    snprintf(f->id, sizeof f->id, "%s", text_of(state, "id"));
    snprintf(f->format, sizeof f->format, "%s", text_of(state, "format"));
    bool ok = follow(f, state, err);
    char path[96];
    struct http_response response;
    snprintf(path, sizeof path, "/paths/%s", f->id);
    /* Whatever came of it: the daemon need not keep what is here, or failed. */
    http_request(f->http, "DELETE", path, "*/*", NULL, &response, NULL);
    http_response_finish(&response);
    return ok;
}

/* For programs. */
static bool report(const struct fetching *f, struct sp_error *err) {
    proto_json *json = proto_json_object();
    bool ok = proto_json_set_string(json, "out", f->options->out) &&
              proto_json_set_string(json, "format", f->format) &&
              proto_json_set_integer(json, "frames", f->frames);
    char *text = ok ? proto_json_to_text(json, NULL) : NULL;
    ok = text && puts(text) >= 0 && fflush(stdout) == 0;
    free(text);
    proto_json_free(&json);
    return ok || sp_fail(err, SP_ERR_IO, "standard output", "cannot write");
}

int command_path(const struct options *options, struct sp_error *err) {
    if (!options->argument)
        return usage_error("path", "needs a file with a camera path as JSON, or -");
    if (!options->out)
        return usage_error("path", "needs --out: a folder for frames, or a file for a movie");
    struct fetching f = { .options = options };
    char *body = read_path(options, &f.is_movie, err);
    if (body)
        f.http = connect_to_daemon(options, err);
    bool ok = f.http && prepare_out(&f, err) && draw_path(&f, body, err);
    ok = ok && (!options->json || report(&f, err));
    http_destroy(&f.http);
    free(body);
    return ok ? 0 : 1;
}
