/* SPDX-License-Identifier: Apache-2.0
 *
 * Writes log lines to standard error in one of three formats (--log-format):
 *
 *   logfmt  time=2026-01-31T12:00:00.123Z level=info volume="engine" msg="volume engine loaded"
 *   json    {"time":"2026-01-31T12:00:00.123Z","level":"info","volume":"engine","msg":"…"}
 *   text    2026-01-31T12:00:00.123Z info volume engine loaded
 *
 * Between level and msg are the fields of the line: volume, session, path or peer. The message
 * contains them as well. The number of lines of one kind is limited (log_limit.h), except for the
 * level debug. A thread of its own writes the lines (log_ring.h), so that no other thread waits for
 * the reader of the log.
 */
#ifndef SRV_OPS_LOG_H
#define SRV_OPS_LOG_H

#include <stdbool.h>

#include "ops/log_limit.h"
#include "ops/log_ring.h"
#include "sp/log.h"

enum srv_log_format { SRV_LOG_TEXT, SRV_LOG_LOGFMT, SRV_LOG_JSON, SRV_LOG_FORMATS };

struct srv_log {
    enum srv_log_format format;
    struct srv_log_limit limit;
    struct srv_log_ring ring;
};

/* Returns the format "text", "logfmt" or "json"; SRV_LOG_FORMATS = unknown name. */
enum srv_log_format srv_log_format_from(const char *name);
/* Reads the level "error", "warn", "info" or "debug"; false = unknown name. */
bool srv_log_level_from(const char *name, enum sp_log_level *level);

/* Makes `log` the sink of sp_log(). It must live as long as the program. The writer thread inherits
 * the caller's signal mask. False: SP_ERR_MEMORY. */
bool srv_log_start(struct srv_log *log, enum sp_log_level level, enum srv_log_format format,
                   struct sp_error *err);
/* Logs how many lines were suppressed or lost, unless a later line has already reported it. Call it
 * regularly from any thread, and once with INFINITY before the end. */
void srv_log_tick(struct srv_log *log, double now_ms);
/* Waits up to SRV_LOG_END_MS until the last lines are written. No line may follow. */
#define SRV_LOG_END_MS 1000.0
void srv_log_end(struct srv_log *log);

/* Formats one line with its newline, cut to SRV_LOG_LINE bytes, and returns its length. `line` and
 * the values of fields may contain any bytes. */
unsigned srv_log_line(enum srv_log_format format, const char *stamp, enum sp_log_level level,
                      const struct sp_log_field *fields, const char *line, char out[SRV_LOG_LINE]);

#endif
