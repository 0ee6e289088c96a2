/* SPDX-License-Identifier: Apache-2.0 */
#include "support/render_fixture.h"

#include <sched.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "common/clock.h"

static void on_progress(void *user, const char *id, enum srv_volume_state state, double progress,
                        const char *reason) {
    struct render_fixture *fixture = user;
    (void)progress, (void)reason;
    if (fixture->volume)
        fixture->volume(id, state);
}

static void on_unloaded(void *user, struct sp_volume *volume) {
    srv_render_pool_evict(((struct render_fixture *)user)->render_pool, volume);
}

static void on_work(void *user) {
    srv_render_pool_wake(((struct render_fixture *)user)->render_pool);
}

static void on_ready(void *user) {
    (void)user;
}

static void on_interrupt(void *user, uint64_t of, enum srv_interrupt why) {
    srv_render_pool_interrupt(((struct render_fixture *)user)->render_pool, of, why);
}

static void queue(struct render_fixture *fixture, const char *id, const char *source,
                  char given[SP_NAME_BYTES]) {
    struct srv_volume_request request = { .source = source, .id = id };
    bool existed, conflict;
    assert_true(srv_catalog_add(fixture->catalog, &request, given, &existed, &conflict, NULL));
}

void render_fixture_queue(struct render_fixture *fixture, const char *id, const char *source) {
    char given[SP_NAME_BYTES];
    queue(fixture, id, source, given);
}

enum srv_volume_state render_fixture_try(struct render_fixture *fixture, const char *id,
                                         const char *source) {
    struct srv_volume_status status;
    char given[SP_NAME_BYTES];
    queue(fixture, id, source, given);
    for (;; sched_yield()) {
        assert_true(srv_catalog_find(fixture->catalog, given, &status));
        sp_volume_unref(&status.volume);
        if (status.state != SRV_VOLUME_LOADING)
            return status.state;
    }
}

void render_fixture_load(struct render_fixture *fixture, const char *source) {
    assert_int_equal(render_fixture_try(fixture, NULL, source), SRV_VOLUME_READY);
}

void render_fixture_begin(struct render_fixture *fixture,
                          const struct render_fixture_options *options) {
    struct srv_catalog_options catalog = { .memory_bytes = options->memory_bytes
                                                               ? options->memory_bytes
                                                               : 1 << 20,
                                           .user = fixture,
                                           .progress = on_progress,
                                           .unloaded = on_unloaded };
    fixture->volume = options->volume;
    fixture->catalog = srv_catalog_create(&catalog, NULL);
    assert_non_null(fixture->catalog);
    if (!options->is_empty)
        render_fixture_load(fixture, "demo:phantom?size=8");
    fixture->metrics = srv_metrics_create();
    struct sp_renderer_options null = { .backend = "null" };
    struct sp_renderer *renderer = sp_renderer_create(&null, NULL);
    struct srv_render_pool_options pool = { .catalog = fixture->catalog,
                                            .metrics = fixture->metrics,
                                            .queue_max = options->queue_max,
                                            .encode_threads = options->encode_threads
                                                                  ? options->encode_threads
                                                                  : 1,
                                            .renderer = null };
    fixture->render_pool = srv_render_pool_create(&pool, &renderer, NULL);
    assert_non_null(fixture->render_pool);
    struct srv_hub_options hub = { .volumes = { .user = fixture->catalog,
                                                .acquire = srv_catalog_acquire,
                                                .ref = srv_catalog_ref,
                                                .release = srv_catalog_release,
                                                .default_view = srv_catalog_default_view,
                                                .pick = srv_catalog_pick },
                                   .sessions_max = 2,
                                   .participants_max = 2,
                                   .session_idle_ms = 1e6,
                                   .rest_ms = options->rest_ms,
                                   .stream_bytes = 1 << 20,
                                   .user = fixture,
                                   .ready = on_ready };
    fixture->hub = srv_hub_create(&hub, NULL);
    assert_non_null(fixture->hub);
    const struct srv_schedule_options schedule = { .user = fixture,
                                                   .wake = on_work,
                                                   .interrupt = on_interrupt };
    fixture->schedule = srv_schedule_create(fixture->hub, &schedule, NULL);
    assert_non_null(fixture->schedule);
    assert_true(srv_render_pool_start(fixture->render_pool, fixture->schedule, NULL));
}

void render_fixture_session(struct render_fixture *fixture, char id[SRV_SESSION_ID_BYTES]) {
    proto_json *json =
        srv_hub_session_create(fixture->hub, NULL, &(const struct srv_owner){ .name = "" }, false,
                               srv_clock_ms(), id, NULL);
    assert_non_null(json);
    proto_json_free(&json);
}

struct srv_participant *render_fixture_join(struct render_fixture *fixture, const char *id,
                                            enum srv_role role) {
    struct srv_participant *participant =
        srv_hub_join(fixture->hub, id, role, "", fixture, srv_clock_ms(), NULL);
    assert_non_null(participant);
    return participant;
}

void render_fixture_stop(struct render_fixture *fixture) {
    srv_catalog_stop(fixture->catalog);
    srv_render_pool_stop(fixture->render_pool);
}

void render_fixture_end(struct render_fixture *fixture) {
    render_fixture_stop(fixture);
    srv_hub_destroy(&fixture->hub);
    srv_schedule_destroy(&fixture->schedule);
    srv_render_pool_destroy(&fixture->render_pool);
    srv_catalog_destroy(&fixture->catalog);
    srv_metrics_destroy(&fixture->metrics);
}
