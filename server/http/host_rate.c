/* SPDX-License-Identifier: Apache-2.0 */
#include "http/host_rate.h"

#include <stddef.h>

#include "http/address.h"

/* Returns the entry of the host, or the entry to replace: the one whose quota is full soonest. */
static size_t find(const struct srv_host_rate *rate, const struct sockaddr *host) {
    size_t least = 0;
    for (size_t i = 0; i < SRV_RATE_HOSTS; i++) {
        if (srv_address_same_host((const struct sockaddr *)&rate->hosts[i].host, host))
            return i;
        if (rate->hosts[i].free_ms < rate->hosts[least].free_ms)
            least = i;
    }
    return least;
}

bool srv_host_rate_take(struct srv_host_rate *rate, const struct sockaddr_storage *host,
                        double now_ms) {
    if (rate->per_second <= 0)
        return true;
    size_t i = find(rate, (const struct sockaddr *)host);
    if (!srv_address_same_host((const struct sockaddr *)&rate->hosts[i].host,
                               (const struct sockaddr *)host)) {
        rate->hosts[i].host = *host;
        rate->hosts[i].free_ms = now_ms;
    }
    double free_ms = rate->hosts[i].free_ms < now_ms ? now_ms : rate->hosts[i].free_ms;
    free_ms += 1000 / rate->per_second;
    if (free_ms > now_ms + 1000.0 * SRV_RATE_SECONDS)
        return false;
    rate->hosts[i].free_ms = free_ms;
    return true;
}
