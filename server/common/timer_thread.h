/* SPDX-License-Identifier: Apache-2.0
 *
 * The timer thread runs tasks when their time comes: ends of sessions, connection deadlines, pings
 * of event streams, delayed log lines. No other thread waits for a time on behalf of these parts,
 * so that the socket thread only reads and writes sockets.
 *
 *   task ──at_ms──► timer heap ──► run(user, now_ms) ──returns the next time──► timer heap
 *
 * Tasks run one after the other, without a lock of this module. A task may take the locks of its
 * own part, but must not wait for work: all other tasks wait meanwhile.
 */
#ifndef SRV_COMMON_TIMER_THREAD_H
#define SRV_COMMON_TIMER_THREAD_H

#include "common/timer_heap.h"
#include "sp/status.h"

struct srv_timer_thread;

struct srv_timer_task { /* the caller's memory, valid until the thread is destroyed */
    void *user;
    /* Returns when to run again, in ms of srv_clock_ms(); INFINITY = never. */
    double (*run)(void *user, double now_ms);
    struct srv_timer timer; /* zero; the thread's after srv_timer_thread_add() */
};

/* NULL with *err set: SP_ERR_MEMORY, SP_ERR_IO. */
struct srv_timer_thread *srv_timer_thread_create(struct sp_error *err);
/* Runs the task at `at_ms` for the first time. Any thread; once per task. */
void srv_timer_thread_add(struct srv_timer_thread *thread, struct srv_timer_task *task,
                          double at_ms);
/* Waits until the running task ends; no other task runs afterwards. Accepts NULL; nulls. */
void srv_timer_thread_destroy(struct srv_timer_thread **thread);

#endif
