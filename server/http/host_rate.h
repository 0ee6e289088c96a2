/* SPDX-License-Identifier: Apache-2.0
 *
 * How often each host may do something: so many a second, and after a while without any those of
 * SRV_RATE_SECONDS at once. Remembers the hosts that did most of late, with no clock of its own.
 * For one thread.
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
        double free_ms; /* when it owes nothing any more */
    } hosts[SRV_RATE_HOSTS];
};

/* May this host, now? If so it is counted. */
bool srv_host_rate_take(struct srv_host_rate *rate, const struct sockaddr_storage *host,
                        double now_ms);

#endif
