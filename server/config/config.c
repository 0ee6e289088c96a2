/* SPDX-License-Identifier: Apache-2.0 */
#include "config/config.h"

#include <assert.h>
#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "ops/log.h"
#include "protocol/limits.h"
#include "sp/encode.h"
#include "sp/renderer.h"
#include "sp/volume.h"

enum kind { TEXT, COUNT, SIZE, PIXELS, SECONDS, YES_NO, VOLUME, FILE_TO_READ, SWITCH };

#define KIB INT64_C(1024)
#define MIB (KIB * 1024)
#define TIB (MIB * 1024 * 1024)

struct setting {
    const char *name; /* --name, and the key in a file */
    enum kind kind;
    size_t offset;       /* in struct srv_config */
    const char *initial; /* default; NULL = not set */
    int64_t min, max;    /* bytes, px, ms or a count, inclusive */
    const char *argument, *doc;
};

#define AT(field) offsetof(struct srv_config, field)

static const struct setting settings[] = {
    { "listen", TEXT, AT(listen), "127.0.0.1:8080", 0, 0, "ADDRESS:PORT",
      "where to listen; port 0 picks one; another address than loopback needs "
      "--token-file or TLS" },
    { "volume", VOLUME, 0, NULL, 0, 0, "PATH|demo:NAME", "load this volume; may be repeated" },
    { "data", TEXT, AT(data), NULL, 0, 0, "DIR", "folder from which clients may load volumes" },
    { "state", TEXT, AT(state), NULL, 0, 0, "DIR",
      "keep volumes, sessions, views, presets and camera paths here, so that they outlive the "
      "daemon" },
    { "memory", SIZE, AT(memory), "0", 0, 64 * TIB, "SIZE",
      "budget for volumes; 0 = half of the machine's memory" },
    { "video-memory", SIZE, AT(video_memory), "0", 0, 64 * TIB, "SIZE",
      "budget for all that is kept on a GPU; 0 = three quarters of its memory, or up to "
      "2 GiB where it does not tell" },
    { "backend", TEXT, AT(backend), "auto", 0, 0, "NAME", "renderer to use; see below" },
    { "gpu", TEXT, AT(gpu), "auto", 0, 0, "N",
      "GPU to use, as --probe numbers them; auto is the first that works" },
    { "require-gpu", YES_NO, AT(require_gpu), "no", 0, 0, NULL,
      "do not start without a GPU, and never go over to the CPU" },
    { "isa", TEXT, AT(isa), "auto", 0, 0, "NAME",
      "instruction set of the CPU renderer: auto, scalar, sse41, avx2, avx512, neon" },
    { "threads", COUNT, AT(threads), "0", 0, 256, "N", "render threads; 0 = one a core" },
    { "token-file", TEXT, AT(token_file), NULL, 0, 0, "FILE",
      "the tokens, one a line, with what each is for (README); without it a random one is "
      "made and printed" },
    { "tls-cert", TEXT, AT(tls_cert), NULL, 0, 0, "FILE",
      "speak TLS with this certificate (PEM, its own first, then its chain); needs --tls-key" },
    { "tls-key", TEXT, AT(tls_key), NULL, 0, 0, "FILE",
      "its private key (PEM), which others may not be able to read" },
    { "allow-origin", TEXT, AT(allow_origin), NULL, 0, 0, "ORIGIN,...",
      "pages of these other origins may use this daemon, with a token; none by default" },
    { "connections", COUNT, AT(connections), "256", 1, 60000, "N", "open connections" },
    { "connections-per-address", COUNT, AT(connections_per_address), "0", 0, 60000, "N",
      "open connections from one address; 0 = a quarter of --connections, and all of them from "
      "this machine's own, where a reverse proxy may be" },
    { "handshakes", COUNT, AT(handshakes), "256", 1, 10000, "N",
      "TLS handshakes at a time; of more the oldest ends" },
    { "handshake-rate", COUNT, AT(handshake_rate), "0", 0, 100000, "N",
      "TLS handshakes a second from one address, and those of sixteen seconds at once; 0 = 50, and "
      "any number from this machine's own, where a reverse proxy may be" },
    { "connection-requests", COUNT, AT(connection_requests), "1000", 1, 1000000, "N",
      "requests on one connection, pipelined or not, before it ends" },
    { "sessions", COUNT, AT(sessions), "256", 1, 100000, "N", "sessions that are awake" },
    { "sleeping-sessions", COUNT, AT(sleeping_sessions), "10000", 1, 1000000, "N",
      "sessions that sleep; at that many no new one is made" },
    { "participants", COUNT, AT(participants), "32", 1, 64, "N", "participants of one session" },
    { "views", COUNT, AT(views), "10000", 1, 1000000, "N", "kept views" },
    { "presets", COUNT, AT(presets), "1000", 1, 100000, "N", "kept presets" },
    { "paths", COUNT, AT(paths), "64", 1, 10000, "N", "camera paths, drawn or not" },
    { "path-frames", COUNT, AT(path_frames), "10000", 1, 999999, "N", "frames of a camera path" },
    { "path-bytes", SIZE, AT(path_bytes), "4G", 1024, 64 * TIB, "SIZE",
      "files of all camera paths, in --state or else in a folder below $TMPDIR" },
    { "message-size", SIZE, AT(message_size), "1M", 1024, PROTO_BODY_MAX, "SIZE",
      "largest message on a stream" },
    { "body-size", SIZE, AT(body_size), "1M", 1024, PROTO_BODY_MAX, "SIZE",
      "largest body of a request" },
    { "header-size", SIZE, AT(header_size), "32K", 4096, MIB, "SIZE",
      "memory of one connection for its request line and headers" },
    { "stream-bytes", SIZE, AT(stream_bytes), "8M", 64 * KIB, 1024 * MIB, "SIZE",
      "bytes of frames that one client may not have acknowledged yet" },
    { "render-queue", COUNT, AT(render_queue), "32", 1, 10000, "N",
      "renders by HTTP that may wait" },
    { "render-bytes", SIZE, AT(render_bytes), "1G", MIB, TIB, "SIZE",
      "pictures by HTTP that are made or on their way to their clients, together" },
    { "frame-size", PIXELS, AT(frame_px), "16M", 512 * 512, (int64_t)SP_SIZE_MAX *SP_SIZE_MAX,
      "PX|WxH", "largest picture that a client may ask for; 16M is 4096x4096" },
    { "video-pixels", PIXELS, AT(video_px), "8M", 512 * 512, 1024 * MIB, "PX|WxH",
      "pictures of all video encoders together, of 40 (VP8) to 100 (VP9) bytes a px; beyond, "
      "streams get JPEG; as many again for movies of camera paths" },
    { "header-time", SECONDS, AT(header_time_ms), "10", 50, 600000, "SECONDS",
      "a request's headers must arrive within this" },
    { "request-time", SECONDS, AT(request_time_ms), "30", 50, 600000, "SECONDS",
      "a request's body must arrive, and an answer must be read, within this each" },
    { "idle-time", SECONDS, AT(idle_time_ms), "60", 50, 3600000, "SECONDS",
      "a connection without a request is closed after this" },
    { "ping-time", SECONDS, AT(ping_time_ms), "15", 50, 3600000, "SECONDS",
      "a silent stream is pinged after this, and closed after three times this" },
    { "stall-time", SECONDS, AT(stall_time_ms), "20", 50, 3600000, "SECONDS",
      "a client that takes no data or owes an acknowledgement for this long is dropped" },
    { "session-time", SECONDS, AT(session_time_ms), "600", 50, 604800000, "SECONDS",
      "a session without participants falls asleep after this, and ends without --state" },
    { "sleep-time", SECONDS, AT(sleep_time_ms), "2592000", 50, 315360000000, "SECONDS",
      "a session that sleeps ends after this, in time that the daemon runs" },
    { "control-time", SECONDS, AT(control_time_ms), "10", 50, 3600000, "SECONDS",
      "who asks for control of a session and gets no answer has it after this" },
    { "drain-time", SECONDS, AT(drain_time_ms), "10", 50, 600000, "SECONDS",
      "on SIGTERM requests under way are finished for this long" },
    { "rest-time", SECONDS, AT(rest_time_ms), "0.12", 1, 60000, "SECONDS",
      "a view that did not change for this long is drawn in full quality" },
    { "http-threads", COUNT, AT(http_threads), "2", 1, 16, "N", "threads for HTTP" },
    { "encode-threads", COUNT, AT(encode_threads), "2", 1, 8, "N",
      "threads that encode images of streams; besides one less, at least one, for what takes "
      "long" },
    { "log-level", TEXT, AT(log_level), "info", 0, 0, "LEVEL", "error, warn, info or debug" },
    { "log-format", TEXT, AT(log_format), "logfmt", 0, 0, "FORM", "logfmt, json or text" },
    { "config", FILE_TO_READ, 0, NULL, 0, 0, "FILE",
      "read settings from a file of `key = value` lines" },
    { "probe", SWITCH, AT(probe), NULL, 0, 0, NULL,
      "print what there is to render on, and why not on the rest, and exit" },
    { "print-config", SWITCH, AT(print_config), NULL, 0, 0, NULL,
      "print the settings as such a file and exit" },
    { "help", SWITCH, AT(help), NULL, 0, 0, NULL, "print this text and exit" },
    { "version", SWITCH, AT(version), NULL, 0, 0, NULL, "print the version and exit" },
};
enum { SETTINGS = sizeof settings / sizeof *settings };

