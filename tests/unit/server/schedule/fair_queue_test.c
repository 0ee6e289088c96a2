/* SPDX-License-Identifier: Apache-2.0
 *
 * Who gets how much of one render lane. The lane and its clients are played: a picture takes a time
 * that follows from its size and detail, clients turn their views and take every frame at once.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "schedule/fair_queue.h"
#include "unit/server/session/hub_fixture.h"

enum { CLIENTS = 3 };

struct client {
    struct srv_participant *participant;
    double period_ms, next_ms; /* of its updates; 0 = it never moves */
    unsigned seq;
    bool is_stalled;         /* its socket takes nothing */
    uint32_t owed;           /* a frame that it took and does not acknowledge; 0 = none */
    unsigned frames, finals; /* that it got */
    double took_ms;          /* rendering those and what was given up */
    double last_ms, gap_ms;  /* between frames, the longest */
};

struct stage {
    struct fixture *f;
    struct client clients[CLIENTS];
    struct srv_render_job job;       /* under way, if there is one */
    bool yields;                     /* something moves since it was begun */
    double now_ms, begun_ms, end_ms; /* end_ms: INFINITY = nothing is under way */
    double fixed_ms, mpx_ms;         /* of a picture, and of its megapixels with all voxels */
    double held_ms;                  /* how long what is under way stood still */
    bool is_express;                 /* it stands still for short ones */
    const struct client *hog;        /* each picture of it has work that is done once: */
    double once_ms;
    const struct client *dear; /* each picture of it takes so long to encode: */
    double encode_ms;
    size_t bytes;  /* of each */
    unsigned jobs; /* delivered */
};

static void tell(struct stage *s, struct client *c, const char *method, const char *params) {
    char text[256], *answer;
    size_t size;
    snprintf(text, sizeof text, "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"%s\",\"params\":%s}",
             method, params);
    assert_true(
        srv_hub_message(s->f->hub, c->participant, text, strlen(text), s->now_ms, &answer, &size));
    assert_non_null(strstr(answer, "\"result\""));
    free(answer);
}

static struct client *join(struct stage *s, unsigned i, const char *id, double period_ms,
                           const char *settings) {
    struct client *c = &s->clients[i];
    *c = (struct client){ .period_ms = period_ms, .next_ms = s->now_ms + period_ms + i };
    c->participant = srv_hub_join(s->f->hub, id, SRV_ROLE_CONTROL, "", c, s->now_ms, NULL);
    assert_non_null(c->participant);
    tell(s, c, "stream.configure", settings);
    return c;
}

static void another_session(struct stage *s, char id[SRV_SESSION_ID_BYTES]) {
    proto_json *json = srv_hub_session_create(s->f->hub, NULL, s->now_ms, id, NULL);
    assert_non_null(json);
    proto_json_free(&json);
}

static bool is_for(const struct srv_render_job *job, const struct client *c) {
    for (uint32_t i = 0; c->participant && i < job->target_count; i++)
        if (job->targets[i].participant == srv_participant_id(c->participant))
            return true;
    return false;
}

static void note_time(struct stage *s) {
    for (int i = 0; i < CLIENTS; i++)
        if (is_for(&s->job, &s->clients[i]))
            s->clients[i].took_ms += s->now_ms - s->begun_ms;
    s->end_ms = INFINITY;
}

static void acknowledge(struct stage *s, struct client *c, uint32_t frame) {
    char text[64];
    snprintf(text, sizeof text, "{\"frame\":%u}", frame);
    tell(s, c, "stream.ack", text);
}

/* Takes all that there is for the client, and acknowledges it if that is what it does. */
static void take(struct stage *s, struct client *c, bool acks) {
    struct srv_message message;
    while (srv_hub_next_message(s->f->hub, c->participant, true, s->now_ms, &message) !=
           SRV_MESSAGE_NONE) {
        if (message.blob) {
            c->frames++;
            c->finals += message.header.flags & PROTO_FRAME_FINAL ? 1 : 0;
            c->gap_ms = fmax(c->gap_ms, s->now_ms - c->last_ms);
            c->last_ms = s->now_ms;
            if (acks)
                acknowledge(s, c, message.header.frame);
            else
                c->owed = message.header.frame;
        }
        free(message.text);
        srv_blob_unref(&message.blob);
    }
}

