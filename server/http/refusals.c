/* SPDX-License-Identifier: Apache-2.0 */
#include "http/refusals.h"

#include <stdarg.h>

#include "sp/log.h"

void srv_connection_refused(struct srv_metrics *metrics, enum srv_refusal_reason reason,
                            const char *format, ...) {
    va_list args;
    srv_metrics_add(metrics, SRV_COUNT_REFUSED_FULL + reason, 1);
    va_start(args, format);
    /* Failed handshakes are normal: port scanners cause many. */
    sp_log_args(reason == SRV_REFUSED_TLS ? SP_LOG_INFO : SP_LOG_WARN, format, args);
    va_end(args);
}
