/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "support/compare.h"
#include "unit/server/schedule/simulation.h"

void sim_send(struct simulation *s, struct sim_client *c, const char *method, const char *params) {
    char text[256], *answer;
    size_t size;
    snprintf(text, sizeof text, "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"%s\",\"params\":%s}",
             method, params);
    assert_true(
        srv_hub_message(s->f->hub, c->participant, text, strlen(text), s->now_ms, &answer, &size));
    assert_non_null(strstr(answer, "\"result\""));
    free(answer);
}

struct sim_client *sim_join(struct simulation *s, unsigned i, const char *id, double period_ms,
                            const char *settings) {
    struct sim_client *c = &s->clients[i];
    *c = (struct sim_client){ .period_ms = period_ms, .next_ms = s->now_ms + period_ms + i };
    c->participant = srv_hub_join(s->f->hub, id, SRV_ROLE_CONTROL, "", c, s->now_ms, NULL);
    assert_non_null(c->participant);
    sim_send(s, c, "stream.configure", settings);
    return c;
}

void sim_session(struct simulation *s, char id[SRV_SESSION_ID_BYTES]) {
    sim_session_of(s, "", id);
}

void sim_session_of(struct simulation *s, const char *name, char id[SRV_SESSION_ID_BYTES]) {
    struct srv_owner owner = { .name = "" };
    snprintf(owner.name, sizeof owner.name, "%s", name);
    proto_json *json = srv_hub_session_create(s->f->hub, NULL, &owner, false, s->now_ms, id, NULL);
    assert_non_null(json);
    proto_json_free(&json);
}

bool sim_is_for(const struct srv_render_job *job, const struct sim_client *c) {
    for (uint32_t i = 0; c->participant && i < job->target_count; i++)
        if (job->targets[i].participant == srv_participant_id(c->participant))
            return true;
    return false;
}

static void add_time(struct simulation *s) {
    for (int i = 0; i < SIM_CLIENTS; i++)
        if (sim_is_for(&s->job, &s->clients[i]))
            s->clients[i].took_ms += s->now_ms - s->begun_ms;
    s->end_ms = INFINITY;
}

void sim_ack(struct simulation *s, struct sim_client *c, uint32_t frame) {
    char text[64];
    snprintf(text, sizeof text, "{\"frame\":%u}", frame);
    sim_send(s, c, "stream.ack", text);
}

void sim_receive(struct simulation *s, struct sim_client *c, bool acks) {
    struct srv_message message;
    while (srv_hub_next_message(s->f->hub, c->participant, SRV_NEXT_ALL, s->now_ms, &message) !=
           SRV_MESSAGE_NONE) {
        if (message.blob) {
            c->frames++;
            c->finals += message.header.flags & PROTO_FRAME_FINAL ? 1 : 0;
            c->gap_ms = fmax(c->gap_ms, s->now_ms - c->last_ms);
            c->last_ms = s->now_ms;
            if (acks)
                sim_ack(s, c, message.header.frame);
            else
                c->unacked = message.header.frame;
        }
        free(message.text);
        srv_blob_unref(&message.blob);
    }
}

static double once_ms(const struct simulation *s, const struct srv_render_job *job) {
    return s->hog && sim_is_for(job, s->hog) ? s->once_ms : 0;
}

/* Images of one size share their bytes, so that a simulated minute copies nothing. */
static struct srv_blob *image_of(struct simulation *s) {
    if (s->image && s->image->size == s->bytes)
        return s->image;
    uint8_t *bytes = calloc(1, s->bytes);
    assert_non_null(bytes);
    srv_blob_unref(&s->image);
    s->image = srv_blob_create(NULL, NULL, bytes, s->bytes, NULL);
    free(bytes);
    assert_non_null(s->image);
    return s->image;
}

/* Encode threads are chosen by this flag, so it must be true for the size of each frame. */
static void check_slow_to_encode(const struct srv_render_job *job) {
    bool is_slow = false;
    for (uint32_t i = 0; i < job->target_count; i++) {
        const struct srv_encoding encoding = { .format = job->targets[i].format,
                                               .video = job->targets[i].video };
        is_slow |= srv_encoding_expected_ms(&encoding, job->view.size) > SRV_SLOW_ENCODE_MS;
    }
    assert_int_equal(job->is_slow_to_encode, is_slow);
}

void sim_deliver(struct simulation *s, struct srv_render_job *job, double render_ms) {
    check_slow_to_encode(job);
    struct proto_frame_header header = { .codec = PROTO_CODEC_JPEG,
                                         .width = (uint16_t)job->view.size[0],
                                         .height = (uint16_t)job->view.size[1] };
    struct srv_render_result result = {
        .width = job->view.size[0],
        .height = job->view.size[1],
        .once_ms = once_ms(s, job),
        .encode_ms = s->slow_encoder && sim_is_for(job, s->slow_encoder) ? s->encode_ms : 0,
        .render_ms = render_ms
    };
    struct srv_blob *image = image_of(s);
    const struct srv_drawn_frame frame = srv_render_job_frame(job);
    for (uint32_t i = 0; i < job->target_count; i++)
        srv_hub_deliver(s->f->hub, &frame, &job->targets[i], &header, image);
    srv_schedule_done(s->f->schedule, job, &result);
    s->jobs++;
    for (int i = 0; i < SIM_CLIENTS; i++)
        if (s->clients[i].participant && !s->clients[i].is_stalled)
            sim_receive(s, &s->clients[i], true);
}

