/* SPDX-License-Identifier: Apache-2.0
 *
 * The pool of encoded frames: its part of the budget, the owners' shares, what is given back.
 */
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "session/blob.h"
#include "support/compare.h"
#include "support/fake_memory.h"

enum {
    LIMIT = 64 << 10,
    MOST = LIMIT / SRV_BLOB_DIVISOR,
    SIZE = (1 << 10) - sizeof(struct srv_blob), /* each blob counts 1 KiB */
    COUNT = MOST >> 10                          /* blobs that fit */
};

static const struct srv_blob_owner greedy = { "greedy", true, false },
                                   guests = { "greedy", true, true },
                                   modest = { "modest", true, false },
                                   admin = { "admin", false, false },
                                   admins_guests = { "admin", false, true };
static const uint8_t image[LIMIT];

struct fixture {
    struct sp_budget *budget;
    struct srv_blob_pool *pool;
    struct srv_blob *blobs[COUNT + 1], *cached;
    unsigned count, reclaims;
    struct sp_error err;
};

static void reclaim(void *user) {
    struct fixture *f = user;
    f->reclaims++;
    srv_blob_unref(&f->cached);
}

static int set_up(void **state) {
    static struct fixture f;
    memset(&f, 0, sizeof f);
    f.budget = sp_budget_create(LIMIT, NULL);
    const struct srv_blob_pool_options options = { f.budget, reclaim, &f };
    f.pool = srv_blob_pool_create(&options, NULL);
    *state = &f;
    return f.pool ? 0 : -1;
}

/* The last reference gives everything back. */
static int tear_down(void **state) {
    struct fixture *f = *state;
    while (f->count > 0)
        srv_blob_unref(&f->blobs[--f->count]);
    srv_blob_unref(&f->cached);
    assert_int_equal(sp_budget_total(f->budget), 0);
    srv_blob_pool_destroy(&f->pool);
    sp_budget_destroy(&f->budget);
    return 0;
}

static void bytes_before_an_image_belong_to_it(void **state) {
    struct fixture *f = *state;
    uint8_t before[3] = "ab";
    const struct srv_bytes depth = { .bytes = before, .size = sizeof before };
    struct srv_blob *blob = srv_blob_create_with(f->pool, &modest, &depth, image, 5, &f->err);
    assert_non_null(blob);
    assert_int_equal(blob->size, 8);
    assert_int_equal(blob->image_at, 3);
    assert_memory_equal(blob->bytes, before, 3);
    assert_memory_equal(blob->bytes + 3, image, 5);
    assert_int_equal(sp_budget_total(f->budget), sizeof *blob + 8);
    srv_blob_unref(&blob);
}

static bool make(struct fixture *f, const struct srv_blob_owner *owner) {
    struct srv_blob *blob = srv_blob_create(f->pool, owner, image, SIZE, &f->err);
    if (blob)
        f->blobs[f->count++] = blob;
    else
        assert_int_equal(f->err.code, SP_ERR_FRAME_BUDGET);
    return blob != NULL;
}

static void the_pool_has_a_part_of_the_budget(void **state) {
    struct fixture *f = *state;
    while (make(f, &admin)) {
    }
    assert_int_equal(f->count, COUNT);
    assert_int_equal(sp_budget_used(f->budget, SP_BUDGET_ANSWERS), MOST);
    assert_int_equal(sp_budget_total(f->budget), MOST);
    srv_blob_unref(&f->blobs[--f->count]);
    assert_true(make(f, &admin));
}

static void each_owner_has_a_share(void **state) {
    struct fixture *f = *state;
    while (make(f, &greedy)) {
    }
    assert_int_equal(f->count, COUNT * 3 / 4);
    char both[128];
    snprintf(both, sizeof both, "needs %u bytes; the clients of this session's owner have %u bytes",
             1u << 10, MOST * 3 / 4);
    assert_non_null(strstr(f->err.text, both));
    snprintf(both, sizeof both, "and may have %u;", MOST * 3 / 4);
    assert_non_null(strstr(f->err.text, both));
    assert_true(make(f, &modest));
    while (make(f, &admin)) {
    }
    assert_int_equal(f->count, COUNT);
}

static void guests_have_a_share_of_the_owners(void **state) {
    struct fixture *f = *state;
    while (make(f, &guests)) {
    }
    assert_int_equal(f->count, COUNT * 3 / 4 * 3 / 4);
    assert_non_null(strstr(f->err.text, "the guests of this session's owner have 9216 bytes"));
    assert_true(make(f, &greedy));
    assert_true(make(f, &greedy));
    assert_false(make(f, &guests));
    while (f->count > 0)
        srv_blob_unref(&f->blobs[--f->count]);
    while (make(f, &admins_guests)) {
    }
    assert_int_equal(f->count, COUNT * 3 / 4);
    assert_true(make(f, &admin));
}

