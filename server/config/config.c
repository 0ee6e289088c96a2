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
    size_t offset;        /* in struct srv_config */
    const char *initial;  /* default, as text; NULL = not set */
    int64_t min, max;     /* inclusive; bytes, pixels, milliseconds or a count */
    const char *argument; /* of --help and of completions: "a|b" are values, DIR and FILE paths */
    const char *doc;
};

#define AT(field) offsetof(struct srv_config, field)

static const struct setting settings[] = {
    { "listen", TEXT, AT(listen), "127.0.0.1:8080", 0, 0, "ADDRESS:PORT,unix:PATH",
      "Address and port to listen on, a Unix socket, or both. Port 0 picks a free port. An address "
      "other than loopback requires --token-file or TLS. The Unix socket is for this user only, "
      "speaks no TLS, and also takes arrays in shared memory (server/http/UNIX.md)." },
    { "volume", VOLUME, 0, NULL, 0, 0, "PATH|demo:NAME",
      "Load this volume at the start. May be given up to 64 times." },
    { "data", TEXT, AT(data), NULL, 0, 0, "DIR",
      "Folder from which clients may load volumes. Not set = clients cannot load files." },
    { "state", TEXT, AT(state), NULL, 0, 0, "DIR",
      "Folder in which volumes, sessions, views, presets and camera paths are stored, so that they "
      "survive a restart. Not set = nothing is stored." },
    { "cache", TEXT, AT(cache), NULL, 0, 0, "DIR",
      "Folder for brick files of volumes that do not fit into --memory: such a volume is converted "
      "once, and then shown from bricks that are read on demand. Not set = loading it fails. "
      "OME-Zarr needs no brick file." },
    { "cache-size", SIZE, AT(cache_size), "64G", 0, 64 * TIB, "SIZE",
      "Size of all brick files in --cache: the least recently used ones that are not open are "
      "removed. 0 = no limit." },
    { "memory", SIZE, AT(memory), "0", 0, 64 * TIB, "SIZE",
      "Memory for volumes. 0 = half of the machine's memory." },
    { "video-memory", SIZE, AT(video_memory), "0", 0, 64 * TIB, "SIZE",
      "GPU memory for volumes and images. 0 = three quarters of the GPU's memory, or up to 2G if "
      "the driver does not report its size." },
    { "backend", TEXT, AT(backend), "auto", 0, 0, "auto|gl|gl-software|cpu|null",
      "Renderer to use; see the list below." },
    { "gpu", TEXT, AT(gpu), "auto", 0, 0, "N",
      "GPU to use, by its number in the output of --probe. auto = the first that works." },
    { "require-gpu", YES_NO, AT(require_gpu), "no", 0, 0, NULL,
      "Fail at the start if no GPU works, and never fall back to the CPU." },
    { "end-with-input", YES_NO, AT(end_with_input), "no", 0, 0, NULL,
      "End when standard input closes. For programs that start the daemon with a pipe: it then "
      "ends with them, even if they are killed." },
    { "isa", TEXT, AT(isa), "auto", 0, 0, "auto|scalar|sse41|avx2|avx512|neon",
      "Instruction set of the CPU renderer. auto = the best that the processor has." },
    { "threads", COUNT, AT(threads), "0", 0, 256, "N",
      "Render threads. 0 = one per processor core." },
    { "token-file", TEXT, AT(token_file), NULL, 0, 0, "FILE",
      "File of tokens, one per line, with their roles and quotas (splatd.conf(5)). Not set = the "
      "daemon creates a random token and prints it." },
    { "tls-cert", TEXT, AT(tls_cert), NULL, 0, 0, "FILE",
      "Serve TLS with this certificate (PEM: the server's certificate, then its chain). Requires "
      "--tls-key." },
    { "tls-key", TEXT, AT(tls_key), NULL, 0, 0, "FILE",
      "Private key of the certificate (PEM). Other users must not be able to read the file." },
    { "allow-origin", TEXT, AT(allow_origin), NULL, 0, 0, "ORIGIN,...",
      "Web origins whose pages may use this daemon, with a token, and may frame its page. Not set "
      "= "
      "only the daemon's own page." },
    { "allow-host", TEXT, AT(allow_host), NULL, 0, 0, "HOST,...",
      "Hosts from which OME-Zarr may be loaded by HTTP and HTTPS: HOST or HOST:PORT (without a "
      "port, "
      "80 and 443 are allowed), or *.DOMAIN, which allows public IP addresses only. Not set = "
      "none." },
    { "connections", COUNT, AT(connections), "256", 1, 60000, "N", "Open connections." },
    { "connections-per-address", COUNT, AT(connections_per_address), "0", 0, 60000, "N",
      "Open connections from one address. 0 = a quarter of --connections, or all of them from this "
      "machine's own addresses, where a reverse proxy may run." },
    { "handshakes", COUNT, AT(handshakes), "256", 1, 10000, "N",
      "Concurrent TLS handshakes. When there are more, the oldest one ends." },
    { "handshake-rate", COUNT, AT(handshake_rate), "0", 0, 100000, "N",
      "TLS handshakes per second from one address, with bursts of 16 seconds' worth. 0 = 50, or "
      "unlimited from this machine's own addresses, where a reverse proxy may run." },
    { "connection-requests", COUNT, AT(connection_requests), "1000", 1, 1000000, "N",
      "Requests per connection, pipelined or not. The connection closes after the last one." },
    { "sessions", COUNT, AT(sessions), "256", 1, 100000, "N", "Active sessions." },
    { "hibernated-sessions", COUNT, AT(hibernated_sessions), "10000", 1, 1000000, "N",
      "Hibernated sessions. Over this number, one of the owner with the most ends." },
    { "participants", COUNT, AT(participants), "32", 1, 64, "N", "Participants per session." },
    { "views", COUNT, AT(views), "10000", 1, 1000000, "N", "Saved views." },
    { "presets", COUNT, AT(presets), "1000", 1, 100000, "N", "Saved presets." },
    { "paths", COUNT, AT(paths), "64", 1, 10000, "N", "Camera paths, finished or not." },
    { "path-frames", COUNT, AT(path_frames), "10000", 1, 999999, "N", "Frames per camera path." },
    { "path-bytes", SIZE, AT(path_bytes), "4G", 1024, 64 * TIB, "SIZE",
      "Total size of the files of all camera paths, in --state or else in a folder below "
      "$TMPDIR." },
    { "uploads", COUNT, AT(uploads), "4096", 1, 100000, "N",
      "Uploaded files, finished or not, that are on the disk. A series of DICOM has hundreds." },
    { "upload-bytes", SIZE, AT(upload_bytes), "16G", 0, 64 * TIB, "SIZE",
      "Total size of all uploaded files, and of one. 0 = clients cannot upload files." },
    { "upload-dir", TEXT, AT(upload_dir), NULL, 0, 0, "DIR",
      "Folder for uploaded files. Not set = in --state, or else in a folder below $TMPDIR that is "
      "removed at the end." },
    { "upload-time", SECONDS, AT(upload_time_ms), "86400", 50, 315360000000, "SECONDS",
      "Time without a byte after which an upload that is not loaded is removed." },
    { "upload-begin-time", SECONDS, AT(upload_begin_time_ms), "60", 50, 315360000000, "SECONDS",
      "The same for an upload that has not received its first byte." },
    { "message-size", SIZE, AT(message_size), "1M", 1024, PROTO_BODY_MAX, "SIZE",
      "Largest message that a client may send on a stream." },
    { "body-size", SIZE, AT(body_size), "1M", 1024, PROTO_BODY_MAX, "SIZE",
      "Largest body of an HTTP request." },
    { "header-size", SIZE, AT(header_size), "32K", 4096, MIB, "SIZE",
      "Memory per connection for the request line and the headers." },
    { "stream-bytes", SIZE, AT(stream_bytes), "8M", 64 * KIB, 1024 * MIB, "SIZE",
      "Bytes of frames per client that are sent and not yet acknowledged." },
    { "render-queue", COUNT, AT(render_queue), "32", 1, 10000, "N",
      "Snapshots (images requested over HTTP) that may wait to be rendered." },
    { "render-bytes", SIZE, AT(render_bytes), "0", 0, 64 * TIB, "SIZE",
      "Memory of frames: what they are drawn in, pixels, encoders, images being sent. One half is "
      "for sessions, the other for images over HTTP and camera paths. 0 = a quarter of the "
      "machine's memory, at least 2G." },
    { "frame-size", PIXELS, AT(frame_px), "16M", 512 * 512, (int64_t)SP_SIZE_MAX *SP_SIZE_MAX,
      "PX|WxH", "Largest image, in pixels, that a client may request. 16M is 4096x4096." },
    { "video-pixels", PIXELS, AT(video_px), "8M", 512 * 512, 1024 * MIB, "PX|WxH",
      "Total frame size, in pixels, of all video encoders of streams, which take 40 (VP8) to 100 "
      "(VP9) bytes per pixel. Streams above it get JPEG. The movies of camera paths have the same "
      "limit again." },
    { "header-time", SECONDS, AT(header_time_ms), "10", 50, 600000, "SECONDS",
      "Time limit for the headers of a request to arrive." },
    { "request-time", SECONDS, AT(request_time_ms), "30", 50, 600000, "SECONDS",
      "Time limit for the body of a request to arrive, and again for the client to read the "
      "answer." },
    { "idle-time", SECONDS, AT(idle_time_ms), "60", 50, 3600000, "SECONDS",
      "Time after which a connection without a request is closed." },
    { "ping-time", SECONDS, AT(ping_time_ms), "15", 50, 3600000, "SECONDS",
      "Time after which a silent stream is pinged. It is closed after three times this." },
    { "stall-time", SECONDS, AT(stall_time_ms), "20", 50, 3600000, "SECONDS",
      "Time after which a client is disconnected that reads no data or sends no acknowledgement." },
    { "session-time", SECONDS, AT(session_time_ms), "600", 50, 604800000, "SECONDS",
      "Time after which a session without participants is hibernated, or deleted if there is no "
      "--state." },
    { "hibernation-time", SECONDS, AT(hibernation_time_ms), "2592000", 50, 315360000000, "SECONDS",
      "Time after which a hibernated session is deleted. Only time in which the daemon runs "
      "counts." },
    { "control-time", SECONDS, AT(control_time_ms), "10", 50, 3600000, "SECONDS",
      "Time after which an unanswered request for control of a session is granted." },
    { "drain-time", SECONDS, AT(drain_time_ms), "10", 50, 600000, "SECONDS",
      "Time that requests in progress have to finish after SIGTERM." },
    { "rest-time", SECONDS, AT(rest_time_ms), "0.12", 1, 60000, "SECONDS",
      "Time without a change after which a view is displayed in full quality at the earliest." },
    { "http-threads", COUNT, AT(http_threads), "2", 1, 16, "N", "Threads that serve HTTP." },
    { "encode-threads", COUNT, AT(encode_threads), "2", 1, 8, "N",
      "Threads that encode the frames of streams. For frames that are slow to encode there is one "
      "background thread less than this, at least one." },
    { "log-level", TEXT, AT(log_level), "info", 0, 0, "error|warn|info|debug",
      "Least important level that is logged." },
    { "log-format", TEXT, AT(log_format), "logfmt", 0, 0, "logfmt|json|text",
      "Format of log lines." },
    { "config", FILE_TO_READ, 0, NULL, 0, 0, "FILE",
      "Read settings from a file of `key = value` lines. Later settings replace earlier ones." },
    { "probe", SWITCH, AT(probe), NULL, 0, 0, NULL,
      "Print the devices that can render, and why others cannot, then exit." },
    { "print-config", SWITCH, AT(print_config), NULL, 0, 0, NULL,
      "Print all settings as a file for --config, then exit." },
    { "help", SWITCH, AT(help), NULL, 0, 0, NULL, "Print this help, then exit." },
    { "version", SWITCH, AT(version), NULL, 0, 0, NULL, "Print the version, then exit." },
};
enum { SETTINGS = sizeof settings / sizeof *settings };

