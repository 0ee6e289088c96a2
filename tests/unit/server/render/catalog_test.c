/* SPDX-License-Identifier: Apache-2.0
 *
 * Volumes that are removed while they load, and the paths that clients see. The linker replaces
 * sp_volume_load(): the load of ENDLESS, and of each step of SERIES but the first, runs until it is
 * cancelled. FAST_SERIES is a series whose steps all load.
 */
#include <pthread.h>
#include <sched.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "render/catalog.h"
#include "render/redact.h"

enum { BYTES = 1000 };
#define ENDLESS "demo:phantom?size=9"
#define SERIES "demo:phantom?size=10"
#define FAST_SERIES "demo:phantom?size=11"
#define SLOW                                                                                       \
    "demo:engine?size=" /* how such sources begin: their loads run until they are cancelled */
enum { STEPS = 8 };     /* of both: more than there are load threads */

static struct {
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    bool is_loading;
    unsigned cancelled, unloaded;
    unsigned steps;              /* notifications of steps */
    unsigned reserved;           /* after the load was cancelled */
    enum srv_volume_state state; /* of the newest notification */
} seen = { .mutex = PTHREAD_MUTEX_INITIALIZER, .changed = PTHREAD_COND_INITIALIZER };

static atomic_bool are_slow_loads_failing;

struct sp_volume *__real_sp_volume_load(const char *path, const struct sp_load_options *options,
                                        struct sp_error *err);
struct sp_volume *__wrap_sp_volume_load(const char *path, const struct sp_load_options *options,
                                        struct sp_error *err);

static struct sp_volume *load_series(const char *path, const struct sp_load_options *options,
                                     struct sp_error *err) {
    const bool is_fast = strcmp(path, FAST_SERIES) == 0;
    while (!is_fast && options->step > 0 && options->progress(options->user, 0.5))
        sched_yield();
    if (!is_fast && options->step > 0) {
        sp_fail(err, SP_ERR_CANCELLED, NULL, "cancelled");
        return NULL;
    }
    struct sp_volume *volume = __real_sp_volume_load(path, options, err);
    if (volume)
        ((struct sp_volume_info *)sp_volume_info(volume))->steps.count = STEPS;
    return volume;
}

struct sp_volume *__wrap_sp_volume_load(const char *path, const struct sp_load_options *options,
                                        struct sp_error *err) {
    if (strcmp(path, SERIES) == 0 || strcmp(path, FAST_SERIES) == 0)
        return load_series(path, options, err);
    if (strncmp(path, SLOW, strlen(SLOW)) == 0 && are_slow_loads_failing) {
        sp_fail(err, SP_ERR_IO, NULL, "cannot read");
        return NULL;
    }
    while (strncmp(path, SLOW, strlen(SLOW)) == 0)
        if (!options->progress(options->user, 0.5)) {
            sp_fail(err, SP_ERR_CANCELLED, NULL, "cancelled");
            return NULL;
        }
    if (strcmp(path, ENDLESS) != 0)
        return __real_sp_volume_load(path, options, err);
    assert_true(options->reserve(options->user, BYTES, err));
    pthread_mutex_lock(&seen.mutex);
    seen.is_loading = true;
    pthread_cond_broadcast(&seen.changed);
    pthread_mutex_unlock(&seen.mutex);
    while (options->progress(options->user, 0.5))
        sched_yield();
    const bool is_reserved = options->reserve(options->user, BYTES, err);
    pthread_mutex_lock(&seen.mutex);
    seen.reserved += is_reserved;
    seen.cancelled++;
    pthread_cond_broadcast(&seen.changed);
    pthread_mutex_unlock(&seen.mutex);
    sp_fail(err, SP_ERR_CANCELLED, NULL, "cancelled");
    return NULL;
}

static void on_progress(void *user, const char *id, enum srv_volume_state state, double progress,
                        const char *reason) {
    (void)user, (void)progress, (void)reason;
    assert_string_equal(id, "v");
    pthread_mutex_lock(&seen.mutex);
    seen.state = state;
    seen.unloaded += state == SRV_VOLUME_UNLOADED;
    pthread_cond_broadcast(&seen.changed);
    pthread_mutex_unlock(&seen.mutex);
}

