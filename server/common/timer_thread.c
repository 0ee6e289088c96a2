/* SPDX-License-Identifier: Apache-2.0 */
#include "common/timer_thread.h"

#include <math.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"

struct srv_timer_thread {
    pthread_t id;
    pthread_mutex_t mutex;
    pthread_cond_t changed;     /* a task was added, or the thread is to stop */
    struct srv_timer_heap heap; /* guarded by mutex */
    bool stop;                  /* guarded by mutex */
};

static void *timer_main(void *user) {
    struct srv_timer_thread *thread = user;
    pthread_mutex_lock(&thread->mutex);
    while (!thread->stop) {
        double next_ms = srv_timer_next(&thread->heap);
        struct srv_timer_task *task = srv_timer_pop(&thread->heap, srv_clock_ms());
        if (task) {
            pthread_mutex_unlock(&thread->mutex);
            next_ms = task->run(task->user, srv_clock_ms());
            pthread_mutex_lock(&thread->mutex);
            srv_timer_set(&thread->heap, &task->timer, next_ms);
        } else if (next_ms == INFINITY) {
            pthread_cond_wait(&thread->changed, &thread->mutex);
        } else {
            struct timespec until = srv_clock_at(next_ms);
            pthread_cond_timedwait(&thread->changed, &thread->mutex, &until);
        }
    }
    pthread_mutex_unlock(&thread->mutex);
    return NULL;
}

struct srv_timer_thread *srv_timer_thread_create(struct sp_error *err) {
    struct srv_timer_thread *thread = calloc(1, sizeof *thread);
    if (!thread) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the timer thread");
        return NULL;
    }
    pthread_mutex_init(&thread->mutex, NULL);
    srv_clock_cond_init(&thread->changed);
    int code = pthread_create(&thread->id, NULL, timer_main, thread);
    if (code == 0)
        return thread;
    sp_fail(err, SP_ERR_IO, NULL, "cannot start the timer thread: %s", strerror(code));
    pthread_cond_destroy(&thread->changed);
    pthread_mutex_destroy(&thread->mutex);
    free(thread);
    return NULL;
}

void srv_timer_thread_add(struct srv_timer_thread *thread, struct srv_timer_task *task,
                          double at_ms) {
    pthread_mutex_lock(&thread->mutex);
    task->timer.of = task;
    srv_timer_set(&thread->heap, &task->timer, at_ms);
    pthread_cond_signal(&thread->changed);
    pthread_mutex_unlock(&thread->mutex);
}

void srv_timer_thread_destroy(struct srv_timer_thread **thread_pointer) {
    struct srv_timer_thread *thread = *thread_pointer;
    *thread_pointer = NULL;
    if (!thread)
        return;
    pthread_mutex_lock(&thread->mutex);
    thread->stop = true;
    pthread_cond_signal(&thread->changed);
    pthread_mutex_unlock(&thread->mutex);
    pthread_join(thread->id, NULL);
    pthread_cond_destroy(&thread->changed);
    pthread_mutex_destroy(&thread->mutex);
    free(thread);
}
