/* SPDX-License-Identifier: Apache-2.0
 *
 * What the daemon tells the service manager that started it (systemd: Type=notify,
 * WatchdogSec=). Without one nothing is told and all of this does nothing. Main thread alone.
 */
#ifndef SRV_SERVICE_H
#define SRV_SERVICE_H

/* At the start, and after each reload. `systemctl status` shows where it listens. */
void srv_service_ready(const char *listen);
void srv_service_reloading(void);
void srv_service_stopping(void);

/* Signs of life are expected this often, ms; 0 = never. */
double srv_service_watchdog_ms(void);
void srv_service_alive(void);

#endif
