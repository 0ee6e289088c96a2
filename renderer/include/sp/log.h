/* SPDX-License-Identifier: Apache-2.0
 *
 * The log. A level is defined by its consequence:
 *   ERROR  a request was not carried out; an operator must act
 *   WARN   a request was carried out, but not as asked or only just; an operator should look
 *   INFO   a state change that an operator wants to see once (started, loaded, stopped)
 *   DEBUG  one line per request or frame; off in operation
 * A line names the peer or volume, the limit and the value. The sink is the only global state of
 * the library. Set it once, before other threads start; without a sink, lines go to standard error
 * as `LEVEL text`.
 */
#ifndef SP_LOG_H
#define SP_LOG_H

#include <stdarg.h>
#include <stddef.h>

#include "sp/api.h"

#ifdef __cplusplus
extern "C" {
#endif

enum sp_log_level { SP_LOG_ERROR, SP_LOG_WARN, SP_LOG_INFO, SP_LOG_DEBUG };

/* The subject of a line, so that logs can be filtered by it: {"volume", "engine"}. */
struct sp_log_field {
    const char *key;   /* constant string of lower-case letters; NULL ends a list of fields */
    const char *value; /* borrowed for the call; may hold any bytes but 0 */
};

/* Receives one complete line without a newline. Any thread may call it; it must not block for long.
 * `kind` is the constant format string of the line. `fields` is never NULL. The line also contains
 * the values of the fields. All pointers are valid during the call only. */
typedef void sp_log_sink(void *user, enum sp_log_level level, const char *kind,
                         const struct sp_log_field *fields, const char *line);

/* Sets the sink (NULL = standard error, the default) and the most detailed level that is written
 * (default SP_LOG_INFO). Not thread-safe: call it before any other function of the library. `user`
 * is passed to the sink and must outlive every other call. */
SP_API void sp_log_init(sp_log_sink *sink, void *user, enum sp_log_level level);

/* Sets the most detailed level that is written. Thread-safe, at any time. */
SP_API void sp_log_set_level(enum sp_log_level level);

/* Writes one line. Lines are cut at 1,023 bytes; control characters become '?'. Thread-safe. */
SP_API SP_PRINTF(2, 3) void sp_log(enum sp_log_level level, const char *format, ...);
SP_API SP_PRINTF(2, 0) void sp_log_args(enum sp_log_level level, const char *format, va_list args);

/* Writes one line with fields:
 *   sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "volume", id }), "volume %s loaded", id);
 * Fields are borrowed for the call. Thread-safe. SP_LOG_FIELDS is for C only. */
SP_API SP_PRINTF(3, 4) void sp_log_with(enum sp_log_level level, const struct sp_log_field *fields,
                                        const char *format, ...);
#define SP_LOG_FIELDS(...) ((const struct sp_log_field[]){ __VA_ARGS__, { NULL, NULL } })

#ifdef __cplusplus
}
#endif

#endif