static void on_unloaded(void *user, struct sp_volume *volume) {
    (void)user;
    sp_volume_unref(&volume);
}

static void wait_for(enum srv_volume_state state) {
    pthread_mutex_lock(&seen.mutex);
    while (seen.state != state)
        pthread_cond_wait(&seen.changed, &seen.mutex);
    pthread_mutex_unlock(&seen.mutex);
}

/* Waits until ENDLESS is being loaded. */
static void wait_for_load(void) {
    pthread_mutex_lock(&seen.mutex);
    while (!seen.is_loading)
        pthread_cond_wait(&seen.changed, &seen.mutex);
    seen.is_loading = false;
    pthread_mutex_unlock(&seen.mutex);
}

/* Waits until so many loads of ENDLESS were cancelled. */
static void wait_for_cancelled(unsigned count) {
    pthread_mutex_lock(&seen.mutex);
    while (seen.cancelled < count)
        pthread_cond_wait(&seen.changed, &seen.mutex);
    pthread_mutex_unlock(&seen.mutex);
}

static void add(struct srv_catalog *catalog, const char *source) {
    const struct srv_volume_request request = { .source = source, .id = "v" };
    char id[SP_NAME_BYTES];
    bool existed, conflict;
    assert_true(srv_catalog_add(catalog, &request, id, &existed, &conflict, NULL));
    assert_false(existed);
}

static uint64_t used_bytes(struct srv_catalog *catalog) {
    uint64_t used, budget, subvolumes;
    srv_catalog_memory(catalog, &used, &budget, &subvolumes);
    return used;
}

static void a_volume_can_be_removed_while_it_loads(void **state) {
    (void)state;
    const struct srv_catalog_options options = { .memory_bytes = 1 << 20,
                                                 .progress = on_progress,
                                                 .unloaded = on_unloaded };
    struct srv_catalog *catalog = srv_catalog_create(&options, NULL);
    struct srv_volume_status status;
    assert_non_null(catalog);
    for (unsigned round = 1; round <= 3; round++) {
        add(catalog, ENDLESS);
        wait_for_load();
        assert_int_equal(used_bytes(catalog), BYTES);
        assert_true(srv_catalog_remove(catalog, "v", NULL, NULL));
        assert_false(srv_catalog_find(catalog, "v", &status));
        assert_int_equal(used_bytes(catalog), 0);
        /* Another load thread may load another volume with this id meanwhile. */
        add(catalog, "demo:phantom?size=8");
        wait_for(SRV_VOLUME_READY);
        wait_for_cancelled(round);
        assert_int_equal(seen.reserved, 0); /* a removed volume reserves no memory */
        assert_int_equal(used_bytes(catalog), 8 * 8 * 8 * sizeof(float));
        assert_true(srv_catalog_remove(catalog, "v", NULL, NULL));
        assert_int_equal(seen.unloaded, 2 * round);
        assert_int_equal(used_bytes(catalog), 0);
    }
    /* Destroying the catalog also cancels a load. */
    add(catalog, ENDLESS);
    wait_for_load();
    srv_catalog_destroy(&catalog);
}

static void count_steps(void *user, const char *id) {
    (void)user;
    assert_string_equal(id, "v");
    pthread_mutex_lock(&seen.mutex);
    seen.steps++;
    pthread_cond_broadcast(&seen.changed);
    pthread_mutex_unlock(&seen.mutex);
}