static double once_ms(const struct stage *s, const struct srv_render_job *job) {
    return s->hog && is_for(job, s->hog) ? s->once_ms : 0;
}

static void deliver(struct stage *s, struct srv_render_job *job, double render_ms) {
    struct proto_frame_header header = { .codec = PROTO_CODEC_JPEG,
                                         .width = (uint16_t)job->view.size[0],
                                         .height = (uint16_t)job->view.size[1] };
    struct srv_render_result result = { .width = job->view.size[0],
                                        .height = job->view.size[1],
                                        .once_ms = once_ms(s, job),
                                        .encode_ms =
                                            s->dear && is_for(job, s->dear) ? s->encode_ms : 0,
                                        .render_ms = render_ms };
    uint8_t *image = calloc(1, s->bytes);
    assert_non_null(image);
    struct srv_blob *blob = srv_blob_create(image, s->bytes);
    free(image);
    for (uint32_t i = 0; i < job->target_count; i++)
        srv_schedule_deliver(s->f->schedule, job, i, &header, blob);
    srv_blob_unref(&blob);
    srv_schedule_done(s->f->schedule, job, &result);
    s->jobs++;
    for (int i = 0; i < CLIENTS; i++)
        if (s->clients[i].participant && !s->clients[i].is_stalled)
            take(s, &s->clients[i], true);
}

static void finish(struct stage *s) {
    note_time(s);
    deliver(s, &s->job, s->now_ms - s->begun_ms - s->held_ms);
}

static double duration(const struct stage *s, const struct srv_render_job *job) {
    return once_ms(s, job) + s->fixed_ms +
           ldexp(s->mpx_ms * 1e-6 * job->view.size[0] * job->view.size[1], -(int)job->mip_level);
}

/* The client turns its view; what is under way is given up when the hub says so. */
static void turn(struct stage *s, struct client *c) {
    unsigned yields = s->f->yields;
    char text[128];
    c->next_ms += c->period_ms;
    snprintf(text, sizeof text, "{\"seq\":%u,\"patch\":{\"background\":[0,0,%f,1]}}", c->seq + 1,
             (c->seq + 1) % 100 * 0.01);
    c->seq++;
    tell(s, c, "view.update", text);
    s->yields = s->yields || s->f->yields > yields;
    bool is_over = s->end_ms < INFINITY &&
                   ((s->yields && s->now_ms - s->begun_ms >= s->job.protected_ms) ||
                    (s->job.is_refinement && !srv_schedule_is_newest(s->f->schedule, &s->job)));
    if (is_over) {
        note_time(s);
        srv_schedule_cancelled(s->f->schedule, &s->job, s->now_ms - s->begun_ms);
    }
}

static struct srv_running_job running_of(const struct srv_render_job *job, double drawn_ms) {
    return (struct srv_running_job){ job->session,       job->order,       job->start_ms,
                                     job->part_start_ms, job->expected_ms, drawn_ms };
}

/* A short one that may go before what is under way is drawn at once. */
static bool draw_before(struct stage *s, double *wait_ms) {
    struct srv_render_job job;
    struct srv_running_job running = running_of(&s->job, s->now_ms - s->begun_ms - s->held_ms);
    if (!srv_schedule_next_short(s->f->schedule, &running, s->now_ms, &job, wait_ms))
        return false;
    double takes_ms = duration(s, &job);
    s->held_ms += takes_ms;
    s->end_ms += takes_ms;
    s->now_ms += takes_ms;
    deliver(s, &job, takes_ms);
    return true;
}

