/* SPDX-License-Identifier: Apache-2.0
 *
 * Log lines on standard error, in one of three forms (--log-format):
 *
 *   logfmt  time=2026-01-31T12:00:00.123Z level=info volume="engine" msg="volume engine loaded"
 *   json    {"time":"2026-01-31T12:00:00.123Z","level":"info","volume":"engine","msg":"…"}
 *   text    2026-01-31T12:00:00.123Z info volume engine loaded
 *
 * Between level and msg stands what the line speaks of, as far as it does: volume, session, path,
 * peer. msg says it as well. Lines of one kind have a bound (log_bound.h) but for those of the
 * level debug, which are for who asks for each. A thread of its own writes them (log_ring.h), so
 * that who logs never waits for who reads.
 */
#ifndef SRV_LOG_H
#define SRV_LOG_H

#include <stdbool.h>

#include "ops/log_bound.h"
#include "ops/log_ring.h"
#include "sp/log.h"

enum srv_log_format { SRV_LOG_TEXT, SRV_LOG_LOGFMT, SRV_LOG_JSON, SRV_LOG_FORMATS };

struct srv_log {
    enum srv_log_format format;
    struct srv_log_bound bound;
    struct srv_log_ring ring;
};

/* "text", "logfmt", "json"; SRV_LOG_FORMATS = none of them. */
enum srv_log_format srv_log_format_from(const char *name);
/* "error", "warn", "info", "debug"; false = none of them. */
bool srv_log_level_from(const char *name, enum sp_log_level *level);

/* Makes it the log's sink; it must live as long as the program. The writing thread inherits the
 * mask of signals. */
bool srv_log_start(struct srv_log *log, enum sp_log_level level, enum srv_log_format format,
                   struct sp_error *err);
/* Tells how many lines were left out or lost, if none came after them that could say so. Any
 * thread, now and then; INFINITY: the last time. */
void srv_log_tick(struct srv_log *log, double now_ms);
/* The last lines have SRV_LOG_END_MS to be written; none may follow. */
#define SRV_LOG_END_MS 1000.0
void srv_log_end(struct srv_log *log);

/* One line, with its newline, as it is written; `line` and values of fields may hold any bytes. Cut
 * to fit. Returns the number of bytes. */
unsigned srv_log_line(enum srv_log_format format, const char *stamp, enum sp_log_level level,
                      const struct sp_log_field *fields, const char *line, char out[SRV_LOG_LINE]);

#endif
