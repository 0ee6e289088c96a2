/* SPDX-License-Identifier: Apache-2.0
 *
 * Camera paths: sends one, waits while the daemon renders it, and fetches its frames or movie.
 */
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "cli/commands.h"
#include "cli/output.h"
#include "protocol/limits.h"
#include "sp/encode.h"

enum { POLL_MS = 200, PAUSE_MAX_MS = 10000 };

struct fetching {
    const struct options *options;
    struct http *http;
    char *id, *path; /* id and "/paths/ID" on the daemon; NULL = none yet */
    char format[8];
    int64_t frames, done;
    int64_t fetched; /* frames in the folder */
    bool is_movie, is_done;
    bool has_reported; /* a retry was reported */
    bool is_gone;      /* the path no longer exists on the daemon */
    bool has_folder;   /* this command created the folder for the frames */
    sigset_t signals;  /* signals that end the program; blocked during requests */
};

/* Shows progress on one line of a terminal, and nothing elsewhere. */
static void show_progress(const struct fetching *f, bool is_last) {
    if (isatty(STDERR_FILENO))
        fprintf(stderr, "\rframe %" PRId64 " of %" PRId64 "%s", f->done, f->frames,
                is_last ? "\n" : "");
}

/* Blocks the signals that end this program, except ignored ones. The command checks for them, so
 * that it can say what remains on the daemon before it ends. */
static void block_signals(struct fetching *f) {
    static const int signals[] = { SIGINT, SIGTERM, SIGHUP };
    sigemptyset(&f->signals);
    for (size_t i = 0; i < sizeof signals / sizeof *signals; i++) {
        struct sigaction action;
        if (sigaction(signals[i], NULL, &action) == 0 && action.sa_handler != SIG_IGN)
            sigaddset(&f->signals, signals[i]);
    }
    sigprocmask(SIG_BLOCK, &f->signals, NULL);
}

static bool is_interrupted(void *user) {
    const struct fetching *f = user;
    sigset_t pending, held;
    return sigpending(&pending) == 0 && sigandset(&held, &pending, &f->signals) == 0 &&
           !sigisemptyset(&held);
}

static bool pause_for(struct fetching *f, long ms, struct sp_error *err) {
    const struct timespec time = { .tv_sec = ms / 1000, .tv_nsec = ms % 1000 * 1000000 };
    int number = sigtimedwait(&f->signals, NULL, &time);
    if (number <= 0)
        return true;
    raise(number); /* stays pending until it is unblocked */
    return sp_fail(err, SP_ERR_CANCELLED, f->id, "interrupted");
}

/* True for errors of a daemon that is busy, restarting or unreachable for a moment. */
static bool passes(const struct http_response *response, const struct sp_error *err) {
    long status = response->status;
    return err->code == SP_ERR_IO || status == 429 || (status >= 502 && status <= 504);
}

/* A download of a frame or movie into a file. */
struct download {
    struct fetching *f;
    const char *file;
    struct output output; /* open from the first bytes on */
    struct sp_error err;  /* SP_OK, or the reason why the file cannot be written */
};

/* Creates the folder for frames. */
static bool begin_file(struct download *d) {
    struct fetching *f = d->f;
    bool is_new = false;
    if (!f->is_movie && !output_make_folder(f->options->out, &is_new, &d->err))
        return false;
    f->has_folder = f->has_folder || is_new;
    return output_open(&d->output, d->file, &d->err);
}

static bool add_to_file(void *user, const void *bytes, size_t size) {
    struct download *d = user;
    return (d->output.path || begin_file(d)) && output_add(&d->output, bytes, size, &d->err);
}

/* True if the failed request may be repeated. */
static bool may_try_again(struct download *into, const struct http_response *response,
                          const struct sp_error *err) {
    return passes(response, err) &&
           (!into || (into->err.code == SP_OK && output_restart(&into->output)));
}

/* Sends a request about the path and repeats it after temporary failures, with growing pauses, for
 * --timeout. The bytes of the answer go `into` a file unless it is NULL. The caller finishes the
 * response. */
