/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SRV_COMMON_CLOCK_H
#define SRV_COMMON_CLOCK_H

#include <pthread.h>
#include <time.h>

/* Returns the time of the monotonic clock, milliseconds. Thread-safe. */
static inline double srv_clock_ms(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec * 1e3 + (double)t.tv_nsec * 1e-6;
}

/* Returns the time of day since 1970 in UTC, for dates that people and certificates name. It may
 * jump: nothing waits for it. Thread-safe. */
static inline struct timespec srv_clock_date(void) {
    struct timespec t;
    clock_gettime(CLOCK_REALTIME, &t);
    return t;
}

/* Initialises a condition that waits on the clock of srv_clock_ms(). */
static inline void srv_clock_cond_init(pthread_cond_t *condition) {
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(condition, &monotonic);
    pthread_condattr_destroy(&monotonic);
}

/* Converts a time of srv_clock_ms() for pthread_cond_timedwait() on such a condition. */
static inline struct timespec srv_clock_at(double ms) {
    struct timespec t = { .tv_sec = (time_t)(ms / 1e3) };
    t.tv_nsec = (long)((ms - (double)t.tv_sec * 1e3) * 1e6);
    return t;
}

#endif
