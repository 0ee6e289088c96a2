/* SPDX-License-Identifier: Apache-2.0 */
#include "support/gate.h"

#include <sched.h>

struct gate gate = { .mutex = PTHREAD_MUTEX_INITIALIZER };

void gate_reset(void) {
    pthread_mutex_lock(&gate.mutex);
    gate.entered = gate.cancelled = gate.passes = 0;
    pthread_mutex_unlock(&gate.mutex);
}

bool gate_pass(const atomic_bool *cancel, void (*look)(void *user), void *user) {
    for (;; sched_yield()) {
        if (look)
            look(user);
        pthread_mutex_lock(&gate.mutex);
        bool cancelled = atomic_load(cancel), go = !cancelled && gate.passes > 0;
        gate.passes -= go;
        gate.cancelled += cancelled;
        pthread_mutex_unlock(&gate.mutex);
        if (go || cancelled)
            return go;
    }
}

void gate_let_through(unsigned count) {
    pthread_mutex_lock(&gate.mutex);
    gate.passes += count;
    pthread_mutex_unlock(&gate.mutex);
}

unsigned gate_count(const unsigned *counter) {
    pthread_mutex_lock(&gate.mutex);
    unsigned value = *counter;
    pthread_mutex_unlock(&gate.mutex);
    return value;
}

void gate_await(const unsigned *counter, unsigned value) {
    while (gate_count(counter) < value)
        sched_yield();
}
