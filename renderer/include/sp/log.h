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

enum sp_log_level { SP_LOG_ERROR, SP_LOG_WARN, SP_LOG_INFO, SP_LOG_DEBUG };

/* Called from any thread, one complete line without newline; must not block for long. */
typedef void sp_log_sink(void *user, enum sp_log_level level, const char *line);

/* Sets the sink (NULL = standard error) and the most detailed level kept. Not thread-safe: call it
 * once, first. `user` must outlive every other call. Default: standard error, SP_LOG_INFO. */
void sp_log_init(sp_log_sink *sink, void *user, enum sp_log_level level);

/* Thread-safe, at any time. */
void sp_log_set_level(enum sp_log_level level);

/* Thread-safe. Lines are cut at 1,023 bytes. */
__attribute__((format(printf, 2, 3))) void sp_log(enum sp_log_level level, const char *format, ...);

#endif