static void play(struct stage *s, double for_ms) {
    double until_ms = s->now_ms + for_ms;
    while (s->now_ms < until_ms) {
        double wait_ms = 1000, next_ms = fmin(s->end_ms, until_ms);
        if (s->end_ms == INFINITY) {
            if (srv_schedule_next(s->f->schedule, s->now_ms, &s->job, &wait_ms)) {
                assert_false(s->job.protected_ms == 0 && srv_schedule_has_motion(s->f->schedule));
                s->yields = false;
                s->held_ms = 0;
                s->begun_ms = s->now_ms;
                s->end_ms = s->now_ms + duration(s, &s->job);
                continue;
            }
            next_ms = fmin(next_ms, s->now_ms + fmax(wait_ms, 0.01));
        } else if (s->is_express) {
            if (draw_before(s, &wait_ms))
                continue;
            next_ms = fmin(next_ms, s->now_ms + fmax(wait_ms, 0.01));
        }
        struct client *first = NULL;
        for (int i = 0; i < CLIENTS; i++) {
            struct client *c = &s->clients[i];
            if (c->participant && c->period_ms > 0 && c->next_ms <= next_ms) {
                next_ms = c->next_ms;
                first = c;
            }
        }
        s->now_ms = fmax(s->now_ms, next_ms);
        if (first)
            turn(s, first);
        else if (s->end_ms <= s->now_ms)
            finish(s);
    }
}

/* From here on is counted. */
static void reset(struct stage *s) {
    s->jobs = 0;
    for (int i = 0; i < CLIENTS; i++) {
        struct client *c = &s->clients[i];
        c->frames = c->finals = 0;
        c->took_ms = c->gap_ms = 0;
        c->last_ms = s->now_ms;
    }
}

static int set_up(void **state) {
    struct stage *s = calloc(1, sizeof *s);
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

static int tear_down(void **state) {
    struct stage *s = *state;
    if (s->end_ms < INFINITY)
        srv_schedule_cancelled(s->f->schedule, &s->job, 0);
    for (int i = 0; i < CLIENTS; i++)
        srv_hub_leave(s->f->hub, &s->clients[i].participant, s->now_ms);
    *state = s->f;
    free(s);
    return hub_tear_down(state);
}

static void idle_accounts_save_up_nothing_and_debts_stay(void **state) {
    (void)state;
    struct srv_fair_account share = { 0 };
    assert_true(srv_fair_start(&share, 500) == 500);
    srv_fair_charge(&share, 500, 30);
    assert_true(srv_fair_start(&share, 510) == 530);
    srv_fair_correct(&share, 70);
    assert_true(srv_fair_start(&share, 510) == 600);
    srv_fair_correct(&share, -90);
    assert_true(srv_fair_start(&share, 505) == 510);
    assert_true(srv_fair_start(&share, 9000) == 9000);
    assert_true(srv_fair_protected_ms(9999, 500) == 0 && srv_fair_protected_ms(10000, 500) == 1000);
    assert_true(srv_fair_protected_ms(999, 0) == 0 && srv_fair_protected_ms(1000, 0) == 100);
}

/* Always want the next picture, which has always all detail: 15 and 212 ms. */
#define SMALL "{\"max_fps\":120,\"progressive\":false,\"size\":[512,512]}"
#define LARGE "{\"max_fps\":120,\"progressive\":false,\"size\":[2048,2048]}"

static void sessions_have_equal_shares_of_time_not_of_frames(void **state) {
    struct stage *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    another_session(s, id);
    struct client *small = join(s, 0, s->f->id, 8, SMALL);
    struct client *large = join(s, 1, id, 8, LARGE);
    play(s, 2000);
    reset(s);
    play(s, 5000);
    assert_true(large->frames > 0 && small->frames > 2 * large->frames);
    assert_true(fabs(small->took_ms - large->took_ms) < 0.1 * large->took_ms);
}

static void time_received_while_all_others_were_idle_is_no_debt(void **state) {
    struct stage *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    another_session(s, id);
    struct client *slow = join(s, 0, s->f->id, 30, "{\"max_fps\":30,\"size\":[512,512]}");
    struct client *other = join(s, 1, id, 30, "{\"max_fps\":30,\"size\":[512,512]}");
    s->mpx_ms = 400; /* two of them are more than the machine has time for */
    slow->period_ms = other->period_ms = 0;
    play(s, 1000);
    turn(s, slow);
    s->fixed_ms = 20000; /* once, and nobody else wants anything */
    play(s, 60000);
    s->fixed_ms = 2;
    slow->period_ms = other->period_ms = 1000.0 / 30;
    slow->next_ms = other->next_ms = s->now_ms;
    turn(s, other);
    turn(s, slow);
    reset(s);
    play(s, 3000);
    assert_true(slow->took_ms > 0.8 * other->took_ms);
}

static void a_client_keeps_its_rate_beside_a_larger_one(void **state) {
    struct stage *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    struct client *small = join(s, 0, s->f->id, 33, "{\"size\":[256,256]}");
    play(s, 2000);
    reset(s);
    play(s, 5000);
    unsigned alone = small->frames;
    another_session(s, id);
    join(s, 1, id, 33, "{\"size\":[2048,2048]}");
    play(s, 2000);
    reset(s);
    play(s, 5000);
    assert_in_range(small->frames, alone * 3 / 4, alone);
}

static void of_eligible_sessions_the_earliest_deadline_goes_first(void **state) {
    struct stage *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    another_session(s, id);
    struct client *slow = join(s, 0, s->f->id, 0, "{\"max_fps\":10,\"size\":[64,64]}");
    struct client *fast = join(s, 1, id, 0, "{\"max_fps\":60,\"size\":[64,64]}");
    s->fixed_ms = s->mpx_ms = 0; /* nobody owes anything */
    play(s, 5000);
    turn(s, fast);
    play(s, 5000); /* both rest; the slow one was served longer ago */
    turn(s, slow);
    s->now_ms += 1;
    turn(s, fast);
    double wait_ms;
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &s->job, &wait_ms));
    assert_true(is_for(&s->job, fast));
    s->begun_ms = s->now_ms;
    s->end_ms = s->now_ms + 3;
    play(s, 200);
    assert_int_equal(slow->seq, 1);
}

