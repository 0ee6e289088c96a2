/* SPDX-License-Identifier: Apache-2.0 */
#include "ops/log.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "common/clock.h"
#include "sp/utf8.h"

enum { VALUE_BYTES = 256, FIELDS_BYTES = 1024 };

static const char *const levels[] = { "error", "warn", "info", "debug" };
static const char *const formats[SRV_LOG_FORMATS] = { "text", "logfmt", "json" };

bool srv_log_level_from(const char *name, enum sp_log_level *level) {
    for (unsigned i = 0; i < sizeof levels / sizeof *levels; i++)
        if (strcmp(levels[i], name) == 0) {
            *level = (enum sp_log_level)i;
            return true;
        }
    return false;
}

enum srv_log_format srv_log_format_from(const char *name) {
    int format = 0;
    while (format < SRV_LOG_FORMATS && strcmp(formats[format], name) != 0)
        format++;
    return (enum srv_log_format)format;
}

/* Returns the bytes of the character at `c`; 0 = not valid UTF-8, or a control character, which
 * could drive a terminal. */
static size_t character(const char *c) {
    const unsigned char first = (unsigned char)c[0], second = (unsigned char)c[1];
    const bool is_control =
        first < 0x20 || first == 0x7f || (first == 0xc2 && second < 0xa0); /* U+0080 to 9F */
    return is_control ? 0 : sp_utf8_length(c);
}

/* Copies the line, cut to `capacity`. Invalid UTF-8 and control characters become '?'. */
static void copy(const char *line, bool in_quotes, char *out, unsigned capacity) {
    unsigned used = 0;
    const char *c = line;
    if (in_quotes)
        out[used++] = '"';
    while (*c && used + 6 < capacity) {
        const size_t size = character(c);
        if (in_quotes && (*c == '"' || *c == '\\'))
            out[used++] = '\\';
        if (size == 0)
            out[used++] = '?';
        else
            memcpy(out + used, c, size);
        used += (unsigned)size;
        c += size == 0 ? 1 : size;
    }
    if (in_quotes)
        out[used++] = '"';
    out[used] = 0;
}

/* Writes the fields, each with its separator. Fields that do not fit are left out. */
static void write_fields(const struct sp_log_field *fields, bool json, char *out,
                         unsigned capacity) {
    unsigned used = 0;
    out[0] = 0;
    for (; fields->key; fields++) {
        char value[VALUE_BYTES];
        copy(fields->value, true, value, sizeof value);
        if (used + strlen(fields->key) + strlen(value) + 8 > capacity)
            break;
        used += (unsigned)snprintf(out + used, capacity - used, json ? "\"%s\":%s," : "%s=%s ",
                                   fields->key, value);
    }
}

unsigned srv_log_line(enum srv_log_format format, const char *stamp, enum sp_log_level level,
                      const struct sp_log_field *fields, const char *line, char out[SRV_LOG_LINE]) {
    char text[SRV_LOG_LINE - FIELDS_BYTES - 128], about[FIELDS_BYTES];
    bool in_quotes = format == SRV_LOG_JSON || format == SRV_LOG_LOGFMT;
    copy(line, in_quotes, text, sizeof text);
    write_fields(fields, format == SRV_LOG_JSON, about, sizeof about);
    int size = 0;
    switch (format) {
    case SRV_LOG_JSON:
        size = snprintf(out, SRV_LOG_LINE, "{\"time\":\"%s\",\"level\":\"%s\",%s\"msg\":%s}\n",
                        stamp, levels[level], about, text);
        break;
    case SRV_LOG_LOGFMT:
        size = snprintf(out, SRV_LOG_LINE, "time=%s level=%s %smsg=%s\n", stamp, levels[level],
                        about, text);
        break;
    case SRV_LOG_TEXT:
    case SRV_LOG_FORMATS:
        size = snprintf(out, SRV_LOG_LINE, "%s %s %s\n", stamp, levels[level], text);
        break;
    }
    return (unsigned)size;
}

/* `lines` is added to the count of lost lines if this line is lost. */
static void put_line(struct srv_log *log, enum sp_log_level level,
                     const struct sp_log_field *fields, const char *line, unsigned lines) {
    char out[SRV_LOG_LINE], seconds[24], stamp[48];
    const struct timespec now = srv_clock_date();
    struct tm utc;
    gmtime_r(&now.tv_sec, &utc);
    strftime(seconds, sizeof seconds, "%Y-%m-%dT%H:%M:%S", &utc);
    snprintf(stamp, sizeof stamp, "%s.%03ldZ", seconds, now.tv_nsec / 1000000);
    srv_log_ring_put(&log->ring, out, srv_log_line(log->format, stamp, level, fields, line, out),
                     lines);
}

static const struct sp_log_field none = { NULL, NULL };

static void report_lost(struct srv_log *log) {
    char line[128];
    unsigned lost = srv_log_ring_consume_lost(&log->ring);
    if (lost == 0)
        return;
    snprintf(line, sizeof line, "%u log lines were lost: the reader of the log was too slow", lost);
    put_line(log, SP_LOG_WARN, &none, line, lost);
}

static void write_line(struct srv_log *log, enum sp_log_level level,
                       const struct sp_log_field *fields, const char *line) {
    report_lost(log);
    put_line(log, level, fields, line, 1);
}

static void sink(void *user, enum sp_log_level level, const char *kind,
                 const struct sp_log_field *fields, const char *line) {
    struct srv_log *log = user;
    char more[1200];
    unsigned suppressed = 0;
    if (level != SP_LOG_DEBUG &&
        !srv_log_limit_allow(&log->limit, kind, srv_clock_ms(), &suppressed))
        return;
    if (suppressed > 0)
        snprintf(more, sizeof more, "%s; %u similar lines suppressed", line, suppressed);
    write_line(log, level, fields, suppressed > 0 ? more : line);
}

void srv_log_tick(struct srv_log *log, double now_ms) {
    const char *kind;
    unsigned suppressed;
    while ((kind = srv_log_limit_next(&log->limit, now_ms, &suppressed))) {
        char line[1024];
        snprintf(line, sizeof line, "%u similar lines suppressed: %.900s", suppressed, kind);
        write_line(log, SP_LOG_WARN, &none, line);
    }
    report_lost(log);
}

bool srv_log_start(struct srv_log *log, enum sp_log_level level, enum srv_log_format format,
                   struct sp_error *err) {
    log->format = format;
    srv_log_limit_init(&log->limit);
    if (!srv_log_ring_start(&log->ring, STDERR_FILENO, err))
        return false;
    sp_log_init(sink, log, level);
    return true;
}

void srv_log_end(struct srv_log *log) {
    srv_log_ring_end(&log->ring, SRV_LOG_END_MS);
}
