/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/log.h"

#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>

static const char *const level_names[] = { "ERROR", "WARN", "INFO", "DEBUG" };

static void to_stderr(void *user, enum sp_log_level level, const char *line) {
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

void sp_log(enum sp_log_level level, const char *format, ...) {
    if ((int)level > atomic_load_explicit(&log_state.level, memory_order_relaxed))
        return;
    char line[1024];
    va_list args;
    va_start(args, format);
    vsnprintf(line, sizeof line, format, args);
    va_end(args);
    /* A line is a line, whatever a peer or a file put into it. */
    for (char *c = line; *c; c++)
        if ((unsigned char)*c < 0x20 || *c == 0x7f)
            *c = '?';
    log_state.sink(log_state.user, level, line);
}