static void *field(struct srv_config *config, const struct setting *setting) {
    return (char *)config + setting->offset;
}

static const struct setting *find(const char *name, size_t length) {
    for (size_t i = 0; i < SETTINGS; i++)
        if (strlen(settings[i].name) == length && strncmp(settings[i].name, name, length) == 0)
            return &settings[i];
    return NULL;
}

/* Writes bytes, seconds or a count as the table's text form. */
static void number_to_text(enum kind kind, int64_t value, char text[32]) {
    if (kind == SECONDS)
        snprintf(text, 32, "%.12g", (double)value / 1000);
    else if (kind == SIZE && value && value % (MIB * 1024) == 0)
        snprintf(text, 32, "%" PRId64 "G", value / (MIB * 1024));
    else if ((kind == SIZE || kind == PIXELS) && value && value % MIB == 0)
        snprintf(text, 32, "%" PRId64 "M", value / MIB);
    else if ((kind == SIZE || kind == PIXELS) && value && value % KIB == 0)
        snprintf(text, 32, "%" PRId64 "K", value / KIB);
    else
        snprintf(text, 32, "%" PRId64, value);
}

/* "WIDTHxHEIGHT" as a number of px; -1 if it is none. */
static int64_t parse_area(const char *text) {
    unsigned width, height;
    char end;
    bool ok = strspn(text, "0123456789x") == strlen(text) && strlen(text) <= 11 &&
              sscanf(text, "%5ux%5u%c", &width, &height, &end) == 2;
    return ok ? (int64_t)width * height : -1;
}

