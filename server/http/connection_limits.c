/* SPDX-License-Identifier: Apache-2.0 */
#include "http/connection_limits.h"

#include <stdarg.h>
#include <stddef.h>
#include <sys/resource.h>

#include "http/address.h"
#include "sp/log.h"

/* File descriptors. */

/* File descriptors per connection. With TLS: the client socket and a socket pair (tls.h). */
static int64_t each(const struct srv_config *config) {
    return config->tls_cert ? 3 : 1;
}

/* File descriptors that `connections` connections and the rest of the process need. */
static int64_t descriptors_for(const struct srv_config *config, int64_t connections) {
    int64_t all = connections + SRV_SPARE_CONNECTIONS * config->http_threads;
    return all * each(config) + (config->tls_cert ? config->handshakes : 0) + SRV_OTHER_DESCRIPTORS;
}

int64_t srv_descriptors_fit(const struct srv_config *config) {
    int64_t wanted = descriptors_for(config, config->connections);
    struct rlimit limit;
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur >= (rlim_t)wanted)
        return config->connections;
    limit.rlim_cur = limit.rlim_max < (rlim_t)wanted ? limit.rlim_max : (rlim_t)wanted;
    if (setrlimit(RLIMIT_NOFILE, &limit) != 0)
        getrlimit(RLIMIT_NOFILE, &limit);
    if (limit.rlim_cur >= (rlim_t)wanted)
        return config->connections;
    int64_t fitting = ((int64_t)limit.rlim_cur - descriptors_for(config, 0)) / each(config);
    fitting = fitting < 1 ? 1 : fitting;
    sp_log(
        SP_LOG_WARN,
        "--connections lowered from %lld to %lld: it needs %lld file descriptors and the limit is "
        "%llu; raise ulimit -n, or LimitNOFILE= of the service",
        (long long)config->connections, (long long)fitting, (long long)wanted,
        (unsigned long long)limit.rlim_cur);
    return fitting;
}

/* Rate per host. */

/* Returns the entry of the host, or the entry to replace: its quota is full before all others. */
static size_t find_host(const struct srv_host_rate *rate, const struct sockaddr *host) {
    size_t least = 0;
    for (size_t i = 0; i < SRV_RATE_HOSTS; i++) {
        if (srv_address_same_host((const struct sockaddr *)&rate->hosts[i].host, host))
            return i;
        if (rate->hosts[i].free_ms < rate->hosts[least].free_ms)
            least = i;
    }
    return least;
}

bool srv_host_rate_spend(struct srv_host_rate *rate, const struct sockaddr_storage *host,
                         double now_ms) {
    if (rate->per_second <= 0)
        return true;
    size_t i = find_host(rate, (const struct sockaddr *)host);
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

/* Refusals. */

void srv_connection_refused(struct srv_metrics *metrics, enum srv_refusal_reason reason,
                            const char *format, ...) {
    va_list args;
    srv_metrics_add(metrics, SRV_COUNT_REFUSED_FULL + reason, 1);
    va_start(args, format);
    /* Failed handshakes are normal: port scanners cause many. */
    sp_log_args(reason == SRV_REFUSED_TLS ? SP_LOG_INFO : SP_LOG_WARN, format, args);
    va_end(args);
}
