/* SPDX-License-Identifier: Apache-2.0 */
#include "http/refusals.h"

#include <stdarg.h>
#include <stdio.h>

#include "sp/log.h"

#define PAUSE_MS 1000.0

void srv_refused(struct srv_refusals *refusals, enum srv_refusal_reason reason, double now_ms,
                 const char *format, ...) {
    if (!refusals)
        return;
    srv_metrics_add(refusals->metrics, SRV_COUNT_REFUSED_FULL + reason, 1);
    double next_ms = atomic_load(&refusals->reasons[reason].next_ms);
    /* Of several threads one has the line. */
    if (now_ms < next_ms || !atomic_compare_exchange_strong(&refusals->reasons[reason].next_ms,
                                                            &next_ms, now_ms + PAUSE_MS)) {
        atomic_fetch_add(&refusals->reasons[reason].left_out, 1);
        return;
    }
    char line[256];
    va_list args;
    va_start(args, format);
    vsnprintf(line, sizeof line, format, args);
    va_end(args);
    /* Ports are scanned every day. */
    enum sp_log_level level = reason == SRV_REFUSED_TLS ? SP_LOG_INFO : SP_LOG_WARN;
    unsigned left_out = atomic_exchange(&refusals->reasons[reason].left_out, 0);
    if (left_out > 0)
        sp_log(level, "%s; %u more like it since the last such line", line, left_out);
    else
        sp_log(level, "%s", line);
}