static const char *number_name(enum kind kind) {
    return kind == SIZE      ? "size (a whole number, or with K, M, G or T)"
           : kind == PIXELS  ? "number of pixels (a whole number, or with K or M, or WIDTHxHEIGHT)"
           : kind == SECONDS ? "number of seconds"
                             : "whole number";
}

static bool parse_number(const struct setting *setting, const char *text, int64_t *out,
                         const char *place, struct sp_error *err) {
    char digits[32], low[32], high[32];
    size_t length = strspn(text, "0123456789.");
    const char *end = text + length, *stop;
    bool ok = length > 0 && length < sizeof digits && text[0] != '.';
    memcpy(digits, text, ok ? length : 0);
    digits[ok ? length : 0] = 0;
    double value = strtod(digits, (char **)&stop);
    ok = ok && !*stop;
    if (ok && setting->kind == SECONDS) {
        value *= 1000;
    } else if (ok && setting->kind == PIXELS && *end == 'x') {
        value = (double)parse_area(text);
        end += strlen(end);
    } else if (ok && (setting->kind == SIZE || setting->kind == PIXELS) && *end) {
        const char *suffixes = "KMGT", *suffix = strchr(suffixes, toupper((unsigned char)*end));
        ok = suffix != NULL;
        for (const char *s = suffixes; ok && s <= suffix; s++)
            value *= 1024;
        end++;
    }
    ok = ok && !*end && value >= (double)setting->min && value <= (double)setting->max &&
         (setting->kind == SECONDS || value == floor(value));
    if (ok) {
        *out = (int64_t)(value + 0.5);
        return true;
    }
    number_to_text(setting->kind, setting->min, low);
    number_to_text(setting->kind, setting->max, high);
    return sp_fail(err, SP_ERR_INVALID, place, "'%.64s' is no %s in [%s, %s]", text,
                   number_name(setting->kind), low, high);
}