static void *value_of(struct srv_config *config, const struct setting *setting) {
    return (char *)config + setting->offset;
}

static const struct setting *find_setting(const char *name, size_t length) {
    for (size_t i = 0; i < SETTINGS; i++)
        if (strlen(settings[i].name) == length && strncmp(settings[i].name, name, length) == 0)
            return &settings[i];
    return NULL;
}

/* Formats a number as its setting accepts it: "4G", "0.12", "256". */
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

/* Returns the pixels of "WIDTHxHEIGHT"; -1 if the text has another form. */
static int64_t parse_area(const char *text) {
    unsigned width, height;
    char end;
    bool ok = strspn(text, "0123456789x") == strlen(text) && strlen(text) <= 11 &&
              sscanf(text, "%5ux%5u%c", &width, &height, &end) == 2;
    return ok ? (int64_t)width * height : -1;
}

static const char *number_name(enum kind kind) {
    return kind == SIZE ? "size (a whole number of bytes, or a number with K, M, G or T)"
           : kind == PIXELS
               ? "number of pixels (a whole number, a number with K or M, or WIDTHxHEIGHT)"
           : kind == SECONDS ? "number of seconds"
                             : "whole number";
}

/* Reads the number that `text` stands for, in the unit of the setting's range; false if the text
 * has another form. Not strtod() on the whole text: it also accepts signs, exponents, hexadecimal
 * numbers and "nan". */
