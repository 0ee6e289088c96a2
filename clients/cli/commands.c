/* SPDX-License-Identifier: Apache-2.0 */
#include "cli/commands.h"
#include "cli/print.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { POLL_MS = 100 };

struct http *connect_to_daemon(const struct options *options, struct sp_error *err) {
    return http_create(options->url, options->token, options->timeout_s, err);
}

const char *text_of(const proto_json *object, const char *key) {
    const char *text = proto_json_string(proto_json_get(object, key));
    return text ? text : "";
}

bool print_json(const struct options *options, const proto_json *json, struct sp_error *err) {
    return options->json ? print_line(json, err) : print_indented(json, err);
}

bool print_line(const proto_json *json, struct sp_error *err) {
    char *text = proto_json_to_text(json, NULL);
    bool ok = text && puts(text) >= 0 && fflush(stdout) == 0;
    free(text);
    return ok || sp_fail(err, SP_ERR_IO, "standard output", "cannot write");
}

char *collection_path(struct http *http, const char *collection, const char *name,
                      struct sp_error *err) {
    char *escaped = http_escape(http, name), *path = NULL;
    if (!escaped || asprintf(&path, "/%s/%s", collection, escaped) < 0) {
        path = NULL;
        sp_fail(err, SP_ERR_MEMORY, name, "out of memory");
    }
    free(escaped);
    return path;
}

static void add_volume(struct table *table, const proto_json *volume) {
    const proto_json *whole = proto_json_get(volume, "whole");
    const proto_json *dims = proto_json_get(whole ? whole : volume, "dims");
    const proto_json *elements = proto_json_get(volume, "elements");
    int64_t n[3] = { 0 }, bytes = 0, count = 0;
    for (size_t i = 0; i < 3; i++)
        proto_json_integer(proto_json_at(dims, i), &n[i]);
    proto_json_integer(proto_json_get(volume, "bytes"), &bytes);
    table_add(table, "%s", text_of(volume, "id"));
    table_add(table, "%s", text_of(volume, "state"));
    if (elements && proto_json_integer(proto_json_get(elements, "count"), &count))
        table_add(table, "%" PRId64, count);
    else if (n[0] > 0)
        table_add(table, "%" PRId64 "x%" PRId64 "x%" PRId64, n[0], n[1], n[2]);
    else
        table_add(table, "-");
    bool has_vectors = proto_json_size(proto_json_get(volume, "fields")) > 1;
    const char *type = text_of(volume, elements ? "kind" : "type");
    table_add(table, "%s%s", type[0] ? type : "-", has_vectors ? "+vectors" : "");
    table_add(table, "%.1f", (double)bytes / 1e6);
    table_add(table, "%s", text_of(volume, "source"));
}

/* Says on standard error what of a volume differs from its file. */
static void print_warnings(const proto_json *volume) {
    const proto_json *warnings = proto_json_get(volume, "warnings");
    for (size_t i = 0; i < proto_json_size(warnings); i++) {
        const char *text = proto_json_string(proto_json_at(warnings, i));
        print_warning(text_of(volume, "id"), text ? text : "");
    }
}

static bool print_volumes(const proto_json *list, struct sp_error *err) {
    static const struct listing volumes = {
        "volumes", { "ID", "STATE", "SIZE", "TYPE", "MB", "SOURCE" }, 6, 1 << 4, add_volume
    };
    bool ok = print_list(&volumes, list, err);
    for (size_t i = 0; i < proto_json_size(list); i++)
        print_warnings(proto_json_at(list, i));
    return ok;
}

int command_volumes(const struct options *options, struct sp_error *err) {
    struct http *http = connect_to_daemon(options, err);
    proto_json *answer = http ? http_json(http, "GET", "/volumes", NULL, err) : NULL;
    http_destroy(&http);
    if (!answer)
        return 1;
    bool ok = options->json ? print_json(options, answer, err)
                            : print_volumes(proto_json_get(answer, "volumes"), err);
    proto_json_free(&answer);
    return ok ? 0 : 1;
}

