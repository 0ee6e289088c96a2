/* SPDX-License-Identifier: Apache-2.0 */
#include "base/clock.h"

#include <time.h>

static double read_ms(clockid_t id) {
    struct timespec t;
    clock_gettime(id, &t);
    return (double)t.tv_sec * 1e3 + (double)t.tv_nsec * 1e-6;
}

double sp_clock_ms(void) {
    return read_ms(CLOCK_MONOTONIC);
}

double sp_clock_cpu_ms(void) {
    return read_ms(CLOCK_PROCESS_CPUTIME_ID);
}
