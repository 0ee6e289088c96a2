/* SPDX-License-Identifier: Apache-2.0
 *
 * splatctl upload: sends files, a volume or a header with the files that it names, and opens the
 * volume. Whatever interrupts it, the same command continues where the bytes of the daemon end.
 */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "cli/commands.h"

#define PAUSE_FIRST_MS 250L
#define PAUSE_MAX_MS 8000L
#define PROGRESS_S 0.2

/* One file on its way. */
struct sending {
    struct http *http;
    const char *path, *name; /* name: the last component */
    char id[40];             /* of the upload */
    int fd;
    int64_t bytes, modified_ms, offset, begin_offset;
    double begin_s, printed_s;
};

/* Shows progress on one line of a terminal, and nothing elsewhere. */
static void show_progress(struct sending *s, bool is_end) {
    double now = now_s(), took = now - s->begin_s;
    if (!isatty(STDERR_FILENO) || (!is_end && now - s->printed_s < PROGRESS_S))
        return;
    s->printed_s = now;
    fprintf(stderr, "\ruploading %s %3.0f %% of %.1f MB, %.1f MB/s%s", s->name,
            100.0 * (double)s->offset / (double)s->bytes, (double)s->bytes * 1e-6,
            took > 0 ? (double)(s->offset - s->begin_offset) * 1e-6 / took : 0, is_end ? "\n" : "");
}

static bool open_file(struct sending *s, struct sp_error *err) {
    struct stat st;
    const char *slash = strrchr(s->path, '/');
    s->name = slash ? slash + 1 : s->path;
    s->fd = open(s->path, O_RDONLY | O_CLOEXEC);
    if (s->fd < 0 || fstat(s->fd, &st) != 0)
        return sp_fail(err, SP_ERR_IO, s->path, "cannot read the file: %s", strerror(errno));
    if (!S_ISREG(st.st_mode) || st.st_size == 0)
        return sp_fail(err, SP_ERR_INVALID, s->path,
                       S_ISREG(st.st_mode) ? "the file is empty" : "is not a regular file");
    s->bytes = st.st_size;
    s->modified_ms = (int64_t)st.st_mtim.tv_sec * 1000 + st.st_mtim.tv_nsec / 1000000;
    return true;
}

static bool same(const proto_json *object, const char *key, const char *text) {
    return strcmp(text_of(object, key), text) == 0;
}

/* Finds an upload of this file that an earlier command began. A file that changed meanwhile is
 * another one, and so is one of which the daemon does not know when it changed. */
static bool find_earlier(struct sending *s, const char *header, struct sp_error *err) {
    proto_json *answer = http_json(s->http, "GET", "/uploads", NULL, err);
    const proto_json *list = proto_json_get(answer, "uploads");
    for (size_t i = 0; i < proto_json_size(list) && !s->id[0]; i++) {
        const proto_json *upload = proto_json_at(list, i);
        int64_t bytes = 0, modified_ms = 0;
        proto_json_integer(proto_json_get(upload, "bytes"), &bytes);
        proto_json_integer(proto_json_get(upload, "modified"), &modified_ms);
        if (bytes == s->bytes && modified_ms > 0 && modified_ms == s->modified_ms &&
            same(upload, "name", s->name) && same(upload, "header", header ? header : "") &&
            proto_json_get(upload, "expires"))
            snprintf(s->id, sizeof s->id, "%s", text_of(upload, "id"));
    }
    bool ok = answer != NULL;
    proto_json_free(&answer);
    return ok;
}

/* Begins the upload. The place of an error is the file, unless the daemon is not reached. */
static bool create(struct sending *s, const char *header, struct sp_error *err) {
    proto_json *request = proto_json_object();
    proto_json_set_string(&request, "name", s->name);
    proto_json_set_integer(&request, "bytes", s->bytes);
    if (s->modified_ms > 0) /* a file from before 1970 is never continued */
        proto_json_set_integer(&request, "modified", s->modified_ms);
    if (header)
        proto_json_set_string(&request, "header", header);
    proto_json *answer = http_post(s->http, "/uploads", request, NULL, NULL, err);
    if (answer)
        snprintf(s->id, sizeof s->id, "%s", text_of(answer, "id"));
    else if (err->code == SP_ERR_INVALID)
        snprintf(err->place, sizeof err->place, "%s", s->path);
    bool ok = answer != NULL;
    proto_json_free(&answer);
    return ok;
}

/* Gives libcurl the next bytes of the file. */
static size_t read_more(void *user, void *bytes, size_t size) {
    struct sending *s = user;
    ssize_t n = pread(s->fd, bytes, size, (off_t)s->offset);
    if (n <= 0)
        return 0;
    s->offset += n;
    show_progress(s, false);
    return (size_t)n;
}

