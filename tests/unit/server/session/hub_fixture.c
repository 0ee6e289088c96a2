/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "common/work_queue.h"
#include "unit/server/session/hub_fixture.h"

static struct srv_volume *acquire(void *user, const char *id, struct sp_error *err) {
    struct fixture *f = user;
    if (id && *id && strcmp(id, "v") != 0 && strcmp(id, "w") != 0) {
        sp_fail(err, SP_ERR_VOLUME_UNKNOWN, "/volume", "no volume %s", id);
        return NULL;
    }
    f->uses++;
    return (struct srv_volume *)f; /* any pointer but NULL */
}

static struct srv_volume *add_use(void *user, struct srv_volume *volume) {
    ((struct fixture *)user)->uses++;
    return volume;
}

static void release(void *user, struct srv_volume *volume) {
    (void)volume;
    ((struct fixture *)user)->uses--;
}

static void default_view(void *user, struct srv_volume *volume, struct sp_view *view) {
    (void)volume;
    *view = ((struct fixture *)user)->view;
}

static uint32_t steps(void *user, struct srv_volume *volume) {
    (void)volume;
    return ((struct fixture *)user)->step_count;
}

static struct srv_volume *step(void *user, struct srv_volume *volume, uint32_t number) {
    struct fixture *f = user;
    (void)volume;
    f->uses++;
    return (struct srv_volume *)&f->steps[number];
}

static bool step_is_ready(void *user, struct srv_volume *handle, struct sp_error *err) {
    const struct fixture_step *wanted = (const struct fixture_step *)handle;
    (void)user;
    if (wanted->has_failed)
        return sp_fail(err, SP_ERR_IO, "", "the disk is gone");
    return wanted->is_loaded || sp_fail(err, SP_ERR_NOT_READY, "", "it is loading");
}

static struct srv_volume *nearest_step(void *user, struct srv_volume *volume, uint32_t number) {
    struct fixture *f = user;
    (void)volume;
    while (number > 0 && !f->steps[number].is_loaded)
        number--;
    f->uses++;
    return (struct srv_volume *)&f->steps[number];
}

static bool other_steps(void *user, struct srv_volume *volume, const struct sp_view *view,
                        struct srv_volume *others[2 * SP_LAYERS_MAX], unsigned *count) {
    struct fixture *f = user;
    (void)volume;
    *count = 0;
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (strcmp(view->layers[i].id, "w") == 0 && !f->is_missing)
            others[(*count)++] = (struct srv_volume *)&f->others[view->time.step];
    f->uses += (int)*count;
    return !f->is_out_of_memory;
}

static bool pick(void *user, struct srv_volume *volume, const struct sp_view *view,
                 const uint32_t size[2], const double at[2], struct sp_pick *found,
                 struct sp_error *err) {
    (void)volume;
    (void)view;
    *found = ((struct fixture *)user)->picked;
    found->opacity = at[0] / size[0];
    found->is_hit = found->opacity >= 0.5;
    return found->elements < UINT64_MAX || sp_fail(err, SP_ERR_MEMORY, "", "no memory left");
}

static void ignore(void *user) {
    (void)user;
}

static void count_interrupt(void *user, uint64_t of, enum srv_interrupt why) {
    struct fixture *f = user;
    if (why == SRV_INTERRUPT_MOTION) {
        f->yields++;
    } else {
        f->interrupts++;
        f->why = why;
        f->of = of;
    }
}

static bool measure(void *user, struct srv_volume *volume, const struct sp_view *view,
                    const struct sp_measure *measure, double samples,
                    struct proto_measure_value *value, struct sp_error *err) {
    (void)user;
    (void)volume;
    (void)view;
    (void)samples;
    (void)err;
    value->result = (struct sp_measure_result){ .has_value = true, .value = measure->points[0][0] };
    return true;
}

static bool token(void *user, const char *name, unsigned *rights, struct srv_quota *quota) {
    const struct fixture *f = user;
    if (!f->quota || strcmp(name, "ann") != 0)
        return false;
    *rights = f->rights;
    *quota = *f->quota;
    return true;
}

static int set_up(void **state, uint32_t steps_of_volume) {
    struct fixture *f = calloc(1, sizeof *f);
    if (!f)
        return -1;
    f->info = (struct sp_volume_info){ .type = SP_UINT8, .components = 1, .range = { 0, 255 } };
    for (int i = 0; i < 3; i++) {
        f->info.grid.dims[i] = 8;
        f->info.grid.spacing[i] = 1;
        f->info.grid.direction[i][i] = 1;
    }
    f->info.histogram[3] = 512;
    f->picked = (struct sp_pick){ .position = { 1, 2, 3 }, .value = 7 };
    sp_view_init(&f->view, &f->info, "v"); /* once: it searches the histogram */
    f->metrics = srv_metrics_create();
    f->step_count = f->info.steps.count = steps_of_volume;
    f->steps[0].is_loaded = true;
    f->picking = srv_work_queue_create("test", 0, NULL);
    assert_non_null(f->picking);
    srv_work_queue_stop(f->picking);
    struct srv_hub_options options = { .volumes = { .user = f,
                                                    .acquire = acquire,
                                                    .ref = add_use,
                                                    .release = release,
                                                    .steps = steps,
                                                    .step = step,
                                                    .step_is_ready = step_is_ready,
                                                    .nearest_step = nearest_step,
                                                    .other_steps = other_steps,
                                                    .default_view = default_view,
                                                    .pick = pick,
                                                    .measure = measure },
                                       .token = token,
                                       .sessions_max = 3,
                                       .participants_max = 3,
                                       .session_idle_ms = 1000,
                                       .control_ms = 500,
                                       .rest_ms = 100,
                                       .stream_bytes = 1 << 20,
                                       .metrics = f->metrics,
                                       .picking = f->picking,
                                       .user = f,
                                       .ready = ignore };
    const struct srv_schedule_options schedule = { .user = f,
                                                   .wake = ignore,
                                                   .interrupt = count_interrupt };
    f->hub = srv_hub_create(&options, NULL);
    f->schedule = srv_schedule_create(f->hub, &schedule, NULL);
    proto_json *json = srv_hub_session_create(f->hub, NULL, &(const struct srv_owner){ .name = "" },
                                              false, 0, f->id, NULL);
    proto_json_free(&json);
    *state = f;
    return 0;
}