/* Steps that wait and steps that are being loaded both fail: no request waits for ever. */
static void steps_of_a_removed_volume_fail(void **state) {
    (void)state;
    const struct srv_catalog_options options = { .memory_bytes = 1 << 20,
                                                 .progress = on_progress,
                                                 .unloaded = on_unloaded,
                                                 .step = count_steps };
    struct srv_catalog *catalog = srv_catalog_create(&options, NULL);
    struct sp_error err;
    void *steps[STEPS];
    seen.state = SRV_VOLUME_LOADING;
    add(catalog, SERIES);
    wait_for(SRV_VOLUME_READY);
    struct srv_volume *volume = srv_catalog_acquire(catalog, "v", &err);
    for (uint32_t i = 1; i < STEPS - 1; i++)
        steps[i] = srv_catalog_step(catalog, volume, i);
    assert_true(srv_catalog_remove(catalog, "v", NULL, NULL));
    steps[STEPS - 1] = srv_catalog_step(catalog, volume, STEPS - 1); /* asked for after that */
    for (uint32_t i = 1; i < STEPS; i++) {
        err.code = SP_ERR_NOT_READY;
        while (err.code == SP_ERR_NOT_READY) {
            assert_false(srv_catalog_step_is_ready(catalog, steps[i], &err));
            sched_yield();
        }
        assert_int_equal(err.code, SP_ERR_VOLUME_UNKNOWN);
        srv_catalog_release(catalog, steps[i]);
    }
    srv_catalog_release(catalog, volume);
    srv_catalog_destroy(&catalog);
    assert_in_range(seen.steps, 1, STEPS); /* count_steps() was called for the steps that failed */
}

static unsigned count_notifications(unsigned least) {
    pthread_mutex_lock(&seen.mutex);
    while (seen.steps < least)
        pthread_cond_wait(&seen.changed, &seen.mutex);
    const unsigned steps = seen.steps;
    pthread_mutex_unlock(&seen.mutex);
    return steps;
}

/* Asks for a step as a slice does, a few times: again when a load has ended. */
static bool comes_to_have_step(struct srv_catalog *catalog, uint32_t number) {
    struct srv_volume *step = NULL;
    for (int i = 0; i < 20 && !step; i++) {
        struct sp_error err;
        struct srv_volume *volume = srv_catalog_acquire(catalog, "v", &err);
        const unsigned steps = count_notifications(0);
        step = srv_catalog_ready_step(catalog, volume, number, &err);
        if (!step)
            count_notifications(steps + 1);
    }
    if (step)
        srv_catalog_release(catalog, step);
    return step;
}

/* Memory for three steps, of which two were loaded ahead: a client that asks for another one gets
 * it. */
static void steps_ahead_leave_memory(void **state) {
    (void)state;
    const struct srv_catalog_options options = { .memory_bytes = 3 * 5376 + 100,
                                                 .progress = on_progress,
                                                 .unloaded = on_unloaded,
                                                 .step = count_steps };
    struct srv_catalog *catalog = srv_catalog_create(&options, NULL);
    seen.state = SRV_VOLUME_LOADING;
    seen.steps = 0;
    add(catalog, FAST_SERIES);
    wait_for(SRV_VOLUME_READY);
    for (uint32_t i = 0; i < 200; i++) /* to and fro: other steps are ahead each time */
        assert_true(comes_to_have_step(catalog, i % 2 ? i * 5 % STEPS : 0));
    srv_catalog_destroy(&catalog);
}

static void ignore_progress(void *user, const char *id, enum srv_volume_state state,
                            double progress, const char *reason) {
    (void)user, (void)id, (void)state, (void)progress, (void)reason;
}

/* A token may load eight volumes at a time. After a restart all of its volumes load again. */
static void volumes_of_an_earlier_run_are_not_limited(void **state) {
    (void)state;
    const struct srv_catalog_options options = { .memory_bytes = 1 << 20,
                                                 .progress = ignore_progress,
                                                 .unloaded = on_unloaded };
    struct srv_catalog *catalog = srv_catalog_create(&options, NULL);
    assert_non_null(catalog);
    char first[SP_NAME_BYTES] = "";
    for (int i = 0; i < 12; i++) {
        char source[32], id[SP_NAME_BYTES];
        struct srv_volume_request request = { .source = source,
                                              .owner = "ann",
                                              .is_limited = true };
        struct sp_error err = { 0 };
        bool existed, conflict;
        snprintf(source, sizeof source, "demo:phantom?size=%d", 9 + i); /* the first is ENDLESS */
        bool is_added = srv_catalog_add(catalog, &request, id, &existed, &conflict, &err);
        assert_int_equal(is_added, i < 8);
        if (i == 0)
            memcpy(first, id, sizeof first);
        request.is_restored = true;
        if (is_added)
            continue;
        assert_int_equal(err.code, SP_ERR_QUOTA);
        assert_true(srv_catalog_add(catalog, &request, id, &existed, &conflict, &err));
    }
    wait_for_load();
    assert_true(srv_catalog_remove(catalog, first, NULL, NULL)); /* ENDLESS ends */
    srv_catalog_destroy(&catalog);
}

