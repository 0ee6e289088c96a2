/* SPDX-License-Identifier: Apache-2.0
 *
 * How much of one kind the log takes: SRV_LOG_AT_ONCE lines, and from then on one a second, so that
 * nobody fills a disk by doing something over and over. Lines of one kind have the same format.
 * What is left out is counted, and the count is told. Thread-safe; no clock of its own.
 */
#ifndef SRV_LOG_BOUND_H
#define SRV_LOG_BOUND_H

#include <pthread.h>
#include <stdbool.h>

/* Kinds: more than the program has; if there were more, those past the last share its bound. */
enum { SRV_LOG_AT_ONCE = 32, SRV_LOG_KINDS = 256 };

struct srv_log_bound {
    pthread_mutex_t mutex;
    unsigned count;
    struct srv_log_kind {
        const char *name;  /* the format, a constant */
        double full_ms;    /* when it may have SRV_LOG_AT_ONCE at once again */
        unsigned left_out; /* since its last line */
    } kinds[SRV_LOG_KINDS];
};

void srv_log_bound_init(struct srv_log_bound *bound);

/* May a line of this kind, which lives as long as the program, be written? If so *left_out is how
 * many were not since the last one that was. */
bool srv_log_bound_take(struct srv_log_bound *bound, const char *kind, double now_ms,
                        unsigned *left_out);

/* A kind of which lines were left out and that may have one again, by which their number is told;
 * NULL = there is none. now_ms INFINITY: of all kinds. */
const char *srv_log_bound_next(struct srv_log_bound *bound, double now_ms, unsigned *left_out);

#endif