bool srv_config_number(const char *name, const char *text, int64_t *number, struct sp_error *err) {
    return parse_number(find(name, strlen(name)), text, number, NULL, err);
}

static bool set_text(char **slot, const char *text, const char *place, struct sp_error *err) {
    char *copy = strdup(text);
    if (!copy)
        return sp_fail(err, SP_ERR_MEMORY, place, "no memory for a setting");
    free(*slot);
    *slot = copy;
    return true;
}

static bool read_file(struct srv_config *config, const char *path, struct sp_error *err);

static bool set(struct srv_config *config, const struct setting *setting, const char *value,
                const char *place, struct sp_error *err) {
    switch (setting->kind) {
    case TEXT:
        if (!*value)
            return sp_fail(err, SP_ERR_INVALID, place, "the value is empty");
        return set_text(field(config, setting), value, place, err);
    case COUNT:
    case SIZE:
    case PIXELS:
    case SECONDS:
        return parse_number(setting, value, field(config, setting), place, err);
    case YES_NO:
        if (strcmp(value, "yes") != 0 && strcmp(value, "no") != 0)
            return sp_fail(err, SP_ERR_INVALID, place, "'%.64s' is neither yes nor no", value);
        *(bool *)field(config, setting) = value[0] == 'y';
        return true;
    case VOLUME:
        if (!*value)
            return sp_fail(err, SP_ERR_INVALID, place, "the value is empty");
        if (config->volume_count == SRV_CONFIG_VOLUMES)
            return sp_fail(err, SP_ERR_INVALID, place, "more than %d volumes", SRV_CONFIG_VOLUMES);
        if (!set_text(&config->volumes[config->volume_count], value, place, err))
            return false;
        config->volume_count++;
        return true;
    case FILE_TO_READ:
        return read_file(config, value, err);
    case SWITCH:
        *(bool *)field(config, setting) = true;
        return true;
    }
    return false;
}

bool srv_config_line(struct srv_config *config, const char *line, const char *place,
                     struct sp_error *err) {
    const char *key = line + strspn(line, " \t");
    if (*key == '#' || *key == 0)
        return true;
    const char *equals = strchr(key, '=');
    if (!equals)
        return sp_fail(err, SP_ERR_INVALID, place, "a line is `key = value`; '=' is missing");
    size_t key_length = (size_t)(equals - key);
    while (key_length > 0 && isspace((unsigned char)key[key_length - 1]))
        key_length--;
    const struct setting *setting = find(key, key_length);
    if (!setting || setting->kind == SWITCH || setting->kind == FILE_TO_READ)
        return sp_fail(err, SP_ERR_INVALID, place, "there is no setting '%.*s'",
                       (int)(key_length < 64 ? key_length : 64), key);
    const char *start = equals + 1 + strspn(equals + 1, " \t");
    size_t length = strlen(start);
    while (length > 0 && isspace((unsigned char)start[length - 1]))
        length--;
    char *value = strndup(start, length);
    if (!value)
        return sp_fail(err, SP_ERR_MEMORY, place, "no memory for a setting");
    bool ok = set(config, setting, value, place, err);
    free(value);
    return ok;
}