static void motion_elsewhere_cancels_a_refinement(void **state) {
    struct stage *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    another_session(s, id);
    struct client *still = join(s, 0, s->f->id, 0, "{\"size\":[4096,4096]}");
    play(s, 5000); /* what its pictures take is known: 840 ms */
    assert_int_equal(still->finals, 1);
    struct client *moving = join(s, 1, id, 33, "{\"size\":[256,256]}");
    play(s, 1000);
    turn(s, still);
    reset(s);
    play(s, 10000);
    assert_int_equal(still->finals, 0);
    assert_true(moving->gap_ms < 100); /* of its own 33 and a moving one of the other's */
    play(s, 20000);
    assert_int_equal(still->finals, 1); /* it comes, some day */
    assert_true(moving->frames > 30000 / 33 * 9 / 10);
}

/* It could not have been drawn, so it gave way to nobody. */
static void the_starvation_limit_does_not_count_while_the_window_is_closed(void **state) {
    struct stage *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    another_session(s, id);
    s->bytes = 1 << 20; /* one frame on its way closes a window */
    struct client *slow = join(s, 0, s->f->id, 0, "{\"size\":[4096,4096]}");
    play(s, 5000); /* what its pictures take is known: 840 ms */
    assert_int_equal(slow->finals, 1);
    struct client *moving = join(s, 1, id, 33, "{\"size\":[256,256]}");
    play(s, 1000);
    slow->is_stalled = true;
    turn(s, slow);
    play(s, 1000); /* the moving frame waits for the socket, the refinement for its turn */
    take(s, slow, false);
    assert_int_not_equal(slow->owed, 0);
    reset(s);
    play(s, 30000);
    slow->is_stalled = false;
    acknowledge(s, slow, slow->owed);
    play(s, 10000);
    assert_int_equal(slow->finals, 0);
    assert_true(moving->gap_ms < 100);
    play(s, 10000);
    assert_int_equal(slow->finals, 1);
}

/* Nor while its own rate keeps it from being drawn. */
static void the_starvation_limit_does_not_count_while_the_rate_is_used_up(void **state) {
    struct stage *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    another_session(s, id);
    struct client *slow =
        join(s, 0, s->f->id, 0, "{\"max_fps\":1,\"progressive\":false,\"size\":[4096,4096]}");
    play(s, 5000);
    assert_int_equal(slow->finals, 1);
    join(s, 1, id, 133, "{\"size\":[256,256]}"); /* leaves 33 ms between */
    play(s, 1000);
    turn(s, slow);
    reset(s);
    play(s, 30000);
    assert_int_equal(slow->finals, 0);
    assert_true(slow->took_ms > 0); /* begun now and then, and given up */
    play(s, 900000);
    assert_true(slow->finals > 0);
}