static bool ask(struct fetching *f, const char *method, const char *what, struct download *into,
                struct http_response *response, struct sp_error *err) {
    const double give_up_s = now_s() + f->options->timeout_s;
    char *path = NULL;
    if (asprintf(&path, "%s%s", f->path, what) < 0)
        return sp_fail(err, SP_ERR_MEMORY, f->id, "out of memory");
    bool ok;
    for (long pause_ms = POLL_MS;; pause_ms *= 2) {
        ok = into ? http_fetch(f->http, path, "*/*", add_to_file, into, response, err)
                  : http_request(f->http, method, path, "*/*", NULL, response, err);
        if (ok || !may_try_again(into, response, err) || now_s() >= give_up_s)
            break;
        http_response_finish(response);
        if (!f->has_reported)
            fprintf(stderr, "%ssplatctl: %s: %s; trying again\n", isatty(STDERR_FILENO) ? "\n" : "",
                    err->place, err->text);
        f->has_reported = true;
        if (!pause_for(f, pause_ms < PAUSE_MAX_MS ? pause_ms : PAUSE_MAX_MS, err))
            break;
        if (pause_ms > PAUSE_MAX_MS)
            pause_ms = PAUSE_MAX_MS;
    }
    f->is_gone = f->is_gone || response->status == 404;
    free(path);
    return ok;
}

/* Downloads a frame or movie into a file. */
static bool fetch(struct fetching *f, const char *what, const char *file, struct sp_error *err) {
    struct http_response response = { 0 };
    struct download d = { .f = f, .file = file, .err.code = SP_OK };
    bool ok = ask(f, "GET", what, &d, &response, err);
    ok = ok && (d.output.path || begin_file(&d)) && output_close(&d.output, &d.err);
    if (d.err.code != SP_OK)
        *err = d.err;
    output_drop(&d.output);
    http_response_finish(&response);
    return ok;
}

/* Downloads the finished frames that are not in the folder yet. */
static bool fetch_frames(struct fetching *f, struct sp_error *err) {
    const struct sp_image_format_info *info = sp_image_format_info(sp_image_format_find(f->format));
    for (; f->fetched < f->done; f->fetched++) {
        char what[32], *file = NULL;
        snprintf(what, sizeof what, "/frames/%" PRId64, f->fetched);
        if (asprintf(&file, "%s/%06" PRId64 "%s", f->options->out, f->fetched, info->extension) < 0)
            return sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
        bool ok = fetch(f, what, file, err);
        free(file);
        if (!ok)
            return false;
    }
    return true;
}

/* Reads the state of the path: progress, or the reason of its failure. NULL with *err set. */
static proto_json *read_state(struct fetching *f, struct sp_error *err) {
    struct http_response response = { 0 };
    proto_json *state = NULL;
    if (ask(f, "GET", "", NULL, &response, err))
        state = proto_json_parse(response.body ? response.body : "", response.size, err);
    http_response_finish(&response);
    snprintf(f->format, sizeof f->format, "%s", text_of(state, "format"));
    f->is_movie = strcmp(f->format, "webm") == 0;
    proto_json_integer(proto_json_get(state, "frames"), &f->frames);
    proto_json_integer(proto_json_get(state, "done"), &f->done);
    f->is_done = strcmp(text_of(state, "state"), "done") == 0;
    return state;
}

/* Polls and downloads until everything is here. */
static bool follow(struct fetching *f, struct sp_error *err) {
    for (bool ok = true; ok && !f->is_done; ok = ok && (f->is_done || pause_for(f, POLL_MS, err))) {
        proto_json *state = read_state(f, err);
        if (!state)
            return false;
        show_progress(f, f->is_done);
        ok = f->is_movie || fetch_frames(f, err);
        if (ok && strcmp(text_of(state, "state"), "failed") == 0)
            ok = sp_fail(err, SP_ERR_INVALID, f->id, "%s", text_of(state, "reason"));
        proto_json_free(&state);
        if (!ok)
            return false;
    }
    return f->is_done && (!f->is_movie || fetch(f, "/movie", f->options->out, err));
}

/* Reads the document of the command line; NULL with *err set on failure. */
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

static bool set_id(struct fetching *f, const char *id, struct sp_error *err) {
    char *escaped = http_escape(f->http, id);
    f->id = strdup(id);
    bool ok = escaped && f->id && asprintf(&f->path, "/paths/%s", escaped) >= 0;
    if (!ok)
        f->path = NULL;
    free(escaped);
    return ok || sp_fail(err, SP_ERR_MEMORY, id, "out of memory");
}