FILE *srv_open_regular(const char *path) {
    struct stat st;
    int fd = open(path, O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
    if (fd < 0)
        return NULL;
    FILE *file = NULL;
    if (fstat(fd, &st) == 0 && !S_ISREG(st.st_mode))
        errno = S_ISDIR(st.st_mode) ? EISDIR : EINVAL;
    else
        file = fdopen(fd, "r");
    if (!file) {
        int error = errno;
        close(fd);
        errno = error;
    }
    return file;
}

static bool read_file(struct srv_config *config, const char *path, struct sp_error *err) {
    FILE *file = srv_open_regular(path);
    if (!file)
        return sp_fail(err, SP_ERR_IO, path, "cannot read the settings: %s", strerror(errno));
    char *line = NULL;
    size_t capacity = 0;
    bool ok = true;
    ssize_t length;
    for (unsigned number = 1; ok && (length = getline(&line, &capacity, file)) >= 0; number++) {
        char place[SP_ERROR_PLACE];
        snprintf(place, sizeof place, "%.200s:%u", path, number);
        if (strlen(line) != (size_t)length)
            ok = sp_fail(err, SP_ERR_INVALID, place, "a NUL byte");
        line[strcspn(line, "\r\n")] = 0;
        ok = ok && srv_config_line(config, line, place, err);
    }
    if (ok && ferror(file))
        ok = sp_fail(err, SP_ERR_IO, path, "cannot read the settings: %s", strerror(errno));
    free(line);
    fclose(file);
    return ok;
}

bool srv_config_init(struct srv_config *config, struct sp_error *err) {
    memset(config, 0, sizeof *config);
    for (size_t i = 0; i < SETTINGS; i++)
        if (settings[i].initial &&
            !set(config, &settings[i], settings[i].initial, settings[i].name, err)) {
            srv_config_finish(config);
            return false;
        }
    return true;
}

void srv_config_finish(struct srv_config *config) {
    for (size_t i = 0; i < SETTINGS; i++)
        if (settings[i].kind == TEXT)
            free(*(char **)field(config, &settings[i]));
    for (unsigned i = 0; i < config->volume_count; i++)
        free(config->volumes[i]);
    memset(config, 0, sizeof *config);
}

/* What the table cannot say of one setting alone. */
static bool check_together(const struct srv_config *config, struct sp_error *err) {
    enum sp_log_level level;
    if (!srv_log_level_from(config->log_level, &level))
        return sp_fail(err, SP_ERR_INVALID, "--log-level",
                       "'%.64s' is none of error, warn, info, debug", config->log_level);
    if (srv_log_format_from(config->log_format) == SRV_LOG_FORMATS)
        return sp_fail(err, SP_ERR_INVALID, "--log-format", "'%.64s' is none of logfmt, json, text",
                       config->log_format);
    if (!config->tls_cert != !config->tls_key)
        return sp_fail(err, SP_ERR_INVALID, config->tls_cert ? "--tls-cert" : "--tls-key",
                       "--tls-cert and --tls-key go together");
    return true;
}

bool srv_config_parse(struct srv_config *config, int argc, char **argv, struct sp_error *err) {
    for (int i = 1; i < argc; i++) {
        const char *argument = argv[i];
        if (strncmp(argument, "--", 2) != 0 || !argument[2])
            return sp_fail(err, SP_ERR_INVALID, argument,
                           "unexpected argument; options begin with --, and --help lists them");
        size_t length = strcspn(argument + 2, "=");
        const char *equals = argument[2 + length] ? argument + 2 + length : NULL;
        const struct setting *setting = find(argument + 2, length);
        char place[SP_ERROR_PLACE];
        snprintf(place, sizeof place, "--%.*s", (int)(length < 64 ? length : 64), argument + 2);
        if (!setting)
            return sp_fail(err, SP_ERR_INVALID, place, "unknown option; --help lists them");
        const char *value = equals ? equals + 1 : NULL;
        if (setting->kind == SWITCH && value)
            return sp_fail(err, SP_ERR_INVALID, place, "takes no value");
        if (setting->kind == YES_NO && !value)
            value = "yes";
        if (setting->kind != SWITCH && !value && !(value = argv[i + 1] ? argv[++i] : NULL))
            return sp_fail(err, SP_ERR_INVALID, place, "needs a value (%s)", setting->argument);
        if (!set(config, setting, value, place, err))
            return false;
    }
    return check_together(config, err);
}

static bool is_same(const struct srv_config *a, const struct srv_config *b,
                    const struct setting *setting) {
    const void *x = (const char *)a + setting->offset, *y = (const char *)b + setting->offset;
    const char *s = setting->kind == TEXT ? *(char *const *)x : NULL;
    const char *t = setting->kind == TEXT ? *(char *const *)y : NULL;
    bool same = true;
    switch (setting->kind) {
    case TEXT:
        return !s == !t && (!s || strcmp(s, t) == 0);
    case COUNT:
    case SIZE:
    case PIXELS:
    case SECONDS:
        return *(const int64_t *)x == *(const int64_t *)y;
    case YES_NO:
        return *(const bool *)x == *(const bool *)y;
    case VOLUME:
        same = a->volume_count == b->volume_count;
        for (unsigned i = 0; same && i < a->volume_count; i++)
            same = strcmp(a->volumes[i], b->volumes[i]) == 0;
        return same;
    case FILE_TO_READ:
    case SWITCH:
        break;
    }
    return true;
}

void srv_config_compare(const struct srv_config *a, const struct srv_config *b,
                        void (*differs)(void *user, const char *name), void *user) {
    for (size_t i = 0; i < SETTINGS; i++)
        if (!is_same(a, b, &settings[i]))
            differs(user, settings[i].name);
}

void srv_config_print_help(FILE *out) {
    fprintf(out, "Usage: splatd [OPTION...]\n\n"
                 "Renders volumes by EWA splatting and streams the pictures to browsers.\n"
                 "When it is ready it prints its address with the token on standard output.\n\n");
    for (size_t i = 0; i < SETTINGS; i++) {
        const struct setting *s = &settings[i];
        char left[64], low[32], high[32];
        snprintf(left, sizeof left, "--%s%s%s", s->name, s->argument ? " " : "",
                 s->argument ? s->argument : "");
        fprintf(out, "  %-34s %s\n", left, s->doc);
        bool number =
            s->kind == COUNT || s->kind == SIZE || s->kind == PIXELS || s->kind == SECONDS;
        number_to_text(s->kind, s->min, low);
        number_to_text(s->kind, s->max, high);
        if (number)
            fprintf(out, "  %-34s default %s, from %s to %s\n", "", s->initial, low, high);
        else if (s->initial)
            fprintf(out, "  %-34s default %s\n", "", s->initial);
    }
    fprintf(out, "\nBackends:\n  %-14s the first of these that starts\n", "auto");
    for (unsigned i = 0; sp_backend_at(i); i++)
        fprintf(out, "  %-14s %s\n", sp_backend_at(i)->name, sp_backend_at(i)->doc);
    fprintf(out, "\nBuilt-in volumes (demo:NAME, demo:NAME?size=N):\n");
    for (size_t i = 0; sp_demo_at(i); i++)
        fprintf(out, "  %-14s %s\n", sp_demo_at(i)->name, sp_demo_at(i)->doc);
    fprintf(out, "\nSizes take K, M, G, T. Exit status: 0 success, 1 failure, 2 usage; "
                 "of --probe 0 if a GPU works and 3 if none does.\n");
}

void srv_config_print(const struct srv_config *config, FILE *out) {
    for (size_t i = 0; i < SETTINGS; i++) {
        const struct setting *s = &settings[i];
        const void *at = (const char *)config + s->offset;
        char text[32];
        if (s->kind == SWITCH || s->kind == FILE_TO_READ)
            continue;
        fprintf(out, "# %s\n", s->doc);
        if (s->kind == VOLUME) {
            for (unsigned v = 0; v < config->volume_count; v++)
                fprintf(out, "volume = %s\n", config->volumes[v]);
            if (config->volume_count == 0)
                fprintf(out, "# volume =\n");
        } else if (s->kind == TEXT) {
            const char *value = *(char *const *)at;
            fprintf(out, "%s%s = %s\n", value ? "" : "# ", s->name, value ? value : "");
        } else if (s->kind == YES_NO) {
            fprintf(out, "%s = %s\n", s->name, *(const bool *)at ? "yes" : "no");
        } else {
            number_to_text(s->kind, *(const int64_t *)at, text);
            fprintf(out, "%s = %s\n", s->name, text);
        }
    }
}