static void shared_bytes_count_once(void **state) {
    struct fixture *f = *state;
    assert_true(make(f, &greedy));
    struct srv_blob *other = srv_blob_ref(f->blobs[0]);
    assert_int_equal(sp_budget_total(f->budget), 1 << 10);
    srv_blob_unref(&f->blobs[--f->count]);
    assert_int_equal(sp_budget_total(f->budget), 1 << 10);
    srv_blob_unref(&other);
    assert_int_equal(sp_budget_total(f->budget), 0);
}

static void cached_bytes_make_way(void **state) {
    struct fixture *f = *state;
    f->cached = srv_blob_create(f->pool, &modest, image, SIZE, NULL);
    for (unsigned i = 1; i < COUNT; i++)
        assert_true(make(f, &admin));
    assert_int_equal(f->reclaims, 0);
    assert_true(make(f, &admin));
    assert_null(f->cached);
    assert_false(make(f, &admin));
    assert_int_equal(f->reclaims, 2); /* once per blob that does not fit */
}

static void other_frames_may_leave_too_little(void **state) {
    struct fixture *f = *state;
    assert_true(sp_budget_acquire(f->budget, SP_BUDGET_ARENAS, LIMIT - 1500));
    assert_true(make(f, &modest));
    assert_false(make(f, &modest));
    assert_non_null(strstr(f->err.text, "needs 1024 more bytes for its encoded image"));
    sp_budget_release(f->budget, SP_BUDGET_ARENAS, LIMIT - 1500);
    assert_true(make(f, &modest));
}

static void without_memory_nothing_is_taken(void **state) {
    struct fixture *f = *state;
    long refused = 0;
    for (bool ok = false; !ok; refused++) {
        memory_fail_after(refused, MEMORY_FAILS_ONCE);
        struct srv_blob *blob = srv_blob_create(f->pool, &modest, image, SIZE, &f->err);
        memory_restore();
        ok = blob != NULL;
        if (!ok)
            assert_int_equal(f->err.code, SP_ERR_MEMORY);
        srv_blob_unref(&blob);
        assert_int_equal(sp_budget_total(f->budget), 0);
    }
    assert_compare(refused, >=, 3); /* the account, the blob, then none */
    assert_int_equal(f->reclaims, 0);
}

static void *create_and_release(void *user) {
    struct fixture *f = user;
    struct srv_blob_owner owner = { "", true, false };
    struct srv_blob *kept[COUNT] = { NULL };
    for (unsigned i = 0; i < 4000; i++) {
        owner.name[0] = (char)('a' + i % 5);
        owner.is_guests = i % 2;
        struct srv_blob **blob = &kept[i % COUNT];
        srv_blob_unref(blob);
        *blob = srv_blob_create(f->pool, &owner, image, i % 3 ? SIZE : 0, NULL);
        if (*blob && i % 7 == 0) {
            struct srv_blob *shared = srv_blob_ref(*blob);
            srv_blob_unref(&shared);
        }
        if (sp_budget_total(f->budget) > MOST)
            return user;
    }
    for (unsigned i = 0; i < COUNT; i++)
        srv_blob_unref(&kept[i]);
    return NULL;
}

static void threads_never_exceed_the_pool(void **state) {
    struct fixture *f = *state;
    const struct srv_blob_pool_options options = { f->budget, NULL, NULL };
    srv_blob_pool_destroy(&f->pool);
    f->pool = srv_blob_pool_create(&options, NULL);
    pthread_t threads[4];
    for (unsigned i = 0; i < 4; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, create_and_release, f), 0);
    for (unsigned i = 0; i < 4; i++) {
        void *exceeded;
        pthread_join(threads[i], &exceeded);
        assert_null(exceeded);
    }
}

static void without_a_pool_nothing_is_counted(void **state) {
    struct fixture *f = *state;
    struct srv_blob *blob = srv_blob_create(NULL, NULL, image, LIMIT, &f->err);
    assert_non_null(blob);
    assert_int_equal(blob->size, LIMIT);
    srv_blob_unref(&blob);
    assert_null(blob);
    srv_blob_unref(&blob);
}

int main(void) {
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        TEST(bytes_before_an_image_belong_to_it),
        TEST(the_pool_has_a_part_of_the_budget),
        TEST(each_owner_has_a_share),
        TEST(guests_have_a_share_of_the_owners),
        TEST(shared_bytes_count_once),
        TEST(cached_bytes_make_way),
        TEST(other_frames_may_leave_too_little),
        TEST(without_memory_nothing_is_taken),
        TEST(threads_never_exceed_the_pool),
        TEST(without_a_pool_nothing_is_counted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
