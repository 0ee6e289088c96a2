/* SPDX-License-Identifier: Apache-2.0
 *
 * Shares of a pool, and the order of work of several owners.
 */
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "common/fair_share.h"
#include "common/work_queue.h"
#include "support/compare.h"

enum { MOST = 1000 };

/* Each of n owners takes as much as it can, in turn. Returns the amount of the first owner. */
static uint64_t acquire_all(unsigned owners, uint64_t *free) {
    uint64_t own[64] = { 0 };
    struct srv_pool pool = { .most = MOST };
    for (bool is_acquired = true; is_acquired;) {
        is_acquired = false;
        for (unsigned i = 0; i < owners; i++) {
            pool.own = own[i];
            if (srv_fair_left(&pool, true) == 0)
                continue;
            own[i]++;
            pool.used++;
            is_acquired = true;
        }
    }
    *free = MOST - pool.used;
    return own[0];
}

static void owners_leave_a_part_free(void **state) {
    (void)state;
    for (unsigned n = 1; n <= 64; n *= 2) {
        uint64_t free;
        const uint64_t own = acquire_all(n, &free);
        assert_in_range(own, 3 * MOST / (3 * n + 1) - 1, 3 * MOST / (3 * n + 1) + 1);
        assert_compare(free, >=, MOST / (3 * n + 1));
    }
}

static void a_share_is_what_an_owner_may_have_more(void **state) {
    (void)state;
    static const struct {
        struct srv_pool pool;
        uint64_t limited, free;
    } cases[] = {
        { { 100, 0, 0 }, 75, 100 },
        { { 100, 75, 75 }, 0, 25 },
        { { 100, 75, 0 }, 18, 25 },
        { { 100, 100, 10 }, 0, 0 },
        { { 100, 120, 10 }, 0, 0 },
        { { 3, 2, 2 }, 1, 1 },
        { { UINT64_MAX / 4, 0, 0 }, UINT64_MAX / 16 * 3, UINT64_MAX / 4 },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        assert_in_range(srv_fair_left(&cases[i].pool, true), cases[i].limited,
                        cases[i].limited + 2);
        assert_int_equal(srv_fair_left(&cases[i].pool, false), cases[i].free);
    }
}

static struct {
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    bool is_open;
    char order[16];
} seen = { .mutex = PTHREAD_MUTEX_INITIALIZER, .changed = PTHREAD_COND_INITIALIZER };

static void note(struct srv_work *work) {
    pthread_mutex_lock(&seen.mutex);
    while (!seen.is_open)
        pthread_cond_wait(&seen.changed, &seen.mutex);
    seen.order[strlen(seen.order)] = work->owner[0];
    pthread_mutex_unlock(&seen.mutex);
}

/* Work of an owner that has used no time yet goes before work of an owner whose work takes long. */
static void work_of_another_owner_is_next(void **state) {
    (void)state;
    struct srv_work_queue *queue = srv_work_queue_create("test", 0, NULL);
    struct srv_work work[8];
    for (int i = 0; i < 8; i++) {
        work[i] = (struct srv_work){ .run = note };
        snprintf(work[i].owner, sizeof work[i].owner, "%s", i < 6 ? "ann" : "bob");
        srv_work_queue_add(queue, &work[i]);
    }
    assert_int_equal(srv_work_queue_left(queue, "ann", true, 16), 4); /* 6 of 16, 8 are free */
    assert_int_equal(srv_work_queue_left(queue, "cy", true, 16), 6);
    assert_int_equal(srv_work_queue_left(queue, "ann", false, 16), 8);
    pthread_mutex_lock(&seen.mutex);
    seen.is_open = true;
    pthread_cond_broadcast(&seen.changed);
    pthread_mutex_unlock(&seen.mutex);
    srv_work_queue_destroy(&queue);
    assert_memory_equal(seen.order, "ab", 2); /* the first one ran before the others came */
    assert_int_equal(strlen(seen.order), 8);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(owners_leave_a_part_free),
        cmocka_unit_test(a_share_is_what_an_owner_may_have_more),
        cmocka_unit_test(work_of_another_owner_is_next),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