static void finish(struct simulation *s) {
    add_time(s);
    sim_deliver(s, &s->job, s->now_ms - s->begun_ms - s->paused_ms);
}

double sim_duration(const struct simulation *s, const struct srv_render_job *job) {
    return once_ms(s, job) + s->fixed_ms +
           ldexp(s->mpx_ms * 1e-6 * job->view.size[0] * job->view.size[1], -(int)job->mip_level);
}

void sim_turn(struct simulation *s, struct sim_client *c) {
    unsigned yields = s->f->yields;
    char text[128];
    c->next_ms += c->period_ms;
    snprintf(text, sizeof text, "{\"seq\":%u,\"patch\":{\"background\":[0,0,%f,1]}}", c->seq + 1,
             (c->seq + 1) % 100 * 0.01);
    c->seq++;
    sim_send(s, c, "view.update", text);
    s->yields = s->yields || s->f->yields > yields;
    bool is_over = s->end_ms < INFINITY &&
                   ((s->yields && s->now_ms - s->begun_ms >= s->job.protected_ms) ||
                    (s->job.is_refinement && !srv_schedule_is_newest(s->f->schedule, &s->job)));
    if (is_over) {
        add_time(s);
        srv_schedule_cancelled(s->f->schedule, &s->job, s->now_ms - s->begun_ms);
    }
}

struct srv_running_job sim_running_job(const struct srv_render_job *job, double drawn_ms) {
    return (struct srv_running_job){ .session = job->session,
                                     .order = job->order,
                                     .start_ms = job->start_ms,
                                     .participant_start_ms = job->participant_start_ms,
                                     .expected_ms = job->expected_ms,
                                     .price = job->price,
                                     .drawn_ms = drawn_ms,
                                     .image = job->image,
                                     .is_first = job->is_first,
                                     .ends_with_motion = job->ends_with_motion };
}

/* Renders a short frame that preempts the running one, if there is one. */
static bool preempt(struct simulation *s, double *wait_ms) {
    struct srv_render_job job;
    struct srv_running_job running =
        sim_running_job(&s->job, s->now_ms - s->begun_ms - s->paused_ms);
    if (!srv_schedule_next_short(s->f->schedule, &running, s->now_ms, &job, wait_ms))
        return false;
    double takes_ms = sim_duration(s, &job);
    s->paused_ms += takes_ms;
    s->end_ms += takes_ms;
    s->now_ms += takes_ms;
    sim_deliver(s, &job, takes_ms);
    return true;
}

void sim_run(struct simulation *s, double for_ms) {
    double until_ms = s->now_ms + for_ms;
    while (s->now_ms < until_ms) {
        double wait_ms = 1000, next_ms = fmin(s->end_ms, until_ms);
        if (s->end_ms == INFINITY) {
            if (srv_schedule_next(s->f->schedule, s->now_ms, &s->job, &wait_ms)) {
                if (s->job.protected_ms == 0)
                    assert_false(srv_schedule_has_motion(s->f->schedule));
                s->yields = false;
                s->paused_ms = 0;
                s->begun_ms = s->now_ms;
                s->end_ms = s->now_ms + sim_duration(s, &s->job);
                continue;
            }
            next_ms = fmin(next_ms, s->now_ms + fmax(wait_ms, 0.01));
        } else if (s->has_preemption) {
            if (preempt(s, &wait_ms))
                continue;
            next_ms = fmin(next_ms, s->now_ms + fmax(wait_ms, 0.01));
        }
        struct sim_client *first = NULL;
        for (int i = 0; i < SIM_CLIENTS; i++) {
            struct sim_client *c = &s->clients[i];
            if (c->participant && c->period_ms > 0 && c->next_ms <= next_ms) {
                next_ms = c->next_ms;
                first = c;
            }
        }
        s->now_ms = fmax(s->now_ms, next_ms);
        if (first)
            sim_turn(s, first);
        else if (s->end_ms <= s->now_ms)
            finish(s);
    }
}

void sim_reset(struct simulation *s) {
    s->jobs = 0;
    for (int i = 0; i < SIM_CLIENTS; i++) {
        struct sim_client *c = &s->clients[i];
        c->frames = c->finals = 0;
        c->took_ms = c->gap_ms = 0;
        c->last_ms = s->now_ms;
    }
}

int sim_set_up(void **state) {
    struct simulation *s = calloc(1, sizeof *s);
    if (!s || hub_set_up(state) != 0)
        return -1;
    s->f = *state;
    s->now_ms = 1000;
    s->end_ms = INFINITY;
    s->fixed_ms = 2;
    s->mpx_ms = 50;
    s->bytes = 5;
    *state = s;
    return 0;
}

int sim_tear_down(void **state) {
    struct simulation *s = *state;
    if (s->end_ms < INFINITY)
        srv_schedule_cancelled(s->f->schedule, &s->job, 0);
    for (int i = 0; i < SIM_CLIENTS; i++)
        srv_hub_leave(s->f->hub, &s->clients[i].participant, s->now_ms);
    srv_blob_unref(&s->image);
    *state = s->f;
    free(s);
    return hub_tear_down(state);
}