/* Asks where to continue. */
static bool locate(struct sending *s, struct http_response *response, struct sp_error *err) {
    char path[64];
    snprintf(path, sizeof path, "/uploads/%s", s->id);
    bool ok = http_request(s->http, "GET", path, "application/json", NULL, response, err);
    proto_json *json =
        ok ? proto_json_parse(response->body ? response->body : "", response->size, err) : NULL;
    ok = ok && json &&
         (proto_json_integer(proto_json_get(json, "offset"), &s->offset) ||
          sp_fail(err, SP_ERR_FORMAT, path, "the answer has no offset"));
    proto_json_free(&json);
    return ok;
}

/* Sends what is missing, in one request. *moved: bytes have arrived since the last request. */
static bool send_rest(struct sending *s, bool *moved, struct http_response *response,
                      struct sp_error *err) {
    char path[64];
    int64_t before = s->offset;
    if (!locate(s, response, err))
        return false;
    *moved = s->offset > before;
    if (s->offset == s->bytes)
        return true;
    s->begin_offset = s->offset;
    s->begin_s = now_s();
    http_response_finish(response);
    snprintf(path, sizeof path, "/uploads/%s", s->id);
    int64_t at = s->offset;
    bool ok = http_send(s->http, path, at, s->bytes - at, read_more, s, response, err);
    show_progress(s, true);
    s->offset = ok ? s->bytes : at; /* the rest is asked again */
    return ok;
}

/* True for a lost connection, a daemon that is busy or restarts, and an offset that moved. */
static bool passes(const struct http_response *response, const struct sp_error *err) {
    long status = response->status;
    return err->code == SP_ERR_IO || status == 409 || status == 429 ||
           (status >= 502 && status <= 504);
}

/* Sends a file; writes the id of its upload. */
static bool send_file(struct sending *s, const struct options *options, const char *header,
                      struct sp_error *err) {
    if (!open_file(s, err) || !find_earlier(s, header, err) ||
        (!s->id[0] && !create(s, header, err)))
        return false;
    double end_s = now_s() + options->timeout_s;
    for (long pause_ms = PAUSE_FIRST_MS;; pause_ms *= 2) {
        struct http_response response = { 0 };
        bool moved = false, ok = send_rest(s, &moved, &response, err);
        bool again = !ok && passes(&response, err) && (moved || now_s() < end_s);
        http_response_finish(&response);
        if (ok || !again)
            return ok;
        if (moved) {
            end_s = now_s() + options->timeout_s;
            pause_ms = PAUSE_FIRST_MS;
        }
        pause_ms = pause_ms < PAUSE_MAX_MS ? pause_ms : PAUSE_MAX_MS;
        nanosleep(&(struct timespec){ pause_ms / 1000, pause_ms % 1000 * 1000000 }, NULL);
    }
}

/* Opens the uploaded volume. NULL with *err set on failure. */
static proto_json *open_upload(struct http *http, const struct options *options, const char *upload,
                               struct sp_error *err) {
    proto_json *request = proto_json_object();
    proto_json_set_string(&request, "upload", upload);
    if (options->id)
        proto_json_set_string(&request, "id", options->id);
    proto_json *volume = http_post(http, "/volumes", request, "/id", "--id", err);
    return volume && !options->no_wait ? await_volume(http, options, volume, err) : volume;
}

static proto_json *upload_all(struct http *http, const struct options *options,
                              struct sp_error *err) {
    char first[40] = "";
    for (int i = 0; i < options->argument_count; i++) {
        struct sending s = { .http = http, .path = options->arguments[i], .fd = -1 };
        bool ok = send_file(&s, options, i > 0 ? first : NULL, err);
        if (s.fd >= 0)
            close(s.fd);
        if (!ok)
            return NULL;
        if (i == 0)
            snprintf(first, sizeof first, "%s", s.id);
    }
    return open_upload(http, options, first, err);
}

/* True for a header that has no samples of its own. */
static bool is_header(const char *path) {
    const char *dot = strrchr(path, '.');
    return dot && (strcasecmp(dot, ".nhdr") == 0 || strcasecmp(dot, ".json") == 0 ||
                   strcasecmp(dot, ".mhd") == 0 || strcasecmp(dot, ".hdr") == 0 ||
                   strcasecmp(dot, ".vgi") == 0);
}

int command_upload(const struct options *options, struct sp_error *err) {
    if (options->argument_count == 0)
        return usage_error("upload", "needs a file");
    if (options->argument_count == 1 && is_header(options->argument))
        return usage_error(options->argument,
                           "is a header; give the files with its samples after it");
    struct http *http = connect_to_daemon(options, err);
    return print_id(options, http, http ? upload_all(http, options, err) : NULL, err);
}
