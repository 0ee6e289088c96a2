/* SPDX-License-Identifier: Apache-2.0
 *
 * A rate limit per host: per_second events per second, with bursts of up to SRV_RATE_SECONDS times
 * as many after a pause. Remembers the SRV_RATE_HOSTS most active hosts. The caller passes the
 * time. For one thread.
 */
#ifndef SRV_HTTP_HOST_RATE_H
#define SRV_HTTP_HOST_RATE_H

#include <stdbool.h>
#include <sys/socket.h>

enum { SRV_RATE_HOSTS = 256, SRV_RATE_SECONDS = 16 };

struct srv_host_rate { /* all other members start at zero */
    double per_second; /* 0 = no limit */
    struct {
        struct sockaddr_storage host;
        double free_ms; /* when the quota of the host is full again */
    } hosts[SRV_RATE_HOSTS];
};

/* Takes one event from the quota of the host. False: the quota is used up. */
bool srv_host_rate_take(struct srv_host_rate *rate, const struct sockaddr_storage *host,
                        double now_ms);

#endif
