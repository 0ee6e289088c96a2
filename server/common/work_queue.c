/* SPDX-License-Identifier: Apache-2.0 */
#include "common/work_queue.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

struct srv_work_queue {
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    struct srv_work *first, **last; /* last: where the next one goes */
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
    for (struct srv_work *work; (work = take(user));)
        work->run(work);
    return NULL;
}

struct srv_work_queue *srv_work_queue_create(struct sp_error *err) {
    struct srv_work_queue *queue = calloc(1, sizeof *queue);
    if (!queue) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a thread");
        return NULL;
    }
    queue->last = &queue->first;
    pthread_mutex_init(&queue->mutex, NULL);
    pthread_cond_init(&queue->changed, NULL);
    int failed = pthread_create(&queue->thread, NULL, run, queue);
    if (!failed)
        return queue;
    sp_fail(err, SP_ERR_IO, NULL, "cannot start the disk thread: %s", strerror(failed));
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
        pthread_cond_signal(&queue->changed);
    }
    pthread_mutex_unlock(&queue->mutex);
    if (is_ended)
        work->run(work);
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