int hub_set_up(void **state) {
    return set_up(state, 1);
}

int hub_set_up_series(void **state) {
    return set_up(state, 4);
}

int hub_tear_down(void **state) {
    struct fixture *f = *state;
    srv_hub_destroy(&f->hub);
    srv_schedule_destroy(&f->schedule);
    srv_metrics_destroy(&f->metrics);
    srv_work_queue_destroy(&f->picking);
    int uses = f->uses;
    free(f);
    return uses; /* every use was given back */
}

struct srv_participant *hub_join(struct fixture *f, enum srv_role role, double now_ms) {
    struct srv_participant *p = srv_hub_join(f->hub, f->id, role, "", f, now_ms, NULL);
    assert_non_null(p);
    return p;
}

void hub_update(struct fixture *f, struct srv_participant *p, unsigned seq, double now_ms) {
    char text[160], *answer;
    size_t size;
    snprintf(text, sizeof text,
             "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"view.update\",\"params\":{\"seq\":%u,"
             "\"patch\":{\"background\":[0.%u,0,0,1]}}}",
             seq, seq);
    assert_true(srv_hub_message(f->hub, p, text, strlen(text), now_ms, &answer, &size));
    assert_non_null(strstr(answer, "\"result\""));
    free(answer);
}

void hub_ack(struct fixture *f, struct srv_participant *p, unsigned frame, double now_ms) {
    char text[120], *answer;
    size_t size;
    snprintf(text, sizeof text,
             "{\"jsonrpc\":\"2.0\",\"method\":\"stream.ack\",\"params\":{\"frame\":%u}}", frame);
    assert_true(srv_hub_message(f->hub, p, text, strlen(text), now_ms, &answer, &size));
    assert_null(answer);
}

bool hub_next_job(struct fixture *f, double now_ms, struct srv_render_job *job) {
    double wait_ms;
    return srv_schedule_next(f->schedule, now_ms, job, &wait_ms);
}

void hub_finish(struct fixture *f, struct srv_render_job *job, double render_ms) {
    struct proto_frame_header header = { .codec = PROTO_CODEC_JPEG,
                                         .width = (uint16_t)job->view.size[0],
                                         .height = (uint16_t)job->view.size[1] };
    struct srv_render_result result = { .width = job->view.size[0],
                                        .height = job->view.size[1],
                                        .is_draft = job->is_draft && f->draws_drafts,
                                        .has_depth = f->has_depth,
                                        .render_ms = render_ms };
    struct srv_blob *blob = srv_blob_create(NULL, NULL, (const uint8_t *)"image", 5, NULL);
    const struct srv_drawn_frame frame = srv_render_job_frame(job);
    for (uint32_t i = 0; i < job->target_count; i++)
        srv_hub_deliver(f->hub, &frame, &job->targets[i], &header, blob);
    srv_blob_unref(&blob);
    srv_schedule_done(f->schedule, job, &result);
}

struct proto_frame_header hub_drain(struct fixture *f, struct srv_participant *p, double now_ms) {
    struct proto_frame_header last = { .frame = 0 };
    struct srv_message message;
    enum srv_message_kind kind;
    while ((kind = srv_hub_next_message(f->hub, p, SRV_NEXT_ALL, now_ms, &message)) !=
           SRV_MESSAGE_NONE) {
        assert_int_not_equal(kind, SRV_MESSAGE_CLOSE);
        if (kind == SRV_MESSAGE_FRAME)
            last = message.header;
        free(message.text);
        srv_blob_unref(&message.blob);
    }
    return last;
}

void hub_send(struct fixture *f, struct srv_participant *p, const char *method, const char *params,
              double now_ms) {
    char text[200], *answer;
    size_t size;
    snprintf(text, sizeof text, "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"%s\",\"params\":%s}",
             method, params);
    assert_true(srv_hub_message(f->hub, p, text, strlen(text), now_ms, &answer, &size));
    assert_non_null(strstr(answer, "\"result\""));
    free(answer);
}

struct srv_render_job hub_drag(struct fixture *f, struct srv_participant *p, unsigned seq,
                               double now_ms, double render_ms) {
    struct srv_render_job job;
    hub_update(f, p, seq, now_ms);
    assert_true(hub_next_job(f, now_ms, &job));
    struct srv_render_job copy = job;
    hub_finish(f, &job, render_ms);
    hub_ack(f, p, hub_drain(f, p, now_ms + render_ms).frame, now_ms + render_ms + 1);
    return copy;
}

/* The time of the first frame is measured, the second frame has full detail, and no frame follows.
 */
void hub_drag_until_final(struct fixture *f, struct srv_participant *p) {
    struct srv_render_job job;
    assert_true(hub_next_job(f, 0, &job));
    hub_finish(f, &job, 5);
    hub_ack(f, p, hub_drain(f, p, 10).frame, 11);
    job = hub_drag(f, p, 1, 100, 5);
    assert_int_equal(job.step, SRV_STEP_MOVING);
    assert_true(job.is_sharp);
    assert_true(job.targets[0].final);
    assert_false(hub_next_job(f, 5000, &job));
}
