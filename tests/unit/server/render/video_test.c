/* SPDX-License-Identifier: Apache-2.0
 *
 * Video for several participants, each with a decoder of its own: whatever is taken late, left out,
 * replaced by a still or asked for again, what arrives can be decoded and is the picture that it
 * says it is. (Of each picture its view's version is known by its render time.)
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <vpx/vp8dx.h>
#include <vpx/vpx_decoder.h>

#include "common/clock.h"
#include "render/video.h"
#include "support/compare.h"
#include "unit/server/session/hub_fixture.h"

enum { WIDTH = 64, HEIGHT = 48, SIDE = 16, PEOPLE = 3, FLYING = 2, VIDEO_PX = 1 << 20 };

struct person {
    struct srv_participant *p;
    vpx_codec_ctx_t decoder;
    unsigned videos, keys, stills;
    uint64_t version; /* of the newest picture */
    bool is_final;
    unsigned policies, refusals; /* told by stream.policy; those which say that there is no room */
};

struct flying {
    struct srv_render_job job;
    struct sp_frame frame;
};

struct world {
    struct fixture *f;
    struct srv_video_encoders *videos;
    struct person people[PEOPLE];
    struct flying flying[FLYING];
    unsigned flying_count, seq;
    uint64_t random;
    double now_ms;
};

static unsigned roll(struct world *w, unsigned sides) {
    w->random = w->random * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (unsigned)(w->random >> 33) % sides;
}

/* Twelve blocks, one of which changes with each version: who lacks a frame sees an old one. */
static uint8_t grey(uint64_t version, unsigned x, unsigned y) {
    uint64_t block = x / SIDE + y / SIDE * (WIDTH / SIDE), blocks = WIDTH / SIDE * (HEIGHT / SIDE);
    uint64_t changed = version + blocks - (version + blocks - block) % blocks;
    uint64_t mixed = (changed + 1) * UINT64_C(0x9e3779b97f4a7c15);
    return (uint8_t)(40 + (mixed >> 40) % 176);
}

static struct sp_frame draw(const struct srv_render_job *job) {
    struct sp_frame frame = { .width = job->view.size[0],
                              .height = job->view.size[1],
                              .format = SP_RGBA8,
                              .stats.render_ms = (double)job->version };
    frame.stride_bytes = ((size_t)frame.width * 4 + 63) / 64 * 64;
    frame.pixels = aligned_alloc(64, frame.stride_bytes * frame.height);
    assert_non_null(frame.pixels);
    for (unsigned y = 0; y < frame.height; y++)
        for (unsigned x = 0; x < frame.width; x++) {
            uint8_t *p = (uint8_t *)frame.pixels + y * frame.stride_bytes + 4 * x;
            p[0] = p[1] = p[2] = grey(job->version, x, y);
            p[3] = 255;
        }
    return frame;
}

static void say(struct world *w, struct srv_participant *p, const char *text) {
    char *answer;
    size_t size;
    assert_true(srv_hub_message(w->f->hub, p, text, strlen(text), w->now_ms, &answer, &size));
    if (answer)
        assert_non_null(strstr(answer, "\"result\""));
    free(answer);
}

static void change(struct world *w) {
    char text[200];
    snprintf(text, sizeof text,
             "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"view.update\",\"params\":{\"seq\":%u,"
             "\"patch\":{\"background\":[0,%g,0,1]}}}",
             w->seq + 1, (w->seq + 1) % 512 / 512.0);
    w->seq++;
    say(w, w->people[0].p, text);
}

static void join(struct world *w, struct person *person) {
    *person = (struct person){ .p = hub_join(w->f, SRV_ROLE_CONTROL, w->now_ms) };
    assert_int_equal(vpx_codec_dec_init(&person->decoder, vpx_codec_vp8_dx(), NULL, 0), 0);
    say(w, person->p,
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\",\"params\":{\"format\":"
        "[\"vp8\"],\"size\":[64,48],\"max_fps\":120}}");
}

static void leave(struct world *w, struct person *person) {
    vpx_codec_destroy(&person->decoder);
    srv_hub_leave(w->f->hub, &person->p, w->now_ms);
}

