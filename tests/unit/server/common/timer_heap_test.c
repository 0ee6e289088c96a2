/* SPDX-License-Identifier: Apache-2.0
 *
 * The timer heap against a plain array.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "common/timer_heap.h"
#include "support/compare.h"

enum { COUNT = 60, STEPS = 20000, TIMES = 50 };

static struct srv_timer_heap heap;
static struct srv_timer nodes[COUNT];
static double model[COUNT]; /* INFINITY = not set */

static unsigned random_below(unsigned sides) {
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

static void pop_timer(double now) {
    double at = least();
    struct srv_timer *timer = srv_timer_pop(&heap, now);
    if (at > now) {
        assert_null(timer);
        return;
    }
    assert_non_null(timer);
    assert_compare(model[timer - nodes], ==, at);
    assert_false(timer->is_set);
    model[timer - nodes] = INFINITY;
}

/* Compares the heap with a plain array after each of many random steps. Many times are equal. */
static void timers_expire_in_order(void **state) {
    (void)state;
    for (int i = 0; i < COUNT; i++) {
        nodes[i].of = &nodes[i];
        model[i] = INFINITY;
    }
    assert_compare(srv_timer_next(&heap), ==, INFINITY);
    unsigned most = 0;
    for (int step = 0; step < STEPS; step++) {
        unsigned i = random_below(COUNT), what = random_below(8);
        double at = random_below(TIMES);
        if (what < 3) {
            srv_timer_set(&heap, &nodes[i], at);
            model[i] = at;
        } else if (what < 5) {
            srv_timer_set_by(&heap, &nodes[i], at);
            model[i] = fmin(model[i], at);
        } else if (what == 5) {
            srv_timer_clear(&heap, &nodes[i]);
            model[i] = INFINITY;
        } else {
            pop_timer(at / 4);
        }
        unsigned set = 0;
        for (int k = 0; k < COUNT; k++) {
            assert_int_equal(nodes[k].is_set, model[k] < INFINITY);
            set += nodes[k].is_set;
        }
        most = set > most ? set : most;
        assert_compare(srv_timer_next(&heap), ==, least());
    }
    assert_compare(most, >, COUNT / 2);
    while (least() < INFINITY)
        pop_timer(TIMES);
    assert_null(srv_timer_pop(&heap, INFINITY));
}

static void a_timer_at_infinity_is_not_set(void **state) {
    (void)state;
    struct srv_timer timer = { .of = &timer };
    srv_timer_set_by(&heap, &timer, INFINITY);
    assert_false(timer.is_set);
    srv_timer_set(&heap, &timer, 5);
    srv_timer_set_by(&heap, &timer, INFINITY);
    assert_compare(srv_timer_next(&heap), ==, 5);
    srv_timer_set(&heap, &timer, INFINITY);
    assert_false(timer.is_set);
    assert_null(srv_timer_pop(&heap, INFINITY));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(timers_expire_in_order),
        cmocka_unit_test(a_timer_at_infinity_is_not_set),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
