/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdatomic.h>
#include <stdio.h>
#include <string.h>

#include "base/arena.h"
#include "base/parallel_for.h"
#include "base/vec.h"
#include "sp/log.h"
#include "sp/status.h"
#include "sp/utf8.h"
#include "sp/version.h"
#include "support/compare.h"
#include "support/sanitized.h"

static void arena_reuses_memory(void **state) {
    (void)state;
    struct sp_arena arena;
    sp_arena_init(&arena);
    uint64_t after_two = 0;
    for (int frame = 0; frame < 5; frame++) {
        sp_arena_reset(&arena);
        for (size_t i = 1; i <= 40; i++) {
            unsigned char *p = sp_arena_alloc(&arena, "rows", i * 1000, 3);
            assert_non_null(p);
            assert_int_equal((uintptr_t)p % 64, 0);
            memset(p, (int)i, i * 3000);
        }
        if (frame == 1)
            after_two = arena.system_allocations;
    }
    assert_int_equal(arena.system_allocations, after_two);
    assert_null(sp_arena_alloc(&arena, "huge", SIZE_MAX / 2, 4));
    assert_string_equal(arena.failed, "huge");
    sp_arena_finish(&arena);
}

static void a_budget_is_never_exceeded(void **state) {
    (void)state;
    struct sp_error err = { .code = SP_OK };
    struct sp_budget *budget = sp_budget_create(1000, &err);
    assert_non_null(budget);
    assert_true(sp_budget_acquire(budget, SP_BUDGET_IMAGES, 600));
    assert_false(sp_budget_acquire(budget, SP_BUDGET_ENCODERS, 401));
    assert_false(sp_budget_acquire(budget, SP_BUDGET_ENCODERS, UINT64_MAX));
    assert_true(sp_budget_acquire(budget, SP_BUDGET_ENCODERS, 400));
    assert_int_equal(sp_budget_used(budget, SP_BUDGET_IMAGES), 600);
    assert_int_equal(sp_budget_total(budget), 1000);
    sp_budget_add(budget, SP_BUDGET_ANSWERS, 50); /* is there already */
    assert_false(sp_budget_acquire(budget, SP_BUDGET_ARENAS, 0));
    assert_false(sp_budget_fail(budget, "pixels", 77, &err));
    assert_int_equal(err.code, SP_ERR_FRAME_BUDGET);
    assert_non_null(strstr(err.text, "77 more bytes for its pixels"));
    assert_non_null(strstr(err.text, "1050 of the 1000 bytes"));
    sp_budget_release(budget, SP_BUDGET_IMAGES, 600);
    sp_budget_release(budget, SP_BUDGET_ENCODERS, 400);
    sp_budget_release(budget, SP_BUDGET_ANSWERS, 50);
    sp_budget_destroy(&budget);
    assert_null(budget);
    assert_true(sp_budget_acquire(NULL, SP_BUDGET_IMAGES, UINT64_MAX)); /* no limit */
}

static void an_arena_takes_its_blocks_from_the_budget(void **state) {
    (void)state;
    enum { LIMIT = 4 << 20 };
    struct sp_error err;
    struct sp_budget *budget = sp_budget_create(LIMIT, NULL);
    struct sp_arena arena;
    size_t got = 0;
    sp_arena_init(&arena);
    arena.budget = budget;
    while (sp_arena_alloc(&arena, "records", 1, 100 << 10)) {
        got += 100 << 10;
        assert_int_equal(sp_budget_used(budget, SP_BUDGET_ARENAS), arena.held);
        assert_compare(arena.held, <=, (uint64_t)LIMIT);
    }
    assert_compare(got, >, (size_t)LIMIT * 3 / 4); /* little is left unused */
    assert_false(sp_arena_fail(&arena, "data", &err));
    assert_int_equal(err.code, SP_ERR_FRAME_BUDGET);
    assert_non_null(strstr(err.text, "for its records"));
    sp_arena_trim(&arena);
    assert_int_equal(sp_budget_total(budget), 0);
    assert_non_null(sp_arena_alloc(&arena, "records", 1, 100 << 10));
    assert_null(
        sp_arena_alloc(&arena, "huge", SIZE_MAX / 2, 4)); /* that is no matter of the budget */
    assert_false(sp_arena_fail(&arena, "data", &err));
    assert_int_equal(err.code, SP_ERR_MEMORY);
    sp_arena_finish(&arena);
    sp_budget_destroy(&budget);
}

enum { COUNT = 100003, GRAIN = 64 };
struct visit {
    atomic_uchar seen[COUNT];
    atomic_uint bad;
    unsigned threads;
};

static void visit_block(void *user, size_t begin, size_t end, unsigned worker) {
    struct visit *v = user;
    if (worker >= v->threads || begin % GRAIN || end - begin > GRAIN)
        atomic_fetch_add(&v->bad, 1);
    for (size_t i = begin; i < end; i++)
        atomic_fetch_add(&v->seen[i], 1);
}

static void parallel_for_visits_each_index_once(void **state) {
    (void)state;
    static struct visit v;
    if (TEST_TSAN)
        print_message("reduced with ThreadSanitizer: fewer rounds\n");
    for (unsigned threads = 1; threads <= 8; threads++) {
        struct sp_error err;
        struct sp_pool *pool = sp_pool_create(threads, &err);
        assert_non_null(pool);
        v.threads = sp_pool_threads(pool);
        assert_int_equal(v.threads, threads);
        for (int loop = 0; loop < (TEST_TSAN ? 3 : 20); loop++) {
            memset(v.seen, 0, sizeof v.seen);
            sp_parallel_for(pool, COUNT, GRAIN, visit_block, &v);
            for (size_t i = 0; i < COUNT; i++)
                assert_int_equal(v.seen[i], 1);
        }
        sp_parallel_for(pool, 0, GRAIN, visit_block, &v);
        sp_pool_destroy(&pool);
        assert_null(pool);
    }
    assert_int_equal(v.bad, 0);
}