static void a_view_that_moves_rarely_leaves_time_for_refinements(void **state) {
    struct stage *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    another_session(s, id);
    struct client *still = join(s, 0, s->f->id, 0, "{\"size\":[2048,2048]}");
    play(s, 5000); /* what its pictures take is known: 212 ms */
    join(s, 1, id, 33, "{\"max_fps\":1,\"size\":[256,256]}");
    play(s, 3000);
    turn(s, still);
    reset(s);
    play(s, 2000);
    assert_int_equal(still->finals, 1);
}

static void a_client_of_final_frames_only_does_not_stop_the_others(void **state) {
    struct stage *s = *state;
    struct client *driver = join(s, 0, s->f->id, 33, "{\"size\":[256,256]}");
    play(s, 2000);
    reset(s);
    play(s, 30000);
    unsigned alone = driver->frames;
    struct client *viewer = join(s, 1, s->f->id, 0, "{\"progressive\":false,\"size\":[4096,4096]}");
    play(s, 3000);
    reset(s);
    play(s, 60000);
    assert_in_range(driver->frames, 2 * alone * 9 / 10, 2 * alone);
    assert_true(viewer->finals > 0);
    driver->period_ms = 0;
    reset(s);
    play(s, 3000);
    assert_int_equal(viewer->finals, 1);
}

static void frames_of_unknown_time_do_not_stop_the_others(void **state) {
    struct stage *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    struct client *moving = join(s, 0, s->f->id, 33, "{\"size\":[256,256]}");
    play(s, 2000);
    reset(s);
    play(s, 60000);
    unsigned alone = moving->frames;
    another_session(s, id);
    struct client *greedy =
        join(s, 1, id, 33, "{\"max_fps\":60,\"progressive\":false,\"size\":[8192,8192]}");
    reset(s);
    play(s, 60000);
    assert_in_range(moving->frames, alone * 85 / 100, alone);
    assert_int_equal(greedy->finals, 0); /* 3.4 s, for which it has not waited long enough */
    play(s, 240000);
    assert_true(greedy->finals > 0);
    assert_in_range(moving->frames, 5 * alone * 9 / 10, 5 * alone);
}

/* Whenever they joined, and however often the view changes. */
static void participants_that_watch_together_share_frames(void **state) {
    struct stage *s = *state;
    s->fixed_ms = s->mpx_ms = 0.1;
    join(s, 0, s->f->id, 7, "{\"max_fps\":1,\"size\":[16,16]}");
    for (unsigned i = 1; i < CLIENTS; i++) {
        join(s, i, s->f->id, 0, "{\"max_fps\":30,\"size\":[320,200]}");
        play(s, 1011);
    }
    reset(s);
    play(s, 10000);
    for (int i = 1; i < CLIENTS; i++)
        assert_in_range(s->clients[i].frames, 299, 301);
    assert_in_range(s->jobs, 308, 312);
}

/* One whose every frame takes a long time, because it edits what takes long to derive. */
static void short_frames_preempt_long_ones(void **state) {
    struct stage *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    struct client *moving = join(s, 0, s->f->id, 33, "{\"size\":[256,256]}");
    play(s, 2000);
    reset(s);
    play(s, 10000);
    unsigned alone = moving->frames;
    another_session(s, id);
    s->hog = join(s, 1, id, 33, "{\"size\":[512,512]}");
    s->once_ms = 280;
    reset(s);
    play(s, 10000);
    assert_in_range(moving->frames, 1, alone / 3); /* one each in turn */
    unsigned frames = s->hog->frames;
    s->is_express = true;
    reset(s);
    play(s, 10000);
    assert_in_range(moving->frames, alone * 95 / 100, alone + 1);
    assert_in_range(s->hog->frames, frames * 80 / 100,
                    frames); /* which pays for no more than that */
}

/* The same of two who share a session. */
static void short_frames_of_the_same_session_preempt_long_ones(void **state) {
    struct stage *s = *state;
    struct client *driver = join(s, 0, s->f->id, 33, "{\"size\":[256,256]}");
    play(s, 2000);
    reset(s);
    play(s, 10000);
    unsigned alone = driver->frames;
    s->hog = join(s, 1, s->f->id, 0, "{\"size\":[512,512]}");
    s->once_ms = 280;
    s->is_express = true;
    play(s, 1000);
    reset(s);
    play(s, 10000);
    assert_in_range(driver->frames, alone * 95 / 100, alone + 1);
    assert_true(s->hog->frames > 10);
}

