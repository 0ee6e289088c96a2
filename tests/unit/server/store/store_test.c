/* SPDX-License-Identifier: Apache-2.0
 *
 * The store: records in memory and in the database, the writer thread, and use by many threads.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "unit/server/store/store_fixture.h"

static void a_store_without_folder_holds_records_in_memory(void **state) {
    (void)state;
    struct srv_store_options o = { .max = { [SRV_KIND_VIEW] = 2 } };
    struct sp_error err;
    struct srv_store_status status;
    struct srv_store *store = srv_store_create(&o, &err);
    assert_true(srv_store_start(store, NULL, NULL, &err));
    assert_true(store_put(store, SRV_KIND_VIEW, "b", "1"));
    assert_true(store_put(store, SRV_KIND_VIEW, "a", "2"));
    assert_false(srv_store_put(store, SRV_KIND_VIEW, "c", "3", 1, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_true(store_put(store, SRV_KIND_VIEW, "a", "22")); /* replaces the record */
    assert_true(store_put(store, SRV_KIND_SESSION, "a", "session"));
    store_holds(store, SRV_KIND_VIEW, "a", "22");
    const struct srv_store_owner share = { .beginning = "2", .name = "ann", .most = 1 };
    const struct srv_store_owner other = { .beginning = "3", .name = "bob", .most = 1 };
    assert_true(srv_store_add(store, SRV_KIND_VIEW, "a", "23", 2, &share,
                              &err)); /* keeps the record's old text */
    store_holds(store, SRV_KIND_VIEW, "a", "22");
    assert_false(srv_store_add(store, SRV_KIND_VIEW, "c", "23", 2, &share, &err));
    assert_int_equal(err.code, SP_ERR_QUOTA);
    assert_string_equal(err.text, "ann has 1 views and its token allows 1; delete some");
    assert_false(srv_store_add(store, SRV_KIND_VIEW, "c", "3", 1, &other, &err));
    assert_non_null(strstr(err.text, "--views allows 2"));
    store_holds(store, SRV_KIND_SESSION, "a", "session");
    store_holds(store, SRV_KIND_PRESET, "a", NULL);
    assert_false(store_flush(store));
    char *ids = srv_store_ids(store, SRV_KIND_VIEW);
    assert_memory_equal(ids, "b\0a\0", 5);
    free(ids);
    assert_true(srv_store_remove(store, SRV_KIND_VIEW, "b"));
    assert_false(srv_store_remove(store, SRV_KIND_VIEW, "b"));
    srv_store_status(store, &status);
    assert_int_equal(status.records[SRV_KIND_VIEW], 1);
    assert_int_equal(status.bytes, 3 + 8);
    assert_int_equal(status.waiting, 0);
    assert_false(status.has_folder);
    srv_store_destroy(&store);
}

/* More records than the first buckets hold, put, changed and removed in pseudo-random order. */
static void the_table_holds_many_records(void **state) {
    struct srv_store *store = store_started(*state);
    char id[16], text[32];
    uint32_t random = 1;
    static int expected[1000];
    memset(expected, 0, sizeof expected);
    for (int i = 1; i < 20000; i++) {
        random = random * 1664525 + 1013904223;
        unsigned which = (random >> 8) % 1000;
        snprintf(id, sizeof id, "%u", which);
        snprintf(text, sizeof text, "%d", i);
        if (random >> 30 == 0)
            assert_int_equal(srv_store_remove(store, SRV_KIND_VIEW, id), expected[which] != 0);
        else
            assert_true(store_put(store, SRV_KIND_VIEW, id, text));
        expected[which] = random >> 30 == 0 ? 0 : i;
    }
    for (int again = 0; again < 2; again++) {
        for (unsigned which = 0; which < 1000; which++) {
            snprintf(id, sizeof id, "%u", which);
            snprintf(text, sizeof text, "%d", expected[which]);
            store_holds(store, SRV_KIND_VIEW, id, expected[which] ? text : NULL);
        }
        srv_store_destroy(&store); /* writes what is pending */
        store = store_create(*state);
    }
    srv_store_destroy(&store);
}

