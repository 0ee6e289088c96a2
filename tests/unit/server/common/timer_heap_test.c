/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "common/timer_heap.h"

enum { COUNT = 60, STEPS = 20000, TIMES = 50 };

static struct srv_timer_heap dues;
static struct srv_timer nodes[COUNT];
static double model[COUNT]; /* INFINITY = not set */

static unsigned dice(unsigned sides) {
    static uint32_t state = 12345; /* xorshift32 */
    state ^= state << 13;
    state ^= state >> 17;
    state ^= state << 5;
    return state % sides;
}

static double least(void) {
    double at = INFINITY;
    for (int i = 0; i < COUNT; i++)
        at = fmin(at, model[i]);
    return at;
}

static void take(double now) {
    double at = least();
    struct srv_timer *due = srv_timer_take(&dues, now);
    if (at > now) {
        assert_null(due);
        return;
    }
    assert_non_null(due);
    assert_true(model[due - nodes] == at);
    assert_false(due->is_set);
    model[due - nodes] = INFINITY;
}

/* Against a list that is searched, step by step; many of the times are equal. */
static void what_is_due_comes_in_order(void **state) {
    (void)state;
    for (int i = 0; i < COUNT; i++) {
        nodes[i].of = &nodes[i];
        model[i] = INFINITY;
    }
    assert_true(srv_timer_next(&dues) == INFINITY);
    unsigned most = 0;
    for (int step = 0; step < STEPS; step++) {
        unsigned i = dice(COUNT), what = dice(8);
        double at = dice(TIMES);
        if (what < 3) {
            srv_timer_set(&dues, &nodes[i], at);
            model[i] = at;
        } else if (what < 5) {
            srv_timer_set_by(&dues, &nodes[i], at);
            model[i] = fmin(model[i], at);
        } else if (what == 5) {
            srv_timer_clear(&dues, &nodes[i]);
            model[i] = INFINITY;
        } else {
            take(at / 4);
        }
        unsigned set = 0;
        for (int k = 0; k < COUNT; k++) {
            assert_int_equal(nodes[k].is_set, model[k] < INFINITY);
            set += nodes[k].is_set;
        }
        most = set > most ? set : most;
        assert_true(srv_timer_next(&dues) == least());
    }
    assert_true(most > COUNT / 2);
    while (least() < INFINITY)
        take(TIMES);
    assert_null(srv_timer_take(&dues, INFINITY));
}

static void never_is_not_set(void **state) {
    (void)state;
    struct srv_timer due = { .of = &due };
    srv_timer_set_by(&dues, &due, INFINITY);
    assert_false(due.is_set);
    srv_timer_set(&dues, &due, 5);
    srv_timer_set_by(&dues, &due, INFINITY);
    assert_true(srv_timer_next(&dues) == 5);
    srv_timer_set(&dues, &due, INFINITY);
    assert_false(due.is_set);
    assert_null(srv_timer_take(&dues, INFINITY));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_due_comes_in_order),
        cmocka_unit_test(never_is_not_set),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
