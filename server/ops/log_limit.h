/* SPDX-License-Identifier: Apache-2.0
 *
 * Rate limit of log lines per kind: a burst of SRV_LOG_BURST lines, then one line per second. So a
 * client that repeats something for ever cannot fill the disk. Lines with the same format string
 * are one kind. Suppressed lines are counted, and the count is logged. Thread-safe; the caller
 * passes the time.
 */
#ifndef SRV_OPS_LOG_LIMIT_H
#define SRV_OPS_LOG_LIMIT_H

#include <pthread.h>
#include <stdbool.h>

/* SRV_LOG_KINDS is more than the program has. If there were more, the rest would share one limit.
 */
enum { SRV_LOG_BURST = 32, SRV_LOG_KINDS = 256 };

struct srv_log_limit {
    pthread_mutex_t mutex;
    unsigned count;
    struct srv_log_kind {
        const char *name;    /* the format string, a constant */
        double full_ms;      /* when a full burst is available again */
        unsigned suppressed; /* lines since the last one that was written */
    } kinds[SRV_LOG_KINDS];
};

void srv_log_limit_init(struct srv_log_limit *limit);

/* True if a line of this kind may be written; *suppressed is then the number of lines suppressed
 * since the last one. `kind` must live as long as the program. */
bool srv_log_limit_allow(struct srv_log_limit *limit, const char *kind, double now_ms,
                         unsigned *suppressed);

/* Returns a kind that has suppressed lines and may have a line again, which reports their number;
 * NULL = there is none. now_ms INFINITY: also returns kinds that may not have a line yet. */
const char *srv_log_limit_next(struct srv_log_limit *limit, double now_ms, unsigned *suppressed);

#endif
