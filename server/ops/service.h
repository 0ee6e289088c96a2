/* SPDX-License-Identifier: Apache-2.0
 *
 * Notifications to the service manager that started the daemon (systemd: Type=notify,
 * WatchdogSec=). Without a service manager the functions do nothing. Main thread only.
 */
#ifndef SRV_OPS_SERVICE_H
#define SRV_OPS_SERVICE_H

/* Reports that the daemon is ready: after the start and after each reload. `systemctl status` shows
 * the address. */
void srv_service_ready(const char *listen);
void srv_service_reloading(void);
void srv_service_stopping(void);

/* Returns the interval in which systemd expects srv_service_alive(), ms; 0 = no watchdog. */
double srv_service_watchdog_ms(void);
void srv_service_alive(void);

#endif