double now_s(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

/* Shows progress on one line of a terminal, and nothing elsewhere. `done` ends the line. */
static void show_progress(const char *id, const proto_json *volume, bool done) {
    double fraction = 0;
    if (!isatty(STDERR_FILENO))
        return;
    proto_json_number(proto_json_get(volume, "progress"), &fraction);
    fprintf(stderr, "\rloading %s %3.0f %%%s", id, done ? 100.0 : fraction * 100, done ? "\n" : "");
}

/* Polls until the volume is ready or failed, or the timeout ends. Takes ownership of `volume` and
 * returns the last answer; NULL with *err set on failure. */
static proto_json *wait_until_ready(struct http *http, const struct options *options,
                                    proto_json *volume, const char *path, struct sp_error *err) {
    double end = now_s() + options->timeout_s;
    char id[256];
    snprintf(id, sizeof id, "%s", text_of(volume, "id"));
    bool waited = false;
    while (volume && strcmp(text_of(volume, "state"), "ready") != 0) {
        if (strcmp(text_of(volume, "state"), "failed") == 0) {
            const char *reason = text_of(volume, "reason");
            sp_fail(err, SP_ERR_FORMAT, id, "loading failed: %s",
                    *reason ? reason : "the daemon tells no cause; its log may");
            proto_json_free(&volume);
        } else if (now_s() > end) {
            sp_fail(err, SP_ERR_TIMEOUT, id, "still loading after %u s; --timeout allows more",
                    options->timeout_s);
            proto_json_free(&volume);
        } else {
            show_progress(id, volume, false);
            waited = true;
            proto_json_free(&volume);
            nanosleep(&(struct timespec){ .tv_nsec = POLL_MS * 1000000L }, NULL);
            volume = http_json(http, "GET", path, NULL, err);
        }
    }
    if (waited)
        show_progress(id, NULL, volume != NULL);
    return volume;
}

static proto_json *post_volume(struct http *http, const char *source, struct sp_error *err) {
    proto_json *request = proto_json_object();
    bool is_demo = strncmp(source, "demo:", 5) == 0;
    proto_json_set_string(&request, is_demo ? "uri" : "path", source);
    return http_post(http, "/volumes", request, is_demo ? "/uri" : "/path", source, err);
}

/* Returns the volume with this id; NULL if there is none, or with *err set on another failure. */
static proto_json *find_volume(struct http *http, const char *id, struct sp_error *err) {
    char *path = collection_path(http, "volumes", id, err);
    struct http_response response = { 0 };
    proto_json *volume = NULL;
    if (path && http_request(http, "GET", path, "application/json", NULL, &response, err))
        volume = proto_json_parse(response.body ? response.body : "", response.size, err);
    else if (response.status == 404)
        err->code = SP_OK;
    http_response_finish(&response);
    free(path);
    return volume;
}

/* Writes the ids of the daemon's volumes; "no volumes" if there are none or they are unknown. */
static void name_volumes(struct http *http, char *out, size_t capacity) {
    proto_json *answer = http_json(http, "GET", "/volumes", NULL, NULL);
    const proto_json *list = proto_json_get(answer, "volumes");
    size_t count = proto_json_size(list), n = 0;
    snprintf(out, capacity, "no volumes");
    for (size_t i = 0; i < count; i++) {
        const char *id = text_of(proto_json_at(list, i), "id");
        if (n + strlen(id) + 24 > capacity) {
            snprintf(out + n, capacity - n, " and %zu more", count - i);
            break;
        }
        n += (size_t)snprintf(out + n, capacity - n, "%s%s", i ? ", " : "", id);
    }
    proto_json_free(&answer);
}

/* Neither an id nor a source that can be loaded: says both, and what there is. */
static void refuse_volume(struct http *http, const char *source, struct sp_error *err) {
    char names[256], why[SP_ERROR_TEXT];
    name_volumes(http, names, sizeof names);
    snprintf(why, sizeof why, "%s", err->text);
    sp_fail(err, err->code, source,
            "no volume has this id (the daemon has %s), and loading it "
            "fails: %s",
            names, why);
}

/* Returns the description of the volume that `source` names; see resolve_volume(). */
static proto_json *open_volume(struct http *http, const struct options *options, const char *source,
                               bool must_load, bool wait, struct sp_error *err) {
    bool maybe_id = !must_load && strncmp(source, "demo:", 5) != 0 && !strchr(source, '/');
    err->code = SP_OK;
    proto_json *volume = maybe_id ? find_volume(http, source, err) : NULL;
    if (!volume && err->code == SP_OK) {
        volume = post_volume(http, source, err);
        if (!volume && maybe_id && err->code == SP_ERR_INVALID)
            refuse_volume(http, source, err);
    }
    return volume && wait ? await_volume(http, options, volume, err) : volume;
}

proto_json *await_volume(struct http *http, const struct options *options, proto_json *volume,
                         struct sp_error *err) {
    char *path = collection_path(http, "volumes", text_of(volume, "id"), err);
    if (path)
        volume = wait_until_ready(http, options, volume, path, err);
    else
        proto_json_free(&volume);
    free(path);
    return volume;
}

char *resolve_volume(struct http *http, const struct options *options, const char *source,
                     bool must_load, bool wait, struct sp_error *err) {
    proto_json *volume = open_volume(http, options, source, must_load, wait, err);
    char *id = volume ? strdup(text_of(volume, "id")) : NULL;
    proto_json_free(&volume);
    return id;
}

int print_id(const struct options *options, struct http *http, proto_json *made,
             struct sp_error *err) {
    bool ok = made != NULL;
    if (ok && options->json)
        ok = print_json(options, made, err);
    else if (ok) {
        puts(text_of(made, "id"));
        print_warnings(made);
        ok = end_output(err);
    }
    proto_json_free(&made);
    http_destroy(&http);
    return ok ? 0 : 1;
}

int command_load(const struct options *options, struct sp_error *err) {
    if (!options->argument)
        return usage_error("load", "needs a file below the daemon's data folder, or demo:NAME");
    struct http *http = connect_to_daemon(options, err);
    proto_json *volume =
        http ? open_volume(http, options, options->argument, true, !options->no_wait, err) : NULL;
    return print_id(options, http, volume, err);
}

int command_unload(const struct options *options, struct sp_error *err) {
    if (!options->argument)
        return usage_error("unload", "needs the id of a volume; \"splatctl volumes\" lists them");
    struct http *http = connect_to_daemon(options, err);
    char *path = http ? collection_path(http, "volumes", options->argument, err) : NULL;
    struct http_response response = { 0 };
    bool ok = path && http_request(http, "DELETE", path, "application/json", NULL, &response, err);
    http_response_finish(&response);
    free(path);
    http_destroy(&http);
    return ok ? 0 : 1;
}

int command_view(const struct options *options, struct sp_error *err) {
    if (!options->argument)
        return usage_error("view", "needs the id of a volume; \"splatctl volumes\" lists them");
    struct http *http = connect_to_daemon(options, err);
    char *volume = http ? collection_path(http, "volumes", options->argument, err) : NULL;
    char *path = NULL;
    proto_json *view = NULL;
    if (volume && asprintf(&path, "%s/view", volume) >= 0)
        view = http_json(http, "GET", path, NULL, err);
    bool ok = view && print_json(options, view, err);
    proto_json_free(&view);
    free(path);
    free(volume);
    http_destroy(&http);
    return ok ? 0 : 1;
}
