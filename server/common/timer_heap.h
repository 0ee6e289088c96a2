/* SPDX-License-Identifier: Apache-2.0
 *
 * What is due when: of many things that wait for a time, those whose time has come, without a look
 * at the others. A pairing heap (Fredman, Sedgewick, Sleator and Tarjan 1986) of nodes that lie in
 * what waits, so that nothing is allocated: set() takes constant time, take() and clear() the
 * logarithm of how many there are, on the average of many calls.
 *
 * Most times move on again and again, by each use. It is enough to set the first one: when that has
 * come, whoever takes it finds out whether it is time, and sets the next.
 *
 * Instead of a time it may be any number that rises. All of one heap is guarded by its owner.
 */
#ifndef SRV_COMMON_TIMER_HEAP_H
#define SRV_COMMON_TIMER_HEAP_H

#include <stdbool.h>

struct srv_timer { /* zeroed but for `of`: waits for nothing */
    void *of;      /* the caller's: what waits */
    double at;
    bool is_set;
    struct srv_timer *child, *next; /* the first one below it; the next one beside it */
    struct srv_timer *before;       /* the one beside it, or for the first one, above it */
};

struct srv_timer_heap { /* zeroed: empty */
    struct srv_timer *first;
};

/* At another time than before, if it was set already; INFINITY = never: cleared. */
void srv_timer_set(struct srv_timer_heap *dues, struct srv_timer *due, double at);
/* No later than that. */
void srv_timer_set_by(struct srv_timer_heap *dues, struct srv_timer *due, double at);
void srv_timer_clear(struct srv_timer_heap *dues, struct srv_timer *due);
/* What waits for the least time, if that is no later than `now`: it is cleared. NULL = nothing. */
void *srv_timer_take(struct srv_timer_heap *dues, double now);
/* The least time; INFINITY = none is set. */
double srv_timer_next(const struct srv_timer_heap *dues);

#endif
