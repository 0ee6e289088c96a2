/* SPDX-License-Identifier: Apache-2.0
 *
 * A rate limit per host: per_second events, with bursts of SRV_RATE_SECONDS' worth after a pause.
 * Remembers the SRV_RATE_HOSTS most active hosts. Has no clock of its own. For one thread.
 */
#ifndef SRV_HTTP_HOST_RATE_H
#define SRV_HTTP_HOST_RATE_H

#include <stdbool.h>
#include <sys/socket.h>

enum { SRV_RATE_HOSTS = 256, SRV_RATE_SECONDS = 16 };

struct srv_host_rate { /* zeros but for per_second */
    double per_second; /* 0 = any number */
    struct {
        struct sockaddr_storage host;
        double free_ms; /* when its quota is full again */
    } hosts[SRV_RATE_HOSTS];
};

/* Takes one event from the quota of the host. False: the quota is used up. */
bool srv_host_rate_take(struct srv_host_rate *rate, const struct sockaddr_storage *host,
                        double now_ms);

#endif
