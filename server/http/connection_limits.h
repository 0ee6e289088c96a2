/* SPDX-License-Identifier: Apache-2.0
 *
 * Limits of connections: how many the file descriptors allow, how often a host may connect, and how
 * a refused connection is reported.
 */
#ifndef SRV_HTTP_CONNECTION_LIMITS_H
#define SRV_HTTP_CONNECTION_LIMITS_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/socket.h>

#include "config/config.h"
#include "ops/metrics.h"

/* File descriptors. Without a descriptor a connection would wait in the system's backlog without an
 * answer. The daemon therefore accepts only as many connections as it can answer, and refuses the
 * rest as beyond --connections. */
enum {
    SRV_SPARE_CONNECTIONS = 64, /* per HTTP thread beyond --connections, to answer 503 */
    SRV_OTHER_DESCRIPTORS = 128 /* threads, database, volumes being loaded, files of camera paths */
};

/* Raises the limit of the process (RLIMIT_NOFILE) as far as the settings need and the system
 * allows. Returns the number of connections that fit, in [1, --connections]; logs a warning if it
 * is lower than --connections. */
int64_t srv_descriptors_fit(const struct srv_config *config);

/* A rate limit per host: per_second events per second, with bursts of up to SRV_RATE_SECONDS times
 * as many after a pause. Remembers the SRV_RATE_HOSTS most active hosts. The caller passes the
 * time. For one thread. */
enum { SRV_RATE_HOSTS = 256, SRV_RATE_SECONDS = 16 };
struct srv_host_rate { /* all other members start at zero */
    double per_second; /* 0 = no limit */
    struct {
        struct sockaddr_storage host;
        double free_ms; /* when the quota of the host is full again */
    } hosts[SRV_RATE_HOSTS];
};

/* Takes one event from the quota of the host. False: the quota is used up. */
bool srv_host_rate_spend(struct srv_host_rate *rate, const struct sockaddr_storage *host,
                         double now_ms);

/* In the order of SRV_COUNT_REFUSED_…. */
enum srv_refusal_reason {
    SRV_REFUSED_FULL,      /* --connections, or no memory or descriptors for one more */
    SRV_REFUSED_ADDRESS,   /* --connections-per-address */
    SRV_REFUSED_OWNER,     /* the share of a token in --connections */
    SRV_REFUSED_HANDSHAKE, /* --handshakes, --handshake-rate */
    SRV_REFUSED_TLS        /* the handshake failed */
};

/* Counts a refused connection and logs it, up to the limit of ops/log_limit.h. Thread-safe. */
__attribute__((format(printf, 3, 4))) void srv_connection_refused(struct srv_metrics *metrics,
                                                                  enum srv_refusal_reason reason,
                                                                  const char *format, ...);

#endif
