/* SPDX-License-Identifier: Apache-2.0
 *
 * The log. Levels are defined by their consequence:
 *   ERROR  something asked for was not done; somebody must act
 *   WARN   it was done, but not as asked or only just; somebody should look
 *   INFO   state changes that an operator wants to see once (started, loaded, stopped)
 *   DEBUG  a line a request or frame; off in operation
 * A line names the peer or volume, the limit and the value. The sink is global and set once before
 * other threads start; without one, lines go to standard error as `LEVEL text`.
 */
#ifndef SP_LOG_H
#define SP_LOG_H

#include <stdarg.h>
#include <stddef.h>

enum sp_log_level { SP_LOG_ERROR, SP_LOG_WARN, SP_LOG_INFO, SP_LOG_DEBUG };

/* What a line speaks of, for logs that are filtered by it: {"volume", "engine"}. The key is a
 * constant of lower-case letters; a list ends with a key of NULL. */
struct sp_log_field {
    const char *key, *value;
};

/* Called from any thread, one complete line without newline, which says all that the fields say;
 * must not block for long. kind: the format that it was made with, a constant. fields is never
 * NULL; values may hold any bytes. */
typedef void sp_log_sink(void *user, enum sp_log_level level, const char *kind,
                         const struct sp_log_field *fields, const char *line);

/* Sets the sink (NULL = standard error) and the most detailed level kept. Not thread-safe: call it
 * once, first. `user` must outlive every other call. Default: standard error, SP_LOG_INFO. */
void sp_log_init(sp_log_sink *sink, void *user, enum sp_log_level level);

/* Thread-safe, at any time. */
void sp_log_set_level(enum sp_log_level level);

/* Thread-safe. Lines are cut at 1,023 bytes. */
__attribute__((format(printf, 2, 3))) void sp_log(enum sp_log_level level, const char *format, ...);

__attribute__((format(printf, 2, 0))) void sp_log_args(enum sp_log_level level, const char *format,
                                                       va_list args);

/* The same with fields: sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "volume", id }), "volume %s …",
 * id). They need live no longer than the call. */
__attribute__((format(printf, 3, 4))) void
sp_log_with(enum sp_log_level level, const struct sp_log_field *fields, const char *format, ...);
#define SP_LOG_FIELDS(...) ((const struct sp_log_field[]){ __VA_ARGS__, { NULL, NULL } })

#endif
