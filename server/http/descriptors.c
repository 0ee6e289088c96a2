/* SPDX-License-Identifier: Apache-2.0 */
#include "http/descriptors.h"

#include <sys/resource.h>

#include "sp/log.h"

/* File descriptors per connection. With TLS: the client socket and a socket pair (tls.h). */
static int64_t each(const struct srv_config *config) {
    return config->tls_cert ? 3 : 1;
}

int64_t srv_descriptors_for(const struct srv_config *config, int64_t connections) {
    int64_t all = connections + SRV_SPARE_CONNECTIONS * config->http_threads;
    return all * each(config) + (config->tls_cert ? config->handshakes : 0) + SRV_OTHER_DESCRIPTORS;
}

int64_t srv_descriptors_fit(const struct srv_config *config) {
    int64_t wanted = srv_descriptors_for(config, config->connections);
    struct rlimit limit;
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur >= (rlim_t)wanted)
        return config->connections;
    limit.rlim_cur = limit.rlim_max < (rlim_t)wanted ? limit.rlim_max : (rlim_t)wanted;
    if (setrlimit(RLIMIT_NOFILE, &limit) != 0)
        getrlimit(RLIMIT_NOFILE, &limit);
    if (limit.rlim_cur >= (rlim_t)wanted)
        return config->connections;
    int64_t fitting = ((int64_t)limit.rlim_cur - srv_descriptors_for(config, 0)) / each(config);
    fitting = fitting < 1 ? 1 : fitting;
    sp_log(SP_LOG_WARN,
           "%lld connections are allowed, not the %lld of --connections: those need %lld file "
           "descriptors, and the limit is %llu (ulimit -n; LimitNOFILE= of a service)",
           (long long)fitting, (long long)config->connections, (long long)wanted,
           (unsigned long long)limit.rlim_cur);
    return fitting;
}