/* Of two that have no rest both have half of the time, in whatever pieces. */
static void a_preempted_session_has_its_share(void **state) {
    struct stage *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    struct client *many = join(s, 0, s->f->id, 8, "{\"max_fps\":120,\"size\":[512,512]}");
    play(s, 2000);
    another_session(s, id);
    struct client *hog = join(s, 1, id, 8, "{\"max_fps\":120,\"size\":[512,512]}");
    s->hog = hog;
    s->once_ms = 280;
    s->is_express = true;
    play(s, 2000);
    reset(s);
    play(s, 20000);
    double hog_ms = hog->frames * 280.0;
    assert_true(hog_ms > 0.4 * 20000 && hog_ms < 0.6 * 20000);
    assert_true(many->frames > 3 * hog->frames);
}

static void update_tf(struct stage *s, struct client *c) {
    tell(s, c, "view.update",
         "{\"seq\":99,\"patch\":{\"transfer_function\":{\"points\":["
         "{\"value\":1,\"color\":[1,1,1],\"opacity\":0.1}]}}}");
}

static void rules_for_preempting_a_long_frame(void **state) {
    struct stage *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    struct srv_render_job job, before;
    double wait_ms;
    another_session(s, id);
    struct client *hog = join(s, 0, s->f->id, 0, "{\"size\":[512,512]}");
    play(s, 3000);
    turn(s, hog);
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &job, &wait_ms));
    struct client *other = join(s, 1, id, 0, "{\"size\":[256,256]}");
    struct srv_running_job running;
#define BEFORE(ms)                                                                                 \
    (running = running_of(&job, ms), running.expected_ms = INFINITY,                               \
     srv_schedule_next_short(s->f->schedule, &running, s->now_ms, &before, &wait_ms))
    assert_false(BEFORE(1e6)); /* nothing is known of how long it takes */
    srv_schedule_cancelled(s->f->schedule, &job, 0);
    play(s, 3000);
    turn(s, hog);
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &job, &wait_ms));
    assert_false(BEFORE(1e6)); /* it rests */
    turn(s, hog);
    assert_false(BEFORE(1e6)); /* its own session's does not */
    turn(s, other);
    assert_true(BEFORE(0));
    assert_true(before.session != job.session && !before.is_refinement);
    deliver(s, &before, 100); /* more than was expected */
    s->now_ms += 50;
    turn(s, other);
    assert_false(BEFORE(60)); /* it has had more */
    assert_true(wait_ms > 0 && wait_ms <= 40);
    assert_true(BEFORE(101));
    double takes_ms = before.expected_ms;
    assert_true(takes_ms > 4 && takes_ms < 40);
    srv_schedule_cancelled(s->f->schedule, &before, 0);
    const struct {
        double expected_ms;
        bool may;
    } cases[] = {
        { 1000 + takes_ms / 2, false }, /* which will be over sooner */
        { 1000 + 10 * takes_ms, true },
        { 20, true }, /* that was wrong */
    };
    for (int i = 0; i < 3; i++) {
        s->now_ms += 50; /* another frame is due */
        running.drawn_ms = 1000;
        running.expected_ms = cases[i].expected_ms;
        turn(s, other);
        assert_int_equal(
            srv_schedule_next_short(s->f->schedule, &running, s->now_ms, &before, &wait_ms),
            cases[i].may);
        if (cases[i].may)
            srv_schedule_cancelled(s->f->schedule, &before, 0);
    }
    update_tf(s, other);
    assert_false(BEFORE(1e6)); /* that has to be derived first */
#undef BEFORE
    srv_schedule_cancelled(s->f->schedule, &job, 0);
}

/* What it took to draw is paid for before the next one is begun, which may be before it is encoded;
 * and once. */
