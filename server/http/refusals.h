/* SPDX-License-Identifier: Apache-2.0
 *
 * Counts refused connections and logs them, up to the limit of log_limit.h. Thread-safe.
 */
#ifndef SRV_HTTP_REFUSALS_H
#define SRV_HTTP_REFUSALS_H

#include "ops/metrics.h"

enum srv_refusal_reason {                      /* same order as SRV_COUNT_REFUSED_… */
                          SRV_REFUSED_FULL,    /* --connections, or no memory or descriptors for one
                                                  more */
                          SRV_REFUSED_ADDRESS, /* --connections-per-address */
                          SRV_REFUSED_HANDSHAKE, /* --handshakes, --handshake-rate */
                          SRV_REFUSED_TLS        /* the handshake failed */
};

__attribute__((format(printf, 3, 4))) void srv_connection_refused(struct srv_metrics *metrics,
                                                                  enum srv_refusal_reason reason,
                                                                  const char *format, ...);

#endif