static void inverse_times_matrix_is_identity(void **state) {
    (void)state;
    struct sp_mat3 a = { { { 2, -1, 0.5 }, { 0.25, 3, 1 }, { -1, 0.5, 4 } } };
    double det;
    struct sp_mat3 inv = sp_mat3_inverse(&a, &det), one = sp_mat3_multiply(&a, &inv);
    assert_compare(fabs(det - sp_mat3_determinant(&a)), <, 1e-12);
    assert_compare(det, >, 1);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            assert_compare(fabs(one.m[i][j] - (i == j)), <, 1e-12);
}

static void long_error_texts_are_truncated(void **state) {
    (void)state;
    char longer[1000];
    memset(longer, 'x', sizeof longer - 1);
    longer[sizeof longer - 1] = 0;
    struct sp_error err;
    assert_false(sp_fail(&err, SP_ERR_FORMAT, longer, "%s", longer));
    assert_int_equal(strlen(err.place), SP_ERROR_PLACE - 1);
    assert_int_equal(strlen(err.text), SP_ERROR_TEXT - 1);
    assert_false(sp_fail(NULL, SP_ERR_FORMAT, NULL, "no error object"));
    assert_string_equal(sp_code_name(SP_ERR_FORMAT), "format");
}

static void copy_line(void *user, enum sp_log_level level, const char *kind,
                      const struct sp_log_field *fields, const char *line) {
    (void)level;
    snprintf(user, 64, "%s|%s", kind, line);
    for (; fields->key; fields++)
        snprintf((char *)user + strlen(user), 64 - strlen(user), "|%s=%s", fields->key,
                 fields->value);
}

static void log_lines_cannot_be_forged(void **state) {
    (void)state;
    char last_line[64] = "";
    sp_log_init(copy_line, last_line, SP_LOG_INFO);
    sp_log(SP_LOG_DEBUG, "too detailed");
    assert_string_equal(last_line, "");
    sp_log(SP_LOG_INFO, "peer %s", "a\nERROR b");
    assert_string_equal(last_line, "peer %s|peer a?ERROR b");
    sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "volume", "v" }, { "peer", "p" }), "%d", 7);
    assert_string_equal(last_line, "%d|7|volume=v|peer=p");
    sp_log_with(SP_LOG_DEBUG, SP_LOG_FIELDS({ "volume", "v" }), "too detailed");
    assert_string_equal(last_line, "%d|7|volume=v|peer=p");
    sp_log_init(NULL, NULL, SP_LOG_INFO);
}

/* They are part of the protocol: clients branch on them. */
static void only_utf8_is_valid(void **state) {
    (void)state;
    static const struct {
        const char *text, *mended;
    } cases[] = {
        { "", "" },
        { "mm", "mm" },
        { "\u00b5m \u20ac \U0001f600", "\u00b5m \u20ac \U0001f600" },
        { "11\xb5,\xe4", "11?,?" }, /* Latin-1 */
        { "\xc3", "?" },            /* cut off */
        { "\xe2\x82", "??" },
        { "\xf0\x9f\x98", "???" },
        { "\xc0\x80\xe0\x9f\x80", "?????" },      /* longer than needed */
        { "\xed\xa0\x80", "???" },                /* half of a pair of UTF-16 */
        { "\xf4\x90\x80\x80\xf5\x80", "??????" }, /* above U+10FFFF */
        { "a\xe2\x82z", "a??z" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[32];
        strcpy(text, cases[i].text);
        sp_utf8_mend(text);
        assert_string_equal(text, cases[i].mended);
    }
    assert_int_equal(sp_utf8_length("\u20ac"), 3);
    assert_int_equal(sp_utf8_length("\xf4\x8f\xbf\xbf"), 4);
    assert_int_equal(sp_utf8_length(""), 1);
}

static void each_error_code_has_a_name_of_its_own(void **state) {
    (void)state;
    int count = 0;
    while (strcmp(sp_code_name((enum sp_code)count), "unknown") != 0) {
        for (int other = 0; other < count; other++)
            assert_string_not_equal(sp_code_name((enum sp_code)count),
                                    sp_code_name((enum sp_code)other));
        count++;
    }
    assert_int_equal(count, SP_ERR_TOO_LARGE + 1);
    assert_string_equal(sp_code_name(SP_OK), "ok");
    assert_string_equal(sp_code_name(SP_ERR_TOO_LARGE), "too-large");
}

static void the_version_is_that_of_the_headers(void **state) {
    (void)state;
    char text[32];
    snprintf(text, sizeof text, "%d.%d.%d", SP_VERSION_MAJOR, SP_VERSION_MINOR, SP_VERSION_PATCH);
    assert_string_equal(sp_version_string(), text);
    assert_int_equal(sp_version(), SP_VERSION);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(arena_reuses_memory),
        cmocka_unit_test(a_budget_is_never_exceeded),
        cmocka_unit_test(an_arena_takes_its_blocks_from_the_budget),
        cmocka_unit_test(parallel_for_visits_each_index_once),
        cmocka_unit_test(inverse_times_matrix_is_identity),
        cmocka_unit_test(long_error_texts_are_truncated),
        cmocka_unit_test(log_lines_cannot_be_forged),
        cmocka_unit_test(only_utf8_is_valid),
        cmocka_unit_test(each_error_code_has_a_name_of_its_own),
        cmocka_unit_test(the_version_is_that_of_the_headers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