static void rendering_is_charged_before_encoding_ends(void **state) {
    struct stage *s = *state;
    struct srv_render_job job[3];
    struct client *hog = join(s, 0, s->f->id, 0, "{\"size\":[512,512]}");
    play(s, 3000);
    double wait_ms;
    for (int i = 0; i < 3; i++) {
        s->now_ms += 50;
        turn(s, hog);
        assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &job[i], &wait_ms));
        if (i == 0)
            srv_schedule_rendered(s->f->schedule, &job[0], 400);
        if (i == 1) {
            deliver(s, &job[0], 400);
            deliver(s, &job[1], 100);
        }
    }
    assert_float_equal(job[1].start_ms, job[0].start_ms + 400, 1e-3);
    assert_float_equal(job[2].start_ms, job[1].start_ms + 100, 1e-3);
    srv_schedule_cancelled(s->f->schedule, &job[2], 0);
}

static bool next_before(struct stage *s, double drawn_ms, struct srv_render_job *before) {
    double wait_ms;
    struct srv_running_job running = running_of(&s->job, drawn_ms);
    running.start_ms = 1e9; /* it has had more than anybody */
    running.expected_ms = INFINITY;
    return srv_schedule_next_short(s->f->schedule, &running, s->now_ms, before, &wait_ms);
}

/* However long the last one took: the next one is drawn with less detail. */
static void the_expected_time_of_the_next_frame_decides_if_it_is_short(void **state) {
    struct stage *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    struct srv_render_job before;
    double wait_ms, slowest_ms = 0;
    another_session(s, id);
    struct client *hog = join(s, 0, s->f->id, 0, "{\"size\":[512,512]}");
    struct client *other = join(s, 1, id, 0, "{\"size\":[512,512]}");
    play(s, 3000);
    turn(s, hog);
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &s->job, &wait_ms));
    s->mpx_ms *= 20; /* the machine is busy */
    for (int i = 0; i < 20; i++) {
        s->now_ms += 50;
        turn(s, other);
        assert_true(next_before(s, 600, &before));
        slowest_ms = fmax(slowest_ms, duration(s, &before));
        deliver(s, &before, duration(s, &before));
    }
    assert_true(slowest_ms > SRV_QUALITY_BUDGET_MIN_MS &&
                duration(s, &before) < SRV_QUALITY_BUDGET_MIN_MS);
    for (int i = 0; i < 20; i++) { /* and busier, whatever the detail */
        s->now_ms += 50;
        turn(s, other);
        assert_true(next_before(s, 2100, &before));
        deliver(s, &before, 200);
    }
    s->now_ms += 50;
    turn(s, other);
    assert_false(next_before(s, 600, &before)); /* a third of it is not short */
    assert_true(next_before(s, 2100, &before));
    srv_schedule_cancelled(s->f->schedule, &before, 0);
    srv_schedule_cancelled(s->f->schedule, &s->job, 0);
}

static void encoding_is_charged(void **state) {
    struct stage *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    another_session(s, id);
    struct client *cheap = join(s, 0, s->f->id, 8, SMALL);
    s->dear = join(s, 1, id, 8, SMALL);
    s->encode_ms = 105; /* and 15 to draw, as the other one's */
    play(s, 2000);
    reset(s);
    play(s, 10000);
    assert_true(s->dear->frames > 0 && cheap->frames > 7 * s->dear->frames);
    assert_true(cheap->frames < 9 * s->dear->frames);
}

/* Pictures that hold an encode thread for long, and who else looks on. */
static void frames_that_are_slow_to_encode_are_made_one_at_a_time(void **state) {
    struct stage *s = *state;
    struct srv_render_job one, other, next;
    double wait_ms;
    struct client *driver = join(s, 0, s->f->id, 0, "{\"max_fps\":120,\"size\":[2048,2048]}");
    struct client *viewer = join(s, 1, s->f->id, 0, "{\"max_fps\":120,\"size\":[2048,2048]}");
    tell(s, viewer, "stream.configure", "{\"format\":\"png\"}");
    s->mpx_ms = 1; /* so that pictures have all detail */
    for (int i = 0; i < 3; i++) {
        turn(s, driver);
        play(s, 5000);
    }
    turn(s, driver); /* of one size, and to be encoded in 15 and in 63 ms */
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &one, &wait_ms));
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &other, &wait_ms));
    struct srv_render_job *dear = one.is_slow_to_encode ? &one : &other,
                          *cheap = one.is_slow_to_encode ? &other : &one;
    assert_true(dear->is_slow_to_encode && is_for(dear, viewer) && !is_for(dear, driver));
    assert_true(!cheap->is_slow_to_encode && is_for(cheap, driver) && !is_for(cheap, viewer));
    deliver(s, cheap, 1);
    s->now_ms += 10;
    turn(s, driver);
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &next, &wait_ms));
    assert_true(is_for(&next, driver) && !is_for(&next, viewer));
    assert_false(srv_schedule_next(s->f->schedule, s->now_ms, cheap, &wait_ms));
    deliver(s, &next, 1);
    deliver(s, dear, 1);
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &next, &wait_ms));
    assert_true(next.is_slow_to_encode && is_for(&next, viewer));
    deliver(s, &next, 1);
}

