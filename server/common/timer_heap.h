/* SPDX-License-Identifier: Apache-2.0
 *
 * Timers: finds the expired ones without visiting the others. A pairing heap (Fredman,
 * Sedgewick, Sleator and Tarjan 1986). The nodes are members of the caller's objects, so nothing is
 * allocated. set() takes constant time; pop() and clear() take amortised O(log n).
 *
 * An object whose deadline moves with every use need not move its timer each time. Set the timer
 * once; the code that takes it compares the time with the real deadline and sets the timer again.
 *
 * `at` may be any increasing quantity, not only time. Not thread-safe: the caller holds its own
 * lock.
 *
 * Why not a library: GLib's and libuv's timers bring their own event loop and clock, and the tests
 * of this daemon need virtual time.
 */
#ifndef SRV_COMMON_TIMER_HEAP_H
#define SRV_COMMON_TIMER_HEAP_H

#include <stdbool.h>

struct srv_timer { /* zeroed except for `of`: not set */
    void *of;      /* the caller's object, which srv_timer_pop() returns */
    double at;
    bool is_set;
    struct srv_timer *child, *next; /* first child; next sibling */
    struct srv_timer *before;       /* previous sibling; of the first child, the parent */
};

struct srv_timer_heap { /* zeroed: empty */
    struct srv_timer *first;
};

/* Sets the timer, or moves it if it is set. INFINITY clears it. */
void srv_timer_set(struct srv_timer_heap *heap, struct srv_timer *timer, double at);
/* Sets the timer, or moves it if it is set for a later time than `at`. */
void srv_timer_set_by(struct srv_timer_heap *heap, struct srv_timer *timer, double at);
void srv_timer_clear(struct srv_timer_heap *heap, struct srv_timer *timer);
/* Clears the earliest timer and returns its object. NULL = no timer is set for `now` or earlier. */
void *srv_timer_pop(struct srv_timer_heap *heap, double now);
/* Returns the earliest time; INFINITY = no timer is set. */
double srv_timer_next(const struct srv_timer_heap *heap);

#endif