static void records_survive_in_order(void **state) {
    struct srv_store *store = store_started(*state);
    struct stat found;
    char path[128];
    assert_true(store_put(store, SRV_KIND_VOLUME, "z", "first"));
    assert_true(store_put(store, SRV_KIND_VOLUME, "a", "x"));
    assert_true(store_put(store, SRV_KIND_VOLUME, "gone", "x"));
    assert_true(store_flush(store));
    assert_true(store_put(store, SRV_KIND_VOLUME, "z", "changed é"));
    assert_true(srv_store_remove(store, SRV_KIND_VOLUME, "gone"));
    assert_true(store_flush(store));
    srv_store_destroy(&store);
    store_database_path(*state, path);
    assert_int_equal(stat(path, &found), 0);
    assert_int_equal(found.st_mode & 0777, 0600);
    store = store_create(*state);
    store_holds(store, SRV_KIND_VOLUME, "z", "changed é");
    store_holds(store, SRV_KIND_VOLUME, "gone", NULL);
    char *ids = srv_store_ids(store, SRV_KIND_VOLUME);
    assert_memory_equal(ids, "z\0a\0", 5);
    free(ids);
    srv_store_destroy(&store);
}

struct source {
    struct srv_store *store;
    int calls;
    atomic_bool is_short; /* of memory: collects only a part */
};

static bool collect(void *user) {
    struct source *source = user;
    char text[16];
    snprintf(text, sizeof text, "%d", ++source->calls);
    store_put(source->store, SRV_KIND_SESSION, "s", text);
    return !atomic_load(&source->is_short);
}

static void the_writer_collects_before_it_writes(void **state) {
    struct srv_store_options o = store_options(*state);
    o.pause_ms = 1e9;
    struct source source = { .store = srv_store_create(&o, NULL) };
    struct srv_store *store = source.store;
    assert_true(srv_store_start(store, collect, &source, NULL));
    assert_true(store_flush(store));
    for (int i = 0; i < 1000; i++)
        srv_store_nudge(store);
    assert_true(store_flush(store)); /* without waiting for the pause */
    srv_store_destroy(&store);
    /* Two flushes and the end. The nudges caused none. */
    assert_int_equal(source.calls, 3);
    store = store_create(*state);
    store_holds(store, SRV_KIND_SESSION, "s", "3");
    srv_store_destroy(&store);
}

static bool collect_nothing(void *user) {
    return !atomic_load(&((struct source *)user)->is_short);
}

/* A flush is not durable if collecting failed, whether other records were written or not. The
 * writer collects again by itself. */
static void a_failed_collection_is_not_durable(void **state) {
    for (int i = 0; i < 2; i++) {
        struct source source = { .store = store_create(*state) };
        struct srv_store_status status;
        atomic_store(&source.is_short, true);
        assert_true(srv_store_start(source.store, i ? collect_nothing : collect, &source, NULL));
        assert_false(store_flush(source.store));
        srv_store_status(source.store, &status);
        assert_true(status.is_failing);
        assert_non_null(strstr(status.reason, "sessions"));
        atomic_store(&source.is_short, false);
        do
            srv_store_status(source.store, &status);
        while (status.is_failing);
        assert_true(store_flush(source.store));
        struct srv_store *store = source.store; /* collect() still uses the member */
        srv_store_destroy(&store);
    }
}

/* Threads that put, remove, read, nudge and flush at the same time. */
struct store_user {
    struct srv_store *store;
    int number;
};

