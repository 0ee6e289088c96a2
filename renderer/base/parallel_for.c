/* SPDX-License-Identifier: Apache-2.0 */
#include "base/parallel_for.h"

#include <assert.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

struct worker {
    struct sp_pool *pool;
    pthread_t thread;
    unsigned index;
};

struct sp_pool {
    pthread_mutex_t lock;
    pthread_cond_t start, done;
    unsigned threads, running; /* running: workers still inside the current loop */
    unsigned long generation;  /* rises with each loop; a worker waits for the next one */
    bool stop;

    sp_block_fn *fn;
    void *user;
    size_t count, grain;
    atomic_size_t next; /* first index that no worker has claimed */

    struct worker workers[]; /* 1 … threads-1; [0] is the caller and has no thread */
};

#if defined(__SSE2__)
static unsigned flush_denormals(void) {
    unsigned old = _mm_getcsr();
    _mm_setcsr(old | 0x8040); /* FTZ and DAZ */
    return old;
}

static void restore_denormals(unsigned old) {
    _mm_setcsr(old);
}
#elif defined(__aarch64__)
static unsigned flush_denormals(void) {
    uint64_t old;
    __asm__ volatile("mrs %0, fpcr" : "=r"(old));
    __asm__ volatile("msr fpcr, %0" : : "r"(old | (1u << 24))); /* FZ: in and out */
    return (unsigned)old;
}

static void restore_denormals(unsigned old) {
    __asm__ volatile("msr fpcr, %0" : : "r"((uint64_t)old));
}
#else
static unsigned flush_denormals(void) {
    return 0;
}

static void restore_denormals(unsigned old) {
    (void)old;
}
#endif

static void claim_blocks(struct sp_pool *pool, unsigned worker) {
    for (;;) {
        size_t begin = atomic_fetch_add_explicit(&pool->next, pool->grain, memory_order_relaxed);
        if (begin >= pool->count)
            return;
        size_t left = pool->count - begin;
        pool->fn(pool->user, begin, begin + (left < pool->grain ? left : pool->grain), worker);
    }
}

static void *worker_main(void *arg) {
    struct worker *self = arg;
    struct sp_pool *pool = self->pool;
    unsigned long seen = 0;
    flush_denormals();
    pthread_mutex_lock(&pool->lock);
    for (;;) {
        while (!pool->stop && pool->generation == seen)
            pthread_cond_wait(&pool->start, &pool->lock);
        if (pool->stop)
            break;
        seen = pool->generation;
        pthread_mutex_unlock(&pool->lock);
        claim_blocks(pool, self->index);
        pthread_mutex_lock(&pool->lock);
        if (--pool->running == 0)
            pthread_cond_signal(&pool->done);
    }
    pthread_mutex_unlock(&pool->lock);
    return NULL;
}

struct sp_pool *sp_pool_create(unsigned threads, struct sp_error *err) {
    assert(threads >= 1 && threads <= 256);
    struct sp_pool *pool = calloc(1, sizeof *pool + threads * sizeof pool->workers[0]);
    if (!pool) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for %u render threads", threads);
        return NULL;
    }
    pthread_mutex_init(&pool->lock, NULL);
    pthread_cond_init(&pool->start, NULL);
    pthread_cond_init(&pool->done, NULL);
    pool->threads = 1;
    /* Workers block all signals: the threads of the program handle them. */
    sigset_t all, old;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &old);
    int failed = 0;
    for (unsigned i = 1; i < threads && !failed; i++) {
        pool->workers[i] = (struct worker){ .pool = pool, .index = i };
        failed = pthread_create(&pool->workers[i].thread, NULL, worker_main, &pool->workers[i]);
        if (!failed)
            pool->threads++;
    }
    pthread_sigmask(SIG_SETMASK, &old, NULL);
    if (failed) {
        sp_fail(err, SP_ERR_MEMORY, "", "cannot start render thread %u of %u: %s", pool->threads,
                threads, strerror(failed));
        sp_pool_destroy(&pool);
    }
    return pool;
}

void sp_pool_destroy(struct sp_pool **pool) {
    struct sp_pool *p = *pool;
    if (!p)
        return;
    pthread_mutex_lock(&p->lock);
    p->stop = true;
    pthread_cond_broadcast(&p->start);
    pthread_mutex_unlock(&p->lock);
    for (unsigned i = 1; i < p->threads; i++)
        pthread_join(p->workers[i].thread, NULL);
    pthread_cond_destroy(&p->done);
    pthread_cond_destroy(&p->start);
    pthread_mutex_destroy(&p->lock);
    free(p);
    *pool = NULL;
}

unsigned sp_pool_threads(const struct sp_pool *pool) {
    return pool->threads;
}

void sp_parallel_for(struct sp_pool *pool, size_t count, size_t grain, sp_block_fn *fn,
                     void *user) {
    assert(grain > 0);
    if (count == 0)
        return;
    pthread_mutex_lock(&pool->lock);
    pool->fn = fn;
    pool->user = user;
    pool->count = count;
    pool->grain = grain;
    atomic_store_explicit(&pool->next, 0, memory_order_relaxed);
    pool->running = pool->threads - 1;
    pool->generation++;
    pthread_cond_broadcast(&pool->start);
    pthread_mutex_unlock(&pool->lock);

    unsigned old = flush_denormals();
    claim_blocks(pool, 0);
    restore_denormals(old);

    pthread_mutex_lock(&pool->lock);
    while (pool->running > 0)
        pthread_cond_wait(&pool->done, &pool->lock);
    pthread_mutex_unlock(&pool->lock);
}