static void check_picture(struct person *person, const struct srv_message *message) {
    vpx_codec_iter_t at = NULL;
    uint64_t version = (message->header.render_us + 500) / 1000;
    assert_int_equal(vpx_codec_decode(&person->decoder, message->blob->bytes,
                                      (unsigned)message->blob->size, NULL, 0),
                     0);
    const vpx_image_t *image = vpx_codec_get_frame(&person->decoder, &at);
    assert_non_null(image);
    for (unsigned y = SIDE / 2; y < image->d_h; y += SIDE)
        for (unsigned x = SIDE / 2; x < image->d_w; x += SIDE) {
            double luma = image->planes[0][y * (size_t)image->stride[0] + x];
            double seen = 1.164384 * (luma - 16), right = grey(version, x, y);
            if (fabs(seen - right) > 12)
                fail_msg("version %llu at %u, %u: %.0f, not %.0f", (unsigned long long)version, x,
                         y, seen, right);
        }
    person->version = version;
}

/* The socket of somebody takes the next message. */
static bool take(struct world *w, struct person *person) {
    struct srv_message message;
    switch (srv_hub_next_message(w->f->hub, person->p, true, w->now_ms, &message)) {
    case SRV_MESSAGE_NONE:
    case SRV_MESSAGE_CLOSE:
        return false;
    case SRV_MESSAGE_TEXT:
        if (strstr(message.text, "stream.policy")) {
            person->policies++;
            person->refusals += strstr(message.text, "video_pixels") != NULL;
        }
        free(message.text);
        return true;
    case SRV_MESSAGE_FRAME:
        break;
    }
    char text[120];
    bool is_video = message.header.codec == PROTO_CODEC_VP8;
    person->is_final = (message.header.flags & PROTO_FRAME_FINAL) != 0;
    assert_true(is_video || message.header.codec == PROTO_CODEC_JPEG);
    if (is_video) {
        assert_false(person->is_final);
        check_picture(person, &message);
        person->videos++;
        person->keys += message.header.flags & PROTO_FRAME_KEY;
    } else {
        assert_true(message.header.flags & PROTO_FRAME_KEY);
        memcpy(&person->version, message.blob->bytes, sizeof person->version);
        person->stills++;
    }
    snprintf(text, sizeof text,
             "{\"jsonrpc\":\"2.0\",\"method\":\"stream.ack\",\"params\":{\"frame\":%u}}",
             message.header.frame);
    say(w, person->p, text);
    srv_blob_unref(&message.blob);
    return true;
}

static bool start_job(struct world *w) {
    double wait_ms;
    struct flying *flying = &w->flying[w->flying_count];
    if (w->flying_count == FLYING ||
        !srv_schedule_next(w->f->schedule, w->now_ms, &flying->job, &wait_ms))
        return false;
    flying->frame = draw(&flying->job);
    w->flying_count++;
    return true;
}

static void finish_job(struct world *w, unsigned which) {
    struct flying flying = w->flying[which];
    struct srv_render_result result = { .width = flying.frame.width,
                                        .height = flying.frame.height,
                                        .render_ms = 1 };
    struct proto_frame_header header = { .codec = PROTO_CODEC_JPEG,
                                         .width = (uint16_t)flying.frame.width,
                                         .height = (uint16_t)flying.frame.height };
    w->flying[which] = w->flying[--w->flying_count];
    double encode_ms = 0;
    uint64_t stills = srv_video_encoders_encode(w->videos, w->f->schedule, &flying.job,
                                                &flying.frame, &encode_ms);
    struct srv_blob *blob = srv_blob_create((const uint8_t *)&flying.job.version, 8);
    for (uint32_t i = 0; i < flying.job.target_count; i++)
        if (stills >> i & 1)
            srv_schedule_deliver(w->f->schedule, &flying.job, i, &header, blob);
    srv_blob_unref(&blob);
    free(flying.frame.pixels);
    srv_schedule_done(w->f->schedule, &flying.job, &result);
}

static void set_up(struct world *w, struct fixture *f, unsigned seed) {
    *w = (struct world){ .f = f, .random = seed, .now_ms = 1 };
    w->videos = srv_video_encoders_create(VIDEO_PX, NULL, NULL);
    for (int i = 0; i < PEOPLE; i++)
        join(w, &w->people[i]);
}

static void tear_down(struct world *w) {
    while (w->flying_count > 0)
        finish_job(w, 0);
    for (int i = 0; i < PEOPLE; i++)
        leave(w, &w->people[i]);
    srv_video_encoders_destroy(&w->videos);
}