static bool read_number(enum kind kind, const char *text, double *value) {
    char digits[32];
    size_t length = strspn(text, "0123456789.");
    const char *end = text + length, *stop;
    if (length == 0 || length >= sizeof digits || text[0] == '.')
        return false;
    memcpy(digits, text, length);
    digits[length] = 0;
    *value = strtod(digits, (char **)&stop);
    if (*stop)
        return false;
    if (kind == SECONDS) {
        *value *= 1000;
    } else if (kind == PIXELS && *end == 'x') {
        int64_t area = parse_area(text);
        *value = (double)area;
        return area >= 0;
    } else if ((kind == SIZE || kind == PIXELS) && *end) {
        const char *suffixes = "KMGT", *suffix = strchr(suffixes, toupper((unsigned char)*end));
        if (!suffix)
            return false;
        for (const char *s = suffixes; s <= suffix; s++)
            *value *= 1024;
        end++;
    }
    return !*end && (kind == SECONDS || *value == floor(*value));
}

static bool parse_number(const struct setting *setting, const char *text, int64_t *out,
                         const char *place, struct sp_error *err) {
    char low[32], high[32];
    double value;
    number_to_text(setting->kind, setting->min, low);
    number_to_text(setting->kind, setting->max, high);
    if (!read_number(setting->kind, text, &value))
        return sp_fail(err, SP_ERR_INVALID, place, "'%.64s' is not a %s in [%s, %s]", text,
                       number_name(setting->kind), low, high);
    if (value >= (double)setting->min && value <= (double)setting->max) {
        *out = (int64_t)(value + 0.5);
        return true;
    }
    return sp_fail(err, SP_ERR_INVALID, place, "%.64s is outside [%s, %s]", text, low, high);
}

