/* SPDX-License-Identifier: Apache-2.0
 *
 * Creates, connects and stops the parts of the daemon: catalog → render pool → sessions → streams →
 * HTTP.
 */
#ifndef SRV_DAEMON_H
#define SRV_DAEMON_H

#include "config/config.h"
#include "config/secret.h"
#include "ops/log.h"
#include "sp/status.h"

struct srv_daemon;

/* Starts all parts and listens; the volumes of `config` load in the background. `config` and `log`
 * must outlive the daemon. NULL with *err set. */
struct srv_daemon *srv_daemon_start(const struct srv_config *config, struct srv_log *log,
                                    struct sp_error *err);
enum { SRV_DAEMON_URL_BYTES = 512 };
/* Writes address i of the daemon, TCP first: "http://127.0.0.1:8080/?token=…" or
 * "http+unix://%2Frun%2Fsplatd/?token=…", whose host is the path of the Unix socket. Without the
 * token if it came from --token-file. False: it has no such address. */
bool srv_daemon_url(const struct srv_daemon *daemon, unsigned i, char *url, size_t size);
/* Reloads what may change while the daemon runs (config/README.md). If something cannot be read,
 * the log says so and the old configuration stays. */
void srv_daemon_reload(struct srv_daemon *daemon, const struct srv_config *fresh);
/* Returns when the timer thread last ran, ms of srv_clock_ms(). It takes the lock of the sessions,
 * so a deadlock stops it, and the watchdog notices. Any thread. */
double srv_daemon_last_tick_ms(const struct srv_daemon *daemon);
/* Notifies clients, finishes requests within --drain-time, stops all threads and frees everything.
 */
void srv_daemon_stop(struct srv_daemon **daemon);

#endif
