/* SPDX-License-Identifier: Apache-2.0
 *
 * Log lines on standard error: time=2026-01-31T12:00:00.123Z level=info msg="volume engine loaded".
 * While `capture` is on, lines that tell of a refused backend are kept, for /readyz.
 */
#ifndef SRV_LOG_H
#define SRV_LOG_H

#include <stdbool.h>

#include "sp/log.h"

enum { SRV_LOG_REFUSALS = 8, SRV_LOG_REFUSAL_BYTES = 512 };

struct srv_log {
    bool capture; /* only while there is one thread */
    unsigned refusal_count;
    char refusals[SRV_LOG_REFUSALS][SRV_LOG_REFUSAL_BYTES];
};

/* Makes it the log's sink; it must live as long as the program. `level`: error, warn, info, debug.
 */
void srv_log_init(struct srv_log *log, const char *level);

#endif