bool srv_config_number(const char *name, const char *text, int64_t *number, struct sp_error *err) {
    return parse_number(find_setting(name, strlen(name)), text, number, NULL, err);
}

static bool set_text(char **slot, const char *text, const char *place, struct sp_error *err) {
    char *copy = strdup(text);
    if (!copy)
        return sp_fail(err, SP_ERR_MEMORY, place, "out of memory");
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
            return sp_fail(err, SP_ERR_INVALID, place, "the value must not be empty");
        return set_text(value_of(config, setting), value, place, err);
    case COUNT:
    case SIZE:
    case PIXELS:
    case SECONDS:
        return parse_number(setting, value, value_of(config, setting), place, err);
    case YES_NO:
        if (strcmp(value, "yes") != 0 && strcmp(value, "no") != 0)
            return sp_fail(err, SP_ERR_INVALID, place, "'%.64s' is not yes or no", value);
        *(bool *)value_of(config, setting) = value[0] == 'y';
        return true;
    case VOLUME:
        if (!*value)
            return sp_fail(err, SP_ERR_INVALID, place, "the value must not be empty");
        if (config->volume_count == SRV_CONFIG_VOLUMES)
            return sp_fail(err, SP_ERR_INVALID, place, "at most %d volumes can be given",
                           SRV_CONFIG_VOLUMES);
        if (!set_text(&config->volumes[config->volume_count], value, place, err))
            return false;
        config->volume_count++;
        return true;
    case FILE_TO_READ:
        return read_file(config, value, err);
    case SWITCH:
        *(bool *)value_of(config, setting) = true;
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
        return sp_fail(err, SP_ERR_INVALID, place, "expected `key = value`, but there is no '='");
    size_t key_length = (size_t)(equals - key);
    while (key_length > 0 && isspace((unsigned char)key[key_length - 1]))
        key_length--;
    const struct setting *setting = find_setting(key, key_length);
    if (!setting || setting->kind == SWITCH || setting->kind == FILE_TO_READ)
        return sp_fail(err, SP_ERR_INVALID, place, "unknown setting '%.*s'",
                       (int)(key_length < 64 ? key_length : 64), key);
    const char *start = equals + 1 + strspn(equals + 1, " \t");
    size_t length = strlen(start);
    while (length > 0 && isspace((unsigned char)start[length - 1]))
        length--;
    char *value = strndup(start, length);
    if (!value)
        return sp_fail(err, SP_ERR_MEMORY, place, "out of memory");
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
        return sp_fail(err, SP_ERR_IO, path, "cannot read the configuration file: %s",
                       strerror(errno));
    char *line = NULL;
    size_t capacity = 0;
    bool ok = true;
    ssize_t length;
    for (unsigned number = 1; ok && (length = getline(&line, &capacity, file)) >= 0; number++) {
        char place[SP_ERROR_PLACE];
        snprintf(place, sizeof place, "%.200s:%u", path, number);
        if (strlen(line) != (size_t)length)
            ok = sp_fail(err, SP_ERR_INVALID, place, "the line contains a NUL byte");
        line[strcspn(line, "\r\n")] = 0;
        ok = ok && srv_config_line(config, line, place, err);
    }
    if (ok && ferror(file))
        ok = sp_fail(err, SP_ERR_IO, path, "cannot read the configuration file: %s",
                     strerror(errno));
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
            free(*(char **)value_of(config, &settings[i]));
    for (unsigned i = 0; i < config->volume_count; i++)
        free(config->volumes[i]);
    memset(config, 0, sizeof *config);
}