/* Creates a path from the file of the command line. */
static bool create(struct fetching *f, struct sp_error *err) {
    char *body = read_path(f->options, &f->is_movie, err);
    bool ok = body && (f->http = connect_to_daemon(f->options, err)) &&
              output_check(f->options->out, !f->is_movie, err);
    proto_json *state = ok ? http_json(f->http, "POST", "/paths", body, err) : NULL;
    ok = state && set_id(f, text_of(state, "id"), err);
    proto_json_free(&state);
    free(body);
    return ok;
}

/* Takes the path of --id. */
static bool fetch_path(struct fetching *f, struct sp_error *err) {
    f->http = connect_to_daemon(f->options, err);
    if (!f->http || !set_id(f, f->options->id, err))
        return false;
    proto_json *state = http_json(f->http, "GET", f->path, NULL, err);
    f->is_gone = !state; /* or this token may not read it */
    f->is_movie = strcmp(text_of(state, "format"), "webm") == 0;
    bool ok = state && (!f->options->out || output_check(f->options->out, !f->is_movie, err));
    if (ok && !f->options->out)
        ok = print_json(f->options, state, err);
    proto_json_free(&state);
    return ok;
}

/* Deletes the path on the daemon, because everything is here. */
static void delete_fetched(struct fetching *f) {
    struct http_response response = { 0 };
    struct sp_error err;
    if (!ask(f, "DELETE", "", NULL, &response, &err) && !f->is_gone)
        fprintf(stderr,
                "splatctl: %s: everything is fetched, but the daemon cannot delete the path: %s\n",
                f->id, err.text);
    http_response_finish(&response);
}

/* Says how to resume or delete a path that remains on the daemon. */
static void say_how_to_resume(const struct fetching *f) {
    if (f->id && !f->is_gone)
        fprintf(stderr,
                "%ssplatctl: %s: the daemon keeps this path: \"splatctl path --id %s --out %s\" "
                "resumes "
                "it, \"splatctl path --id %s --delete\" deletes it\n",
                isatty(STDERR_FILENO) ? "\n" : "", f->id, f->id, f->options->out, f->id);
}

/* Output for programs. */
static bool report(const struct fetching *f, struct sp_error *err) {
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "out", f->options->out);
    proto_json_set_string(&json, "format", f->format);
    proto_json_set_integer(&json, "frames", f->frames);
    bool ok = print_line(json, err);
    proto_json_free(&json);
    return ok;
}

static int delete_path(const struct options *options, struct sp_error *err) {
    struct fetching f = { .options = options, .http = connect_to_daemon(options, err) };
    struct http_response response = { 0 };
    bool ok = f.http && set_id(&f, options->id, err) &&
              http_request(f.http, "DELETE", f.path, "application/json", NULL, &response, err);
    http_response_finish(&response);
    http_destroy(&f.http);
    free(f.id);
    free(f.path);
    return ok ? 0 : 1;
}

static int draw_path(const struct options *options, struct sp_error *err) {
    struct fetching f = { .options = options };
    bool ok = options->id ? fetch_path(&f, err) : create(&f, err);
    if (ok && options->out) {
        block_signals(&f);
        http_set_stop(f.http, is_interrupted, &f);
        ok = follow(&f, err);
        /* A path that this command did not create stays, unless the user asks. */
        if (ok && (!options->id || options->delete))
            delete_fetched(&f);
        else if (!ok)
            say_how_to_resume(&f);
        if (!ok && f.has_folder)
            rmdir(options->out);                    /* fails unless it is empty */
        sigprocmask(SIG_UNBLOCK, &f.signals, NULL); /* may end here */
        ok = ok && (!options->json || report(&f, err));
    }
    http_destroy(&f.http);
    free(f.id);
    free(f.path);
    return ok ? 0 : 1;
}

int command_path(const struct options *options, struct sp_error *err) {
    if (!options->argument == !options->id)
        return usage_error("path", "needs a file with a camera path as JSON, or -; or --id");
    if (options->delete &&!options->id)
        return usage_error("path", "--delete needs --id");
    if (options->argument && !options->out)
        return usage_error("path", "needs --out: a folder for frames, or a file for a movie");
    return options->delete &&!options->out ? delete_path(options, err) : draw_path(options, err);
}
