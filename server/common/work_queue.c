/* SPDX-License-Identifier: Apache-2.0 */
#include "common/work_queue.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "common/background.h"

struct srv_work_queue {
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    struct srv_work *first, **last; /* last: where the next one goes */
    unsigned count;                 /* waiting, and running */
    const char *background;
    bool stop;
    bool is_ended; /* the thread takes no more work */
    bool is_joined;
    pthread_t thread;
};

/* Takes the first work, waiting for it. NULL: the queue is empty and stopped. */
static struct srv_work *take(struct srv_work_queue *queue) {
    pthread_mutex_lock(&queue->mutex);
    while (!queue->first && !queue->stop)
        pthread_cond_wait(&queue->changed, &queue->mutex);
    struct srv_work *work = queue->first;
    if (work)
        queue->first = work->next;
    if (!queue->first)
        queue->last = &queue->first;
    queue->is_ended = !work;
    pthread_mutex_unlock(&queue->mutex);
    return work;
}

static void *run(void *user) {
    struct srv_work_queue *queue = user;
    if (queue->background)
        srv_background_thread_enter(queue->background);
    for (struct srv_work *work; (work = take(queue));) {
        work->run(work);
        pthread_mutex_lock(&queue->mutex);
        queue->count--;
        pthread_mutex_unlock(&queue->mutex);
    }
    return NULL;
}

struct srv_work_queue *srv_work_queue_create(const char *background, struct sp_error *err) {
    struct srv_work_queue *queue = calloc(1, sizeof *queue);
    if (!queue) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a thread");
        return NULL;
    }
    queue->last = &queue->first;
    queue->background = background;
    pthread_mutex_init(&queue->mutex, NULL);
    pthread_cond_init(&queue->changed, NULL);
    int failed = pthread_create(&queue->thread, NULL, run, queue);
    if (!failed)
        return queue;
    sp_fail(err, SP_ERR_IO, NULL, "cannot start a thread: %s", strerror(failed));
    pthread_cond_destroy(&queue->changed);
    pthread_mutex_destroy(&queue->mutex);
    free(queue);
    return NULL;
}

void srv_work_queue_add(struct srv_work_queue *queue, struct srv_work *work) {
    work->next = NULL;
    pthread_mutex_lock(&queue->mutex);
    bool is_ended = queue->is_ended;
    if (!is_ended) {
        *queue->last = work;
        queue->last = &work->next;
        queue->count++;
        pthread_cond_signal(&queue->changed);
    }
    pthread_mutex_unlock(&queue->mutex);
    if (is_ended)
        work->run(work);
}

unsigned srv_work_queue_count(struct srv_work_queue *queue) {
    pthread_mutex_lock(&queue->mutex);
    const unsigned count = queue->count;
    pthread_mutex_unlock(&queue->mutex);
    return count;
}

void srv_work_queue_stop(struct srv_work_queue *queue) {
    if (queue->is_joined)
        return;
    pthread_mutex_lock(&queue->mutex);
    queue->stop = true;
    pthread_cond_signal(&queue->changed);
    pthread_mutex_unlock(&queue->mutex);
    pthread_join(queue->thread, NULL);
    queue->is_joined = true;
}

void srv_work_queue_destroy(struct srv_work_queue **queue_pointer) {
    struct srv_work_queue *queue = *queue_pointer;
    *queue_pointer = NULL;
    if (!queue)
        return;
    srv_work_queue_stop(queue);
    pthread_cond_destroy(&queue->changed);
    pthread_mutex_destroy(&queue->mutex);
    free(queue);
}
