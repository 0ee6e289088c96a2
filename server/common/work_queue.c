/* SPDX-License-Identifier: Apache-2.0 */
#include "common/work_queue.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "common/background.h"
#include "common/clock.h"
#include "common/fair_share.h"

struct srv_work_queue {
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    struct srv_work *first, **last;     /* last: where the next one goes */
    char running[SRV_FAIR_OWNER_BYTES]; /* the owner of the work that runs */
    unsigned count;                     /* waiting, and running */
    struct srv_fair_owners fair;
    const char *name;
    int niceness;
    bool stop;
    bool is_ended; /* the thread takes no more work */
    bool is_joined;
    pthread_t thread;
};

/* Takes the next work out of the list, which has some. */
static struct srv_work *pop_next(struct srv_work_queue *queue) {
    struct srv_work **best = &queue->first;
    double best_ms = srv_fair_owners_start(&queue->fair, (*best)->owner);
    for (struct srv_work **link = &(*best)->next; *link; link = &(*link)->next) {
        const double start_ms = srv_fair_owners_start(&queue->fair, (*link)->owner);
        if (start_ms < best_ms) {
            best = link;
            best_ms = start_ms;
        }
    }
    struct srv_work *work = *best;
    *best = work->next;
    if (queue->last == &work->next)
        queue->last = best;
    return work;
}

/* Takes the next work, waiting for it. NULL: the queue is empty and stopped. */
static struct srv_work *wait_for_work(struct srv_work_queue *queue) {
    pthread_mutex_lock(&queue->mutex);
    while (!queue->first && !queue->stop)
        pthread_cond_wait(&queue->changed, &queue->mutex);
    struct srv_work *work = queue->first ? pop_next(queue) : NULL;
    queue->is_ended = !work;
    if (work) {
        memcpy(queue->running, work->owner, sizeof queue->running);
        srv_fair_owners_begin(&queue->fair, queue->running);
    }
    pthread_mutex_unlock(&queue->mutex);
    return work;
}

static void *run(void *user) {
    struct srv_work_queue *queue = user;
    if (queue->niceness > 0)
        srv_background_thread_enter(queue->name, queue->niceness);
    for (struct srv_work *work; (work = wait_for_work(queue));) {
        const double start_ms = srv_clock_ms();
        work->run(work);
        pthread_mutex_lock(&queue->mutex);
        srv_fair_owners_charge(&queue->fair, queue->running, srv_clock_ms() - start_ms);
        if (--queue->count == 0)
            srv_fair_owners_reset(&queue->fair);
        pthread_mutex_unlock(&queue->mutex);
    }
    return NULL;
}

struct srv_work_queue *srv_work_queue_create(const char *name, int niceness, struct sp_error *err) {
    struct srv_work_queue *queue = calloc(1, sizeof *queue);
    if (!queue) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a thread");
        return NULL;
    }
    queue->last = &queue->first;
    queue->name = name;
    queue->niceness = niceness;
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

unsigned srv_work_queue_left(struct srv_work_queue *queue, const char *owner, bool is_limited,
                             unsigned most) {
    pthread_mutex_lock(&queue->mutex);
    struct srv_pool pool = { .most = most, .used = queue->count };
    for (const struct srv_work *work = queue->first; work; work = work->next) {
        pool.own += strcmp(work->owner, owner) == 0;
        pool.used--;
    }
    pool.own += pool.used > 0 && strcmp(queue->running, owner) == 0; /* one runs */
    pool.used = queue->count;
    pthread_mutex_unlock(&queue->mutex);
    return (unsigned)srv_fair_left(&pool, is_limited);
}

void srv_work_queue_stop(struct srv_work_queue *queue) {
    if (!queue || queue->is_joined)
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
