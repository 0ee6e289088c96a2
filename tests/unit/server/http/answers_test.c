/* SPDX-License-Identifier: Apache-2.0
 *
 * How many bytes of answers over HTTP each owner may leave unread.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "http/answers.h"
#include "support/fake_memory.h"

enum { LIMIT = 1600, POOL = LIMIT / SRV_ANSWERS_DIVISOR, STEP = POOL / 8, COUNT = 16 };

static const struct srv_answer_owner greedy = { "greedy", true }, modest = { "modest", true },
                                     admin = { "admin", false };

struct fixture {
    struct sp_budget *budget;
    struct srv_answers *answers;
    struct srv_answer list[COUNT];
    unsigned count;
    struct sp_error err;
};

static int set_up(void **state) {
    static struct fixture f;
    f = (struct fixture){ .budget = sp_budget_create(LIMIT, NULL) };
    f.answers = srv_answers_create(f.budget, NULL);
    *state = &f;
    return f.answers ? 0 : -1;
}

static int tear_down(void **state) {
    struct fixture *f = *state;
    while (f->count > 0)
        srv_answers_shrink(f->answers, &f->list[--f->count], 0);
    srv_answers_destroy(&f->answers);
    const bool is_empty = sp_budget_total(f->budget) == 0;
    sp_budget_destroy(&f->budget);
    return is_empty ? 0 : -1;
}

static bool acquire_answer(struct fixture *f, const struct srv_answer_owner *owner, uint64_t bytes,
                           bool is_made) {
    assert_in_range(f->count, 0, COUNT - 1);
    const bool ok =
        srv_answers_acquire(f->answers, owner, bytes, is_made, &f->list[f->count], &f->err);
    f->count += ok;
    return ok;
}

/* Three quarters of half of the budget for the first owner, then as much of the rest. */
static void each_owner_has_its_share(void **state) {
    struct fixture *f = *state;
    for (int i = 0; i < 6; i++)
        assert_true(acquire_answer(f, &greedy, STEP, i & 1));
    for (int is_made = 0; is_made < 2; is_made++) {
        assert_false(acquire_answer(f, &greedy, STEP, is_made));
        assert_int_equal(f->err.code, SP_ERR_QUOTA);
        assert_string_equal(f->err.text, "the answer needs 100 bytes; greedy has 600 bytes of "
                                         "images and slices that were not read, and may have 600; "
                                         "read them first");
    }
    assert_true(acquire_answer(f, &modest, STEP, false));
    assert_true(acquire_answer(f, &modest, STEP / 2, false));
    assert_false(acquire_answer(f, &modest, 1, false));
    srv_answers_shrink(f->answers, &f->list[0], STEP / 2); /* the rest counts */
    assert_false(acquire_answer(f, &greedy, STEP, false));
    for (int i = 0; i < 3; i++)
        srv_answers_shrink(f->answers, &f->list[i], 0);
    assert_true(acquire_answer(f, &greedy, STEP, false));
}

static void admins_may_use_the_whole_budget(void **state) {
    struct fixture *f = *state;
    assert_true(acquire_answer(f, &greedy, 6 * STEP, false));
    assert_true(acquire_answer(f, &admin, LIMIT / 2, false));
    assert_true(acquire_answer(f, &admin, LIMIT - LIMIT / 2 - 6 * STEP, false));
    assert_false(acquire_answer(f, &admin, 1, false));
    assert_int_equal(f->err.code, SP_ERR_FRAME_BUDGET);
    assert_string_equal(f->err.text, "the answer needs 1 bytes; images have 1600 of the 1600 bytes "
                                     "that they may have together; try again later");
    assert_true(acquire_answer(f, &admin, 1, true)); /* it is there already */
}

/* A large answer is not refused for ever. */
static void an_owner_without_answers_gets_one_of_any_size(void **state) {
    struct fixture *f = *state;
    assert_true(acquire_answer(f, &greedy, POOL, false));
    assert_false(acquire_answer(f, &greedy, 1, false));
    assert_true(acquire_answer(f, &modest, POOL, false));
    assert_false(acquire_answer(f, &modest, 1, false));
}

static void out_of_memory(void **state) {
    struct fixture *f = *state;
    memory_fail_after(0, MEMORY_STAYS_OUT);
    assert_null(srv_answers_create(f->budget, &f->err));
    assert_int_equal(f->err.code, SP_ERR_MEMORY);
    assert_false(acquire_answer(f, &greedy, 1, false));
    assert_int_equal(f->err.code, SP_ERR_MEMORY);
    memory_restore();
    assert_int_equal(sp_budget_total(f->budget), 0);
}

#define WITH_ANSWERS(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)

int main(void) {
    const struct CMUnitTest tests[] = {
        WITH_ANSWERS(each_owner_has_its_share),
        WITH_ANSWERS(admins_may_use_the_whole_budget),
        WITH_ANSWERS(an_owner_without_answers_gets_one_of_any_size),
        WITH_ANSWERS(out_of_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
