/* SPDX-License-Identifier: Apache-2.0
 *
 * The parts of the daemon, wired: catalog → scheduler → sessions → streams → HTTP.
 */
#ifndef SRV_DAEMON_H
#define SRV_DAEMON_H

#include "config/config.h"
#include "config/secret.h"
#include "ops/log.h"
#include "sp/status.h"

struct srv_daemon;

/* Starts everything and listens; the volumes of `config` load from then on. Both arguments must
 * outlive it. NULL with *err set. */
struct srv_daemon *srv_daemon_start(const struct srv_config *config, struct srv_log *log,
                                    struct sp_error *err);
/* "http://127.0.0.1:8080/?token=…"; without the token if that came from a file. */
void srv_daemon_url(const struct srv_daemon *daemon, char *url, size_t size);
/* Reads again what may change while the daemon runs (README.md). What cannot be read is said in the
 * log and stays as it was. */
void srv_daemon_reload(struct srv_daemon *daemon, const struct srv_config *fresh);
/* When its stream thread, which takes all of the sessions' lock in turn, was last seen to go round:
 * ms of the monotonic clock. Any thread. */
double srv_daemon_alive_ms(const struct srv_daemon *daemon);
/* Tells clients, answers what is under way within --drain-time, stops all threads, frees all. */
void srv_daemon_stop(struct srv_daemon **daemon);

#endif
