/* SPDX-License-Identifier: Apache-2.0
 *
 * The process and its parent: standard descriptors, and notifications to the service manager that
 * started the daemon (systemd: Type=notify, WatchdogSec=). Without a service manager the
 * notifications do nothing. Main thread only.
 */
#ifndef SRV_OPS_SERVICE_H
#define SRV_OPS_SERVICE_H

#include <stdbool.h>

#include "sp/status.h"

/* Opens /dev/null for each standard descriptor that is closed. Otherwise a connection could get its
 * number and receive log lines. Writing to standard output still fails. Call it first. */
void srv_standard_occupy(void);
/* True if everything printed on standard output was written. SP_ERR_IO. */
bool srv_standard_finish(struct sp_error *err);

/* If `ends` is true, starts a thread that sends SIGTERM to this process when standard input closes;
 * it reads and drops what comes before. The signal must be blocked in all threads that do not wait
 * for it. SP_ERR_MEMORY. */
bool srv_service_watch_input(bool ends, struct sp_error *err);

/* Reports that the daemon is ready: after the start and after each reload. `systemctl status` shows
 * the address. */
void srv_service_ready(const char *listen);
void srv_service_reloading(void);
void srv_service_stopping(void);

/* Returns the interval in which systemd expects srv_service_alive(), ms; 0 = no watchdog. */
double srv_service_watchdog_ms(void);
void srv_service_alive(void);

#endif