static void *use_store(void *user) {
    struct store_user *c = user;
    char id[32], text[32];
    for (int i = 0; i < 200; i++) {
        snprintf(id, sizeof id, "%d-%d", c->number, i % 10);
        snprintf(text, sizeof text, "%d", i);
        assert_true(store_put(c->store, SRV_KIND_VIEW, id, text));
        srv_store_nudge(c->store);
        if (i % 7 == 0)
            srv_store_remove(c->store, SRV_KIND_VIEW, id);
        else
            store_holds(c->store, SRV_KIND_VIEW, id, text);
        if (i % 20 == 0)
            assert_true(store_flush(c->store));
    }
    return NULL;
}

static void many_threads_use_the_store(void **state) {
    enum { THREADS = 4 };
    pthread_t threads[THREADS];
    struct store_user users[THREADS];
    struct srv_store *store = store_started(*state);
    for (int t = 0; t < THREADS; t++) {
        users[t] = (struct store_user){ store, t };
        assert_int_equal(pthread_create(&threads[t], NULL, use_store, &users[t]), 0);
    }
    for (int t = 0; t < THREADS; t++)
        pthread_join(threads[t], NULL);
    srv_store_stop(store);
    assert_false(store_flush(store)); /* a stopped store writes nothing and answers at once */
    srv_store_destroy(&store);
    store = store_create(*state);
    store_holds(store, SRV_KIND_VIEW, "3-9", "199");
    srv_store_destroy(&store);
}

/* A damaged record is an error with its id, stays in the database, and ends by put or remove. */
static void a_damaged_record_is_not_returned(void **state) {
    struct srv_store *store = store_started(*state);
    struct sp_error err, why = { .code = SP_ERR_FORMAT, .place = "/camera", .text = "no object" };
    for (int removes = 0; removes < 2; removes++) {
        assert_true(store_put(store, SRV_KIND_VIEW, "v", "{"));
        assert_true(srv_store_is_sound(store, SRV_KIND_VIEW, "v", NULL));
        srv_store_damage(store, SRV_KIND_VIEW, "v", &why);
        assert_null(srv_store_get(store, SRV_KIND_VIEW, "v", NULL, &err));
        assert_int_equal(err.code, SP_ERR_IO);
        assert_non_null(strstr(err.text, "saved view 'v' is damaged: /camera: no object"));
        assert_false(srv_store_is_sound(store, SRV_KIND_VIEW, "v", NULL));
        char *text = srv_store_get_any(store, SRV_KIND_VIEW, "v", NULL, NULL);
        assert_string_equal(text, "{");
        free(text);
        assert_true(store_flush(store));
        if (removes)
            assert_true(srv_store_remove(store, SRV_KIND_VIEW, "v"));
        else
            assert_true(store_put(store, SRV_KIND_VIEW, "v", "{}"));
        store_holds(store, SRV_KIND_VIEW, "v", removes ? NULL : "{}");
        assert_true(srv_store_is_sound(store, SRV_KIND_VIEW, "v", NULL));
    }
    /* Running out of memory is no damage, and a record that does not exist cannot be damaged. */
    why.code = SP_ERR_MEMORY;
    assert_true(store_put(store, SRV_KIND_VIEW, "v", "{}"));
    srv_store_damage(store, SRV_KIND_VIEW, "v", &why);
    store_holds(store, SRV_KIND_VIEW, "v", "{}");
    why.code = SP_ERR_FORMAT;
    srv_store_damage(store, SRV_KIND_VIEW, "none", &why);
    store_holds(store, SRV_KIND_VIEW, "none", NULL);
    srv_store_destroy(&store);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, store_set_up, store_tear_down)
        cmocka_unit_test(a_store_without_folder_holds_records_in_memory),
        TEST(the_table_holds_many_records),
        TEST(records_survive_in_order),
        TEST(the_writer_collects_before_it_writes),
        TEST(a_failed_collection_is_not_durable),
        TEST(many_threads_use_the_store),
        TEST(a_damaged_record_is_not_returned),
    };
    if (store_main_set_up() != 0)
        return 1;
    return cmocka_run_group_tests(tests, NULL, NULL);
}