/* Until nobody wants anything any more. */
static void come_to_rest(struct world *w) {
    for (int turn = 0; turn < 50; turn++) {
        w->now_ms += 50;
        while (start_job(w))
            ;
        while (w->flying_count > 0)
            finish_job(w, 0);
        for (int i = 0; i < PEOPLE; i++)
            while (take(w, &w->people[i]))
                ;
    }
}

static void step(struct world *w) {
    static const char key[] = "{\"jsonrpc\":\"2.0\",\"method\":\"stream.key\"}";
    struct person *person = &w->people[roll(w, PEOPLE)];
    w->now_ms += roll(w, 12);
    switch (roll(w, 24)) {
    case 0:
        say(w, person->p, key);
        break;
    case 1:
        if (person != &w->people[0] && roll(w, 4) == 0) {
            leave(w, person);
            join(w, person);
        }
        break;
    case 2:
    case 3:
    case 4:
    case 5:
        change(w);
        break;
    case 6:
        w->now_ms += 150; /* long enough to be at rest */
        break;
    case 7:
    case 8:
    case 9:
    case 10:
    case 11:
    case 12:
        start_job(w);
        break;
    case 13:
    case 14:
    case 15:
    case 16:
    case 17:
        if (w->flying_count > 0)
            finish_job(w, roll(w, w->flying_count));
        break;
    default: /* the first two are faster than the third */
        if (person != &w->people[2] || roll(w, 3) == 0)
            take(w, person);
    }
}

static void whatever_happens(void **state) {
    unsigned videos = 0, keys = 0, stills = 0;
    for (unsigned seed = 1; seed <= 20; seed++) {
        struct world w;
        set_up(&w, *state, seed);
        for (int i = 0; i < 1500; i++)
            step(&w);
        change(&w);
        come_to_rest(&w);
        for (int i = 0; i < PEOPLE; i++) {
            assert_int_equal(w.people[i].version, w.people[0].version);
            assert_true(w.people[i].is_final);
            videos += w.people[i].videos;
            keys += w.people[i].keys;
            stills += w.people[i].stills;
        }
        tear_down(&w);
    }
    print_message("%u of video, %u of them keys; %u stills\n", videos, keys, stills);
    assert_compare(videos, >, 500);
    assert_compare(keys, >, 50);
    assert_compare(videos, >, keys + 200);
    assert_compare(stills, >, 50);
}

/* All keep up: a key frame for each size, then deltas, shared; the still at the end costs nobody a
 * key. */
static void in_step(void **state) {
    struct world w;
    set_up(&w, *state, 1);
    for (int round = 0; round < 2; round++) {
        for (int i = 0; i < 30; i++) {
            w.now_ms += 20;
            change(&w);
            if (start_job(&w))
                finish_job(&w, 0);
            for (int p = 0; p < PEOPLE; p++)
                while (take(&w, &w.people[p]))
                    ;
        }
        come_to_rest(&w);
    }
    for (int p = 0; p < PEOPLE; p++) {
        assert_compare(w.people[p].videos, >=, 50);
        /* The very first picture is smaller: nothing was known of its cost. */
        assert_int_equal(w.people[p].keys, 2);
        assert_true(w.people[p].is_final);
    }
    tear_down(&w);
}

/* What waits for the socket is not replaced: the newer frame is left out before it is encoded, and
 * the one after it is a delta. */
static void left_out(void **state) {
    struct world w;
    unsigned keys = 0, videos = 0;
    set_up(&w, *state, 1);
    for (int i = 0; i < 4; i++) {
        w.now_ms += 20;
        change(&w);
        assert_true(start_job(&w));
        if (i == 1) { /* two jobs under way, nobody takes the first one's frame */
            w.now_ms += 20;
            change(&w);
            assert_true(start_job(&w));
            keys = w.people[0].keys;
            videos = w.people[0].videos;
        }
        while (w.flying_count > 0)
            finish_job(&w, 0);
        for (int p = 0; p < PEOPLE; p++)
            while (take(&w, &w.people[p]))
                ;
        if (i == 1)
            assert_int_equal(w.people[0].videos, videos + 1);
    }
    assert_int_equal(w.people[0].videos, videos + 3);
    assert_compare(w.people[0].keys, <=, keys + 1); /* of the second size */
    tear_down(&w);
}