/* Checks what the table cannot express: fixed names, and settings that depend on each other. */
static bool check_together(const struct srv_config *config, struct sp_error *err) {
    struct sp_error why;
    if (config->allow_host && !sp_hosts_check(config->allow_host, &why))
        return sp_fail(err, SP_ERR_INVALID, "--allow-host", "%s", why.text);
    enum sp_log_level level;
    if (!srv_log_level_from(config->log_level, &level))
        return sp_fail(err, SP_ERR_INVALID, "--log-level",
                       "'%.64s' is not one of error, warn, info, debug", config->log_level);
    if (srv_log_format_from(config->log_format) == SRV_LOG_FORMATS)
        return sp_fail(err, SP_ERR_INVALID, "--log-format",
                       "'%.64s' is not one of logfmt, json, text", config->log_format);
    if (!config->tls_cert != !config->tls_key)
        return sp_fail(err, SP_ERR_INVALID, config->tls_cert ? "--tls-cert" : "--tls-key",
                       "--tls-cert and --tls-key must be given together");
    return true;
}

bool srv_config_parse(struct srv_config *config, int argc, char **argv, struct sp_error *err) {
    for (int i = 1; i < argc; i++) {
        const char *argument = argv[i];
        if (strncmp(argument, "--", 2) != 0 || !argument[2])
            return sp_fail(err, SP_ERR_INVALID, argument,
                           "unexpected argument; options begin with -- (see --help)");
        size_t length = strcspn(argument + 2, "=");
        const char *equals = argument[2 + length] ? argument + 2 + length : NULL;
        const struct setting *setting = find_setting(argument + 2, length);
        char place[SP_ERROR_PLACE];
        snprintf(place, sizeof place, "--%.*s", (int)(length < 64 ? length : 64), argument + 2);
        if (!setting)
            return sp_fail(err, SP_ERR_INVALID, place, "unknown option (see --help)");
        const char *value = equals ? equals + 1 : NULL;
        if (setting->kind == SWITCH && value)
            return sp_fail(err, SP_ERR_INVALID, place, "this option takes no value");
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

enum { HELP_COLUMNS = 80 };

/* Prints the text in lines of at most HELP_COLUMNS, each with the prefix. */
static void print_wrapped(FILE *out, const char *prefix, const char *text) {
    size_t width = HELP_COLUMNS - strlen(prefix);
    while (*text) {
        size_t length = strlen(text), end = length;
        if (length > width)
            for (end = width; end > 0 && text[end] != ' ';)
                end--;
        end = end ? end : length;
        fprintf(out, "%s%.*s\n", prefix, (int)end, text);
        text += end + (text[end] == ' ');
    }
}

static bool is_number(enum kind kind) {
    return kind == COUNT || kind == SIZE || kind == PIXELS || kind == SECONDS;
}

/* Prints what the setting does, its default and its range. */
static void print_doc(FILE *out, const char *prefix, const struct setting *s) {
    char text[512], low[32], high[32];
    int used = snprintf(text, sizeof text, "%s", s->doc);
    number_to_text(s->kind, s->min, low);
    number_to_text(s->kind, s->max, high);
    if (is_number(s->kind))
        snprintf(text + used, sizeof text - (size_t)used, " Default %s, range [%s, %s]%s.",
                 s->initial, low, high, s->kind == SECONDS ? " seconds" : "");
    else if (s->initial)
        snprintf(text + used, sizeof text - (size_t)used, " Default %s.", s->initial);
    print_wrapped(out, prefix, text);
}

void srv_config_print_help(FILE *out) {
    fprintf(out, "Usage: splatd [OPTION...]\n\n"
                 "Renders volumes by EWA splatting and streams the images to browsers.\n"
                 "When it is ready, it prints its address and token on standard output.\n\n");
    for (size_t i = 0; i < SETTINGS; i++) {
        const struct setting *s = &settings[i];
        fprintf(out, "  --%s%s%s\n", s->name, s->argument ? " " : "",
                s->argument ? s->argument : "");
        print_doc(out, "        ", s);
    }
    fprintf(out, "\nBackends:\n  %-14s the first of these that starts\n", "auto");
    for (unsigned i = 0; sp_backend_at(i); i++)
        fprintf(out, "  %-14s %s\n", sp_backend_at(i)->name, sp_backend_at(i)->doc);
    fprintf(out, "\nBuilt-in volumes (demo:NAME, demo:NAME?size=N):\n");
    for (size_t i = 0; sp_demo_at(i); i++)
        fprintf(out, "  %-14s %s\n", sp_demo_at(i)->name, sp_demo_at(i)->doc);
    fprintf(out, "\nA SIZE is in bytes and may end in K, M, G or T (powers of 1024).\n"
                 "Exit status: 0 success, 1 failure, 2 wrong usage. With --probe: 0 if a GPU "
                 "works,\n3 if none does.\n");
}

void srv_config_print(const struct srv_config *config, FILE *out) {
    for (size_t i = 0; i < SETTINGS; i++) {
        const struct setting *s = &settings[i];
        const void *at = (const char *)config + s->offset;
        char text[32];
        if (s->kind == SWITCH || s->kind == FILE_TO_READ)
            continue;
        print_doc(out, "# ", s);
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