static void who_holds_control_counts_for_all_others_together(void **state) {
    struct stage *s = *state;
    struct client *driver = join(s, 0, s->f->id, 8, LARGE);
    play(s, 100);
    join(s, 1, s->f->id, 0, "{\"max_fps\":120,\"progressive\":false,\"size\":[2048,2047]}");
    join(s, 2, s->f->id, 0, "{\"max_fps\":120,\"progressive\":false,\"size\":[2048,2046]}");
    play(s, 5000);
    reset(s);
    play(s, 20000);
    double others_ms = s->clients[1].took_ms + s->clients[2].took_ms;
    assert_true(fabs(driver->took_ms - others_ms) < 0.1 * others_ms);
    assert_true(fabs(s->clients[1].took_ms - s->clients[2].took_ms) < 0.1 * others_ms);
}

static void participants_have_equal_shares_of_their_session(void **state) {
    struct stage *s = *state;
    struct client *driver = join(s, 0, s->f->id, 8, SMALL);
    struct client *viewer = join(s, 1, s->f->id, 0, LARGE);
    play(s, 2000);
    reset(s);
    play(s, 5000);
    assert_true(viewer->frames > 0);
    assert_true(fabs(driver->took_ms - viewer->took_ms) < 0.1 * viewer->took_ms);
}

static void a_viewers_settings_interrupt_its_own_picture_alone(void **state) {
    struct stage *s = *state;
    struct client *driver = join(s, 0, s->f->id, 0, "{\"size\":[256,256]}");
    struct client *viewer = join(s, 1, s->f->id, 0, "{\"size\":[64,64]}");
    play(s, 5000);
    unsigned before = s->f->interrupts;
    tell(s, viewer, "stream.configure", "{\"quality\":30}");
    assert_int_equal(s->f->interrupts, before + 1);
    assert_int_equal(s->f->why, SRV_INTERRUPT_NEWER_REQUEST);
    assert_int_equal(s->f->of, srv_participant_id(viewer->participant));
    (void)driver;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(idle_accounts_save_up_nothing_and_debts_stay),
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
        TEST(sessions_have_equal_shares_of_time_not_of_frames),
        TEST(time_received_while_all_others_were_idle_is_no_debt),
        TEST(a_client_keeps_its_rate_beside_a_larger_one),
        TEST(of_eligible_sessions_the_earliest_deadline_goes_first),
        TEST(motion_elsewhere_cancels_a_refinement),
        TEST(the_starvation_limit_does_not_count_while_the_window_is_closed),
        TEST(the_starvation_limit_does_not_count_while_the_rate_is_used_up),
        TEST(a_view_that_moves_rarely_leaves_time_for_refinements),
        TEST(a_client_of_final_frames_only_does_not_stop_the_others),
        TEST(frames_of_unknown_time_do_not_stop_the_others),
        TEST(participants_that_watch_together_share_frames),
        TEST(short_frames_preempt_long_ones),
        TEST(short_frames_of_the_same_session_preempt_long_ones),
        TEST(a_preempted_session_has_its_share),
        TEST(rules_for_preempting_a_long_frame),
        TEST(rendering_is_charged_before_encoding_ends),
        TEST(the_expected_time_of_the_next_frame_decides_if_it_is_short),
        TEST(encoding_is_charged),
        TEST(frames_that_are_slow_to_encode_are_made_one_at_a_time),
        TEST(participants_have_equal_shares_of_their_session),
        TEST(who_holds_control_counts_for_all_others_together),
        TEST(a_viewers_settings_interrupt_its_own_picture_alone),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