static void on_any_progress(void *user, const char *id, enum srv_volume_state state,
                            double progress, const char *reason) {
    (void)user, (void)progress, (void)reason;
    pthread_mutex_lock(&seen.mutex);
    if (strcmp(id, "small") == 0)
        seen.state = state;
    pthread_cond_broadcast(&seen.changed);
    pthread_mutex_unlock(&seen.mutex);
}

static void open_as(struct srv_catalog *catalog, const char *owner, const char *source,
                    const char *id) {
    const struct srv_volume_request request = {
        .source = source, .id = id, .owner = owner, .is_limited = true
    };
    char id_out[SP_NAME_BYTES];
    struct sp_error err;
    bool existed, conflict;
    if (!srv_catalog_add(catalog, &request, id_out, &existed, &conflict, &err))
        fail_msg("%s: %s", err.place, err.text);
}

static enum srv_volume_state state_of(struct srv_catalog *catalog, const char *id) {
    struct srv_volume_status status = { .state = SRV_VOLUME_LOADING };
    for (unsigned i = 0; srv_catalog_at(catalog, i, &status); i++) {
        sp_volume_unref(&status.volume);
        if (strcmp(status.id, id) == 0)
            return status.state;
    }
    return SRV_VOLUME_UNLOADED;
}

/* The time steps that an owner's clients use count as this owner's memory: a volume of another
 * owner still fits. */
static void time_steps_count_for_their_owner(void **state) {
    (void)state;
    const struct srv_catalog_options options = { .memory_bytes = STEPS * 5376,
                                                 .progress = ignore_progress,
                                                 .unloaded = on_unloaded };
    struct srv_catalog *catalog = srv_catalog_create(&options, NULL);
    struct srv_volume *steps[STEPS];
    struct sp_error err;
    unsigned ready = 0;
    open_as(catalog, "ann", FAST_SERIES, "series");
    while (state_of(catalog, "series") == SRV_VOLUME_LOADING)
        sched_yield();
    struct srv_volume *volume = srv_catalog_acquire(catalog, "series", &err);
    for (uint32_t i = 1; i < STEPS; i++)
        steps[i] = srv_catalog_step(catalog, volume, i);
    while (ready < 5) { /* with its first one three quarters */
        ready = 0;
        for (uint32_t i = 1; i < STEPS; i++)
            ready += srv_catalog_step_is_ready(catalog, steps[i], &err);
        sched_yield();
    }
    open_as(catalog, "bob", "demo:checkerboard?size=11", "bobs");
    while (state_of(catalog, "bobs") == SRV_VOLUME_LOADING)
        sched_yield();
    assert_int_equal(state_of(catalog, "bobs"), SRV_VOLUME_READY);
    for (uint32_t i = 1; i < STEPS; i++)
        srv_catalog_release(catalog, steps[i]);
    srv_catalog_release(catalog, volume);
    srv_catalog_destroy(&catalog);
}

/* Eight endless loads of one owner do not occupy all load threads: a volume of a second owner still
 * loads. A volume of a third owner loads beside endless loads of the other two. */
