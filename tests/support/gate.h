/* SPDX-License-Identifier: Apache-2.0
 *
 * A gate in the way of a daemon's thread: what arrives waits there until the test lets it through
 * or its cancel flag is set, so that "while it is being drawn" is a state, not a moment. Whoever
 * has the linker put something in the place of a function calls gate_pass() from there.
 */
#ifndef TESTS_SUPPORT_GATE_H
#define TESTS_SUPPORT_GATE_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>

struct gate { /* guarded by the mutex, as are the test's own counters */
    pthread_mutex_t mutex;
    unsigned entered; /* counted by the test */
    unsigned cancelled, passes;
};
extern struct gate gate;

void gate_reset(void); /* its counters are 0 */
/* False: it was cancelled. `look`, if not NULL, is called again and again meanwhile. */
bool gate_pass(const atomic_bool *cancel, void (*look)(void *user), void *user);
void gate_let_through(unsigned count);

/* A counter's value; and until it has that value, or a higher one. */
unsigned gate_count(const unsigned *counter);
void gate_await(const unsigned *counter, unsigned value);

#endif