static void one_frame(struct world *w) {
    w->now_ms += 20;
    change(w);
    assert_true(start_job(w));
    finish_job(w, 0);
    for (int p = 0; p < PEOPLE; p++)
        while (take(w, &w->people[p]))
            ;
}

/* An encoder that nobody uses is given back, and the next picture begins anew. */
static void idle(void **state) {
    struct world w;
    set_up(&w, *state, 1);
    assert_false(srv_video_encoders_are_idle(w.videos, srv_clock_ms() + 1e6));
    one_frame(&w);
    one_frame(&w);
    one_frame(&w);
    unsigned keys = w.people[0].keys;
    assert_false(srv_video_encoders_are_idle(w.videos, 0));
    srv_video_encoders_tick(w.videos, 0);
    one_frame(&w);
    assert_int_equal(w.people[0].keys, keys);
    assert_true(srv_video_encoders_are_idle(w.videos, srv_clock_ms() + 11000));
    srv_video_encoders_tick(w.videos, srv_clock_ms() + 11000);
    assert_false(srv_video_encoders_are_idle(w.videos, srv_clock_ms() + 1e6));
    one_frame(&w);
    assert_int_equal(w.people[0].keys, keys + 1);
    tear_down(&w);
}

/* What happens to a participant between the question and the frame. */
static void races(void **state) {
    struct world w;
    struct proto_frame_header header = { .codec = PROTO_CODEC_VP8 },
                              still = { .codec = PROTO_CODEC_JPEG };
    struct srv_render_result result = { .render_ms = 1 };
    struct srv_video_mark key = { 5, 0 }, second = { 5, 1 }, third = { 5, 2 };
    struct srv_blob *blob = srv_blob_create((const uint8_t *)"12345678", 8);
    struct srv_message message;
    set_up(&w, *state, 1);
    struct srv_hub *hub = w.f->hub;
    struct srv_schedule *schedule = w.f->schedule;
    for (int i = 0; i < 2; i++) {
        change(&w);
        w.now_ms += 20;
        assert_true(start_job(&w));
    }
    struct srv_render_job *a = &w.flying[0].job, *b = &w.flying[1].job;
    struct srv_participant *p = w.people[0].p;
    uint32_t at[2] = { 0, 0 };
    while (a->targets[at[0]].participant != srv_participant_id(p))
        at[0]++;
    while (b->targets[at[1]].participant != srv_participant_id(p))
        at[1]++;
    /* A newer still came first: the key frame is late, and what follows it is no use. */
    assert_int_equal(srv_schedule_video_need(schedule, a, at[0], &key), SRV_VIDEO_KEY);
    srv_schedule_deliver(schedule, b, at[1], &still, blob);
    srv_schedule_deliver_video(schedule, a, at[0], &header, blob, &key);
    assert_int_equal(srv_schedule_video_need(schedule, a, at[0], &second), SRV_VIDEO_NONE);
    while (srv_hub_next_message(hub, p, true, w.now_ms, &message) == SRV_MESSAGE_TEXT)
        free(message.text);
    assert_int_equal(message.header.codec, PROTO_CODEC_JPEG);
    srv_blob_unref(&message.blob);
    a->order = b->order + 1;
    assert_int_equal(srv_schedule_video_need(schedule, a, at[0], &second), SRV_VIDEO_KEY);
    /* A delta that skips one is never put. */
    srv_schedule_deliver_video(schedule, a, at[0], &header, blob, &key);
    while (srv_hub_next_message(hub, p, true, w.now_ms, &message) == SRV_MESSAGE_TEXT)
        free(message.text);
    srv_blob_unref(&message.blob);
    b->order = a->order + 1;
    srv_schedule_deliver_video(schedule, b, at[1], &header, blob, &third);
    assert_int_equal(srv_schedule_video_need(schedule, b, at[1], &second), SRV_VIDEO_DELTA);
    assert_int_equal(srv_schedule_video_need(schedule, b, at[1], &third), SRV_VIDEO_KEY);
    srv_blob_unref(&blob);
    while (w.flying_count > 0) {
        free(w.flying[--w.flying_count].frame.pixels);
        srv_schedule_done(schedule, &w.flying[w.flying_count].job, &result);
    }
    tear_down(&w);
}