static void loads_of_one_owner_leave_threads_to_others(void **state) {
    (void)state;
    const struct srv_catalog_options options = { .memory_bytes = 1 << 20,
                                                 .progress = on_any_progress,
                                                 .unloaded = on_unloaded };
    struct srv_catalog *catalog = srv_catalog_create(&options, NULL);
    char source[32], id[8];
    for (int i = 0; i < 8; i++) {
        snprintf(source, sizeof source, SLOW "%d", 20 + i);
        snprintf(id, sizeof id, "%d", i);
        open_as(catalog, "ann", source, id);
    }
    seen.state = SRV_VOLUME_LOADING;
    open_as(catalog, "bob", "demo:phantom?size=8", "small");
    wait_for(SRV_VOLUME_READY);
    assert_true(srv_catalog_remove(catalog, "small", "bob", NULL));
    open_as(catalog, "bob", SLOW "40", "slow");
    open_as(catalog, "bob", SLOW "41", "slow-2");
    open_as(catalog, "cy", "demo:phantom?size=8", "small");
    wait_for(SRV_VOLUME_READY);
    srv_catalog_destroy(&catalog);
}

enum { LOADS_MAX = 8 }; /* of one limited owner */

static void wait_for_failed(struct srv_catalog *catalog, unsigned count) {
    for (unsigned failed = 0; failed < count; sched_yield()) {
        struct srv_volume_status status;
        failed = 0;
        for (unsigned i = 0; srv_catalog_at(catalog, i, &status); i++)
            failed += status.state == SRV_VOLUME_FAILED;
    }
}

static char persisted_owner[SRV_TOKEN_NAME_BYTES]; /* of the volume "0" */

static bool persist_owner(void *user, const char *id, const struct srv_volume_request *request) {
    (void)user;
    if (strcmp(id, "0") == 0)
        snprintf(persisted_owner, sizeof persisted_owner, "%s", request ? request->owner : "");
    return true;
}

/* A volume that failed is loaded again for the owner that asks. Whoever opened it first, it then
 * belongs to this owner and counts against its limit. */
static void a_repeated_load_counts_for_who_asks(void **state) {
    (void)state;
    const struct srv_catalog_options options = { .memory_bytes = 1 << 20,
                                                 .progress = ignore_progress,
                                                 .unloaded = on_unloaded,
                                                 .persist = persist_owner };
    struct srv_catalog *catalog = srv_catalog_create(&options, NULL);
    struct srv_volume_status status;
    struct sp_error err;
    char source[32], id[SP_NAME_BYTES];
    bool existed, conflict;
    are_slow_loads_failing = true;
    for (int i = 0; i < LOADS_MAX + 2; i++) {
        snprintf(source, sizeof source, SLOW "%d", 20 + i);
        snprintf(id, sizeof id, "%d", i);
        /* From an earlier run: the record stays although the load fails. */
        const struct srv_volume_request first = {
            .source = source, .id = id, .owner = "ann", .is_limited = true, .is_restored = true
        };
        assert_true(srv_catalog_add(catalog, &first, id, &existed, &conflict, &err));
        wait_for_failed(catalog, i + 1);
    }
    are_slow_loads_failing = false;
    struct srv_volume_request request = { .source = source, .owner = "bob", .is_limited = true };
    for (int i = 0; i < LOADS_MAX + 2; i++) {
        snprintf(source, sizeof source, SLOW "%d", 20 + i);
        const bool ok = srv_catalog_add(catalog, &request, id, &existed, &conflict, &err);
        assert_int_equal(ok, i < LOADS_MAX);
        assert_false(existed);
        if (!ok)
            assert_int_equal(err.code, SP_ERR_QUOTA);
    }
    assert_true(srv_catalog_find(catalog, "0", &status));
    assert_string_equal(status.owner, "bob");
    assert_string_equal(persisted_owner, "bob");
    assert_true(srv_catalog_find(catalog, "8", &status)); /* it was refused: nothing changed */
    assert_string_equal(status.owner, "ann");
    assert_int_equal(status.state, SRV_VOLUME_FAILED);
    assert_false(srv_catalog_remove(catalog, "0", "ann", &err));
    request.owner = "ann"; /* bob's loads are not hers */
    assert_true(srv_catalog_add(catalog, &request, id, &existed, &conflict, &err));
    request.volumes_max = 1; /* the volume itself counts once */
    snprintf(source, sizeof source, SLOW "%d", 28);
    assert_false(srv_catalog_add(catalog, &request, id, &existed, &conflict, &err));
    assert_true(srv_catalog_remove(catalog, "9", "ann", &err));
    assert_true(srv_catalog_add(catalog, &request, id, &existed, &conflict, &err));
    srv_catalog_destroy(&catalog);
}

