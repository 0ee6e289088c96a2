/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/log.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>

static const char *const level_names[] = { "ERROR", "WARN", "INFO", "DEBUG" };

static void to_stderr(void *user, enum sp_log_level level, const char *kind,
                      const struct sp_log_field *fields, const char *line) {
    (void)kind;
    (void)fields;
    (void)user;
    fprintf(stderr, "%s %s\n", level_names[level], line);
}

static struct {
    sp_log_sink *sink;
    void *user;
    atomic_int level;
} log_state = { to_stderr, NULL, SP_LOG_INFO };

void sp_log_init(sp_log_sink *sink, void *user, enum sp_log_level level) {
    log_state.sink = sink ? sink : to_stderr;
    log_state.user = user;
    sp_log_set_level(level);
}

void sp_log_set_level(enum sp_log_level level) {
    atomic_store_explicit(&log_state.level, (int)level, memory_order_relaxed);
}

static bool is_enabled(enum sp_log_level level) {
    return (int)level <= atomic_load_explicit(&log_state.level, memory_order_relaxed);
}

static void write_line(enum sp_log_level level, const struct sp_log_field *fields,
                       const char *format, va_list args) {
    char line[1024];
    vsnprintf(line, sizeof line, format, args);
    /* Text of a peer or a file must not start a new line. */
    for (char *c = line; *c; c++)
        if ((unsigned char)*c < 0x20 || *c == 0x7f)
            *c = '?';
    log_state.sink(log_state.user, level, format, fields, line);
}

void sp_log_args(enum sp_log_level level, const char *format, va_list args) {
    if (is_enabled(level))
        write_line(level, &(struct sp_log_field){ NULL, NULL }, format, args);
}

void sp_log(enum sp_log_level level, const char *format, ...) {
    va_list args;
    va_start(args, format);
    sp_log_args(level, format, args);
    va_end(args);
}

void sp_log_with(enum sp_log_level level, const struct sp_log_field *fields, const char *format,
                 ...) {
    va_list args;
    if (!is_enabled(level))
        return;
    va_start(args, format);
    write_line(level, fields, format, args);
    va_end(args);
}
