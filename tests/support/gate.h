/* SPDX-License-Identifier: Apache-2.0
 *
 * A gate that stops a thread of the daemon: a thread waits there until the test lets it through or
 * its cancel flag is set, so that "while it is being rendered" is a state that the test controls.
 * The test calls gate_pass() from a function that the linker puts in the place of another.
 */
#ifndef TESTS_SUPPORT_GATE_H
#define TESTS_SUPPORT_GATE_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>

struct gate { /* all guarded by the mutex, as are the test's own counters */
    pthread_mutex_t mutex;
    unsigned entered; /* counted by the test */
    unsigned cancelled, passes;
};
extern struct gate gate;

void gate_reset(void); /* sets the counters to 0 */
/* Waits at the gate. Returns false if *cancel was set. Calls `look` (may be NULL) while waiting. */
bool gate_pass(const atomic_bool *cancel, void (*look)(void *user), void *user);
void gate_let_through(unsigned count);

/* Reads a counter; waits until it is at least `value`. */
unsigned gate_count(const unsigned *counter);
void gate_await(const unsigned *counter, unsigned value);

#endif
