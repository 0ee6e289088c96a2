/* SPDX-License-Identifier: Apache-2.0 */
#include "support/lanes.h"

#include <sched.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "common/clock.h"

static void on_progress(void *user, const char *id, const char *state, double progress,
                        const char *reason) {
    struct lanes *lanes = user;
    (void)progress, (void)reason;
    if (lanes->volume)
        lanes->volume(id, state);
}

static void on_unloaded(void *user, struct sp_volume *volume) {
    srv_scheduler_forget(((struct lanes *)user)->scheduler, volume);
}

static void on_work(void *user) {
    srv_scheduler_wake(((struct lanes *)user)->scheduler);
}

static void on_ready(void *user) {
    (void)user;
}

static void on_interrupt(void *user, uint64_t of, enum srv_interrupt why) {
    srv_scheduler_interrupt(((struct lanes *)user)->scheduler, of, why);
}

static void queue(struct lanes *lanes, const char *id, const char *source,
                  char given[SP_NAME_BYTES]) {
    struct srv_volume_request request = { .source = source, .id = id };
    bool existed, conflict;
    assert_true(srv_catalog_add(lanes->catalog, &request, given, &existed, &conflict, NULL));
}

void lanes_queue(struct lanes *lanes, const char *id, const char *source) {
    char given[SP_NAME_BYTES];
    queue(lanes, id, source, given);
}

enum srv_volume_state lanes_try(struct lanes *lanes, const char *id, const char *source) {
    struct srv_volume_status status;
    char given[SP_NAME_BYTES];
    queue(lanes, id, source, given);
    for (;; sched_yield()) {
        assert_true(srv_catalog_find(lanes->catalog, given, &status));
        sp_volume_unref(&status.volume);
        if (status.state != SRV_VOLUME_LOADING)
            return status.state;
    }
}

void lanes_load(struct lanes *lanes, const char *source) {
    assert_int_equal(lanes_try(lanes, NULL, source), SRV_VOLUME_READY);
}

void lanes_begin(struct lanes *lanes, const struct lanes_options *options) {
    struct srv_catalog_options catalog = { .memory_bytes = options->memory_bytes
                                                               ? options->memory_bytes
                                                               : 1 << 20,
                                           .user = lanes,
                                           .progress = on_progress,
                                           .unloaded = on_unloaded };
    lanes->volume = options->volume;
    lanes->catalog = srv_catalog_create(&catalog, NULL);
    assert_non_null(lanes->catalog);
    if (!options->is_empty)
        lanes_load(lanes, "demo:phantom?size=8");
    lanes->metrics = srv_metrics_create();
    struct sp_renderer_options null = { .backend = "null" };
    struct sp_renderer *renderer = sp_renderer_create(&null, NULL);
    struct srv_scheduler_options scheduler = { .catalog = lanes->catalog,
                                               .metrics = lanes->metrics,
                                               .queue_max = options->queue_max,
                                               .encode_threads = options->encode_threads
                                                                     ? options->encode_threads
                                                                     : 1,
                                               .stills = null };
    lanes->scheduler = srv_scheduler_create(&scheduler, &renderer, NULL);
    assert_non_null(lanes->scheduler);
    struct srv_hub_options hub = { .volumes = { lanes->catalog, srv_catalog_acquire,
                                                srv_catalog_ref, srv_catalog_release,
                                                srv_catalog_default_view, srv_catalog_pick },
                                   .sessions_max = 2,
                                   .participants_max = 2,
                                   .session_idle_ms = 1e6,
                                   .rest_ms = options->rest_ms,
                                   .stream_bytes = 1 << 20,
                                   .user = lanes,
                                   .work = on_work,
                                   .ready = on_ready,
                                   .interrupt = on_interrupt };
    lanes->hub = srv_hub_create(&hub, NULL);
    assert_non_null(lanes->hub);
    assert_true(srv_scheduler_start(lanes->scheduler, lanes->hub, NULL));
}

void lanes_session(struct lanes *lanes, char id[SRV_SESSION_ID_BYTES]) {
    proto_json *json = srv_hub_session_create(lanes->hub, NULL, srv_clock_ms(), id, NULL);
    assert_non_null(json);
    proto_json_free(&json);
}

struct srv_participant *lanes_join(struct lanes *lanes, const char *id, enum srv_role role) {
    struct srv_participant *participant =
        srv_hub_join(lanes->hub, id, role, "", lanes, srv_clock_ms(), NULL);
    assert_non_null(participant);
    return participant;
}

void lanes_stop(struct lanes *lanes) {
    srv_catalog_stop(lanes->catalog);
    srv_scheduler_stop(lanes->scheduler);
}

void lanes_end(struct lanes *lanes) {
    lanes_stop(lanes);
    srv_hub_destroy(&lanes->hub);
    srv_scheduler_destroy(&lanes->scheduler);
    srv_catalog_destroy(&lanes->catalog);
    srv_metrics_destroy(&lanes->metrics);
}
