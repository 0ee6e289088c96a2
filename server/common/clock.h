/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SRV_CLOCK_H
#define SRV_CLOCK_H

#include <time.h>

/* Milliseconds of a monotonic clock. Thread-safe. */
static inline double srv_clock_ms(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec * 1e3 + (double)t.tv_nsec * 1e-6;
}

/* The same moment for pthread_cond_timedwait(), of a condition with that clock. */
static inline struct timespec srv_clock_at(double ms) {
    struct timespec t = { .tv_sec = (time_t)(ms / 1e3) };
    t.tv_nsec = (long)((ms - (double)t.tv_sec * 1e3) * 1e6);
    return t;
}

#endif
