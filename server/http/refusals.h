/* SPDX-License-Identifier: Apache-2.0
 *
 * Connections that are refused. Each is counted; the log tells of one a second for
 * each reason and says how many it left out, so that nobody fills the log by knocking. Thread-safe.
 */
#ifndef SRV_HTTP_REFUSALS_H
#define SRV_HTTP_REFUSALS_H

#include <stdatomic.h>

#include "metrics.h"

enum srv_refusal_reason {                      /* in the order of SRV_COUNT_REFUSED_… */
                          SRV_REFUSED_FULL,    /* --connections, or no memory or descriptors for one
                                                  more */
                          SRV_REFUSED_ADDRESS, /* --connections-per-address */
                          SRV_REFUSED_HANDSHAKE, /* --handshakes */
                          SRV_REFUSED_TLS,       /* no handshake came about */
                          SRV_REFUSAL_REASONS
};

struct srv_refusals { /* zeros but for metrics */
    struct srv_metrics *metrics;
    struct {
        _Atomic double next_ms; /* before that no line */
        atomic_uint left_out;
    } reasons[SRV_REFUSAL_REASONS];
};

/* `refusals` may be NULL, which counts and says nothing. */
__attribute__((format(printf, 4, 5))) void srv_refused(struct srv_refusals *refusals,
                                                       enum srv_refusal_reason reason,
                                                       double now_ms, const char *format, ...);

#endif