/* Counting takes tens of milliseconds, so a second client must not pay for it again. */
static void a_joint_histogram_is_counted_once(void **state) {
    (void)state;
    const struct srv_catalog_options options = { .memory_bytes = 1 << 20,
                                                 .progress = on_progress,
                                                 .unloaded = on_unloaded };
    struct srv_catalog *catalog = srv_catalog_create(&options, NULL);
    struct sp_error err;
    seen.state = SRV_VOLUME_LOADING;
    add(catalog, "demo:phantom?size=8");
    wait_for(SRV_VOLUME_READY);
    struct srv_volume *volume = srv_catalog_acquire(catalog, "v", &err);
    assert_non_null(volume);
    const struct sp_joint_histogram *joint = srv_catalog_joint_histogram(catalog, volume, &err);
    assert_non_null(joint);
    assert_int_equal(joint->samples, 8 * 8 * 8);
    assert_ptr_equal(srv_catalog_joint_histogram(catalog, volume, &err), joint);
    srv_catalog_release(catalog, volume);
    srv_catalog_destroy(&catalog);
}

static void paths_are_redacted(void **state) {
    (void)state;
    static const struct {
        const char *data, *source, *redacted, *text, *redacted_text;
    } cases[] = {
        { "/srv/data", "/srv/data/a/b.vti", "a/b.vti",
          "/srv/data/a/b.vti: lies outside the folder /srv/data that files are read from",
          "a/b.vti: lies outside the folder --data that files are read from" },
        { "/srv/data", "/home/x/b.vti", "b.vti", "/home/x/b.vti: cannot open '/home/x/c.raw'",
          "b.vti: cannot open 'c.raw'" },
        { "/srv/data", "/srv/database/b.vti", "b.vti", "/srv/database/b.vti is bad",
          "b.vti is bad" },
        { "/srv/data", "demo:engine?size=8", "demo:engine?size=8", "demo:engine", "demo:engine" },
        { NULL, "/b.vti", "b.vti", "/b.vti: no", "/b.vti: no" },
        { "/", "/srv/b.vti", "b.vti", "/srv/b.vti in /srv", "b.vti in its folder" },
        { "/srv/data", "/home/x/b.vti", "b.vti", "/etc/a.raw: lies outside of /home/x",
          "/etc/a.raw: lies outside of its folder" },
        { "/d", "/d/x.vti", "x.vti", "1/d/x.vti and /d/x.vti", "1/d/x.vti and x.vti" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[128], source[128];
        srv_redact_source(cases[i].data, cases[i].source, source, sizeof source);
        assert_string_equal(source, cases[i].redacted);
        snprintf(text, sizeof text, "%s", cases[i].text);
        srv_redact_text(cases[i].data, cases[i].source, text, sizeof text);
        assert_string_equal(text, cases[i].redacted_text);
    }
    char small[8];
    srv_redact_folder("/a", "--data", "in /a /a/bcdefghij", small, sizeof small);
    assert_string_equal(small, "in --da");
    srv_redact_folder("/a", "x", "/a/bcdefghij", small, sizeof small);
    assert_string_equal(small, "bcdefgh");
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(a_volume_can_be_removed_while_it_loads),
                                        cmocka_unit_test(steps_of_a_removed_volume_fail),
                                        cmocka_unit_test(steps_ahead_leave_memory),
                                        cmocka_unit_test(volumes_of_an_earlier_run_are_not_limited),
                                        cmocka_unit_test(time_steps_count_for_their_owner),
                                        cmocka_unit_test(
                                            loads_of_one_owner_leave_threads_to_others),
                                        cmocka_unit_test(a_repeated_load_counts_for_who_asks),
                                        cmocka_unit_test(a_joint_histogram_is_counted_once),
                                        cmocka_unit_test(paths_are_redacted) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