/* One asks for a key frame with every frame: the others' are few. */
static void greedy(void **state) {
    struct world w;
    set_up(&w, *state, 1);
    for (int i = 0; i < 150; i++) { /* 3 s */
        w.now_ms += 20;
        change(&w);
        say(&w, w.people[2].p, "{\"jsonrpc\":\"2.0\",\"method\":\"stream.key\"}");
        if (start_job(&w))
            finish_job(&w, 0);
        for (int p = 0; p < PEOPLE; p++)
            while (take(&w, &w.people[p]))
                ;
    }
    /* Encoders go by the real clock, which hardly moves here: one key for all, at the start. */
    assert_compare(w.people[0].videos, >, 100);
    assert_compare(w.people[0].keys, <=, 1 + w.people[2].keys);
    assert_compare(w.people[0].keys, <, 20);
    assert_compare(w.people[2].stills, >, 50);
    tear_down(&w);
}

/* One takes a tenth of the frames: each time it lacks those between, and the jobs of its own have
 * nobody else in them. The others' key frames are few. */
static void slower(void **state) {
    struct world w;
    set_up(&w, *state, 1);
    say(&w, w.people[2].p,
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\",\"params\":{\"max_fps\":7}"
        "}");
    unsigned alone = 0;
    for (int i = 0; i < 600; i++) {
        w.now_ms += 5;
        change(&w); /* so often that it is due when the others have theirs */
        if (start_job(&w)) {
            alone += w.flying[0].job.target_count == 1;
            finish_job(&w, 0);
        }
        for (int p = 0; p < PEOPLE; p++)
            while (take(&w, &w.people[p]))
                ;
    }
    /* Encoders go by the real clock, as in greedy(). */
    assert_compare(alone, >, 3);
    assert_compare(w.people[0].videos, >, 100);
    assert_compare(w.people[0].keys, <, 5);
    assert_compare(w.people[2].stills, >, 3);
    tear_down(&w);
}

static void drag(struct world *w, int frames) {
    for (int i = 0; i < frames; i++) {
        w->now_ms += 20;
        change(w);
        while (start_job(w))
            ;
        while (w->flying_count > 0)
            finish_job(w, 0);
        for (int p = 0; p < PEOPLE; p++)
            while (take(w, &w->people[p]))
                ;
    }
}

/* A picture that is larger than all encoders together may be gets JPEG and is told so once; the
 * others' video goes on, and so does its own with a smaller picture. */
static void no_room(void **state) {
    struct world w;
    set_up(&w, *state, 1);
    struct person *large = &w.people[2];
    say(&w, large->p,
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\",\"params\":{\"size\":"
        "[1100,1000]}}");
    drag(&w, 1);
    unsigned told = large->policies;
    drag(&w, 9);
    assert_int_equal(large->videos, 0);
    assert_true(large->stills > 0);
    assert_int_equal(large->refusals, 1);
    assert_int_equal(large->policies, told);
    assert_compare(w.people[0].videos, >, 3);
    assert_int_equal(w.people[0].refusals, 0);
    say(&w, large->p,
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\",\"params\":{\"size\":"
        "[128,48]}}");
    w.now_ms += 20;
    change(&w);
    assert_true(start_job(&w));
    assert_true(start_job(&w));
    while (w.flying_count > 0)
        finish_job(&w, 0);
    while (take(&w, large))
        ;
    assert_int_equal(large->videos, 1);
    assert_true(large->policies > told);
    assert_int_equal(large->refusals, 1);
    tear_down(&w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(in_step, hub_set_up, hub_tear_down),
        cmocka_unit_test_setup_teardown(left_out, hub_set_up, hub_tear_down),
        cmocka_unit_test_setup_teardown(idle, hub_set_up, hub_tear_down),
        cmocka_unit_test_setup_teardown(races, hub_set_up, hub_tear_down),
        cmocka_unit_test_setup_teardown(no_room, hub_set_up, hub_tear_down),
        cmocka_unit_test_setup_teardown(greedy, hub_set_up, hub_tear_down),
        cmocka_unit_test_setup_teardown(slower, hub_set_up, hub_tear_down),
        cmocka_unit_test_setup_teardown(whatever_happens, hub_set_up, hub_tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
