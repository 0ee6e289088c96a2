/* SPDX-License-Identifier: Apache-2.0
 *
 * Video for several participants, each with its own decoder. Frames arrive late, are skipped, or
 * are replaced by images, and participants ask for key frames. Each frame that arrives can be
 * decoded, and shows the version of the view that its header names. The tests write that version
 * into the header's render time. The test passes the time.
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

#include "render/video.h"
#include "support/compare.h"
#include "unit/server/session/hub_fixture.h"

enum {
    WIDTH = 64,
    HEIGHT = 48,
    SIDE = 16,
    VIEWERS = 3,
    JOBS = 2,
    VIDEO_PX = 1 << 20,
    BUDGET = 1 << 20
};

struct viewer {
    struct srv_participant *p;
    vpx_codec_ctx_t decoder;
    unsigned videos, keys, images;
    uint64_t version; /* of the newest frame */
    bool is_final;
    unsigned policies, refusals; /* stream.policy messages; how many name video_pixels */
};

struct inflight {
    struct srv_render_job job;
    struct sp_frame frame;
};

struct world {
    struct fixture *f;
    struct sp_budget *budget; /* of the encoded frames */
    struct srv_blob_pool *blobs;
    struct srv_video_encoders *videos;
    struct viewer viewers[VIEWERS];
    struct inflight jobs[JOBS];
    unsigned job_count, seq;
    uint64_t random;
    double now_ms;
};

static unsigned random_below(struct world *w, unsigned bound) {
    w->random = w->random * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (unsigned)(w->random >> 33) % bound;
}

/* Each version changes one of twelve blocks, so a decoder that lacks a frame shows an old block. */
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

static void send_text(struct world *w, struct srv_participant *p, const char *text) {
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
    send_text(w, w->viewers[0].p, text);
}

static void join(struct world *w, struct viewer *viewer) {
    *viewer = (struct viewer){ .p = hub_join(w->f, SRV_ROLE_CONTROL, w->now_ms) };
    assert_int_equal(vpx_codec_dec_init(&viewer->decoder, vpx_codec_vp8_dx(), NULL, 0), 0);
    send_text(
        w, viewer->p,
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\",\"params\":{\"format\":"
        "[\"vp8\"],\"size\":[64,48],\"max_fps\":120}}");
}

static void leave(struct world *w, struct viewer *viewer) {
    vpx_codec_destroy(&viewer->decoder);
    srv_hub_leave(w->f->hub, &viewer->p, w->now_ms);
}

static void check_frame(struct viewer *viewer, const struct srv_message *message) {
    vpx_codec_iter_t at = NULL;
    uint64_t version = (message->header.render_us + 500) / 1000;
    assert_int_equal(vpx_codec_decode(&viewer->decoder, message->blob->bytes,
                                      (unsigned)message->blob->size, NULL, 0),
                     0);
    const vpx_image_t *image = vpx_codec_get_frame(&viewer->decoder, &at);
    assert_non_null(image);
    for (unsigned y = SIDE / 2; y < image->d_h; y += SIDE)
        for (unsigned x = SIDE / 2; x < image->d_w; x += SIDE) {
            double luma = image->planes[0][y * (size_t)image->stride[0] + x];
            double seen = 1.164384 * (luma - 16), right = grey(version, x, y);
            if (fabs(seen - right) > 12)
                fail_msg("version %llu at %u, %u: %.0f, not %.0f", (unsigned long long)version, x,
                         y, seen, right);
        }
    viewer->version = version;
}

/* Takes the viewer's next message and checks it. False if there is none. */
static bool receive_message(struct world *w, struct viewer *viewer) {
    struct srv_message message;
    switch (srv_hub_next_message(w->f->hub, viewer->p, SRV_NEXT_ALL, w->now_ms, &message)) {
    case SRV_MESSAGE_NONE:
    case SRV_MESSAGE_CLOSE:
        return false;
    case SRV_MESSAGE_TEXT:
        if (strstr(message.text, "stream.policy")) {
            viewer->policies++;
            viewer->refusals += strstr(message.text, "video_pixels") != NULL;
        }
        free(message.text);
        return true;
    case SRV_MESSAGE_FRAME:
        break;
    }
    char text[120];
    bool is_video = message.header.codec == PROTO_CODEC_VP8;
    viewer->is_final = (message.header.flags & PROTO_FRAME_FINAL) != 0;
    if (is_video) {
        assert_false(viewer->is_final);
        check_frame(viewer, &message);
        viewer->videos++;
        viewer->keys += message.header.flags & PROTO_FRAME_KEY;
    } else {
        assert_int_equal(message.header.codec, PROTO_CODEC_JPEG);
        assert_int_equal(message.header.flags & PROTO_FRAME_KEY, PROTO_FRAME_KEY);
        memcpy(&viewer->version, message.blob->bytes, sizeof viewer->version);
        viewer->images++;
    }
    snprintf(text, sizeof text,
             "{\"jsonrpc\":\"2.0\",\"method\":\"stream.ack\",\"params\":{\"frame\":%u}}",
             message.header.frame);
    send_text(w, viewer->p, text);
    srv_blob_unref(&message.blob);
    return true;
}

static bool start_job(struct world *w) {
    double wait_ms;
    struct inflight *inflight = &w->jobs[w->job_count];
    if (w->job_count == JOBS ||
        !srv_schedule_next(w->f->schedule, w->now_ms, &inflight->job, &wait_ms))
        return false;
    inflight->frame = draw(&inflight->job);
    w->job_count++;
    return true;
}

static void deliver_image(const struct world *w, const struct srv_render_job *job, uint32_t i,
                          struct srv_blob *blob) {
    const struct proto_frame_header header = { .codec = PROTO_CODEC_JPEG,
                                               .width = (uint16_t)job->view.size[0],
                                               .height = (uint16_t)job->view.size[1] };
    const struct srv_drawn_frame frame = srv_render_job_frame(job);
    srv_hub_deliver(w->f->hub, &frame, &job->targets[i], &header, blob);
}

static void finish_job(struct world *w, unsigned which) {
    struct inflight inflight = w->jobs[which];
    struct srv_render_result result = { .width = inflight.frame.width,
                                        .height = inflight.frame.height,
                                        .render_ms = 1 };
    w->jobs[which] = w->jobs[--w->job_count];
    double encode_ms = 0;
    uint64_t images = srv_video_encoders_encode(w->videos, w->f->schedule, &inflight.job,
                                                &inflight.frame, w->now_ms, &encode_ms);
    struct srv_blob *blob =
        srv_blob_create(NULL, NULL, (const uint8_t *)&inflight.job.version, 8, NULL);
    for (uint32_t i = 0; i < inflight.job.target_count; i++)
        if (images >> i & 1)
            deliver_image(w, &inflight.job, i, blob);
    srv_blob_unref(&blob);
    free(inflight.frame.pixels);
    srv_schedule_done(w->f->schedule, &inflight.job, &result);
}

static void set_up(struct world *w, struct fixture *f, unsigned seed) {
    *w = (struct world){ .f = f, .random = seed, .now_ms = 1 };
    w->budget = sp_budget_create(BUDGET, NULL);
    w->blobs = srv_blob_pool_create(&(struct srv_blob_pool_options){ .budget = w->budget }, NULL);
    w->videos = srv_video_encoders_create(VIDEO_PX, NULL, w->blobs, NULL, NULL);
    for (int i = 0; i < VIEWERS; i++)
        join(w, &w->viewers[i]);
}

static void tear_down(struct world *w) {
    while (w->job_count > 0)
        finish_job(w, 0);
    for (int i = 0; i < VIEWERS; i++)
        leave(w, &w->viewers[i]);
    srv_video_encoders_destroy(&w->videos);
    srv_blob_pool_destroy(&w->blobs);
    sp_budget_destroy(&w->budget);
}

/* Runs until no frame is due. */
static void come_to_rest(struct world *w) {
    for (int round = 0; round < 50; round++) {
        w->now_ms += 50;
        while (start_job(w))
            ;
        while (w->job_count > 0)
            finish_job(w, 0);
        for (int i = 0; i < VIEWERS; i++)
            while (receive_message(w, &w->viewers[i]))
                ;
    }
}

static void step(struct world *w) {
    static const char key[] = "{\"jsonrpc\":\"2.0\",\"method\":\"stream.key\"}";
    struct viewer *viewer = &w->viewers[random_below(w, VIEWERS)];
    w->now_ms += random_below(w, 12);
    switch (random_below(w, 24)) {
    case 0:
        send_text(w, viewer->p, key);
        break;
    case 1:
        if (viewer != &w->viewers[0] && random_below(w, 4) == 0) {
            leave(w, viewer);
            join(w, viewer);
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
        if (w->job_count > 0)
            finish_job(w, random_below(w, w->job_count));
        break;
    default: /* the third viewer is slower than the others */
        if (viewer != &w->viewers[2] || random_below(w, 3) == 0)
            receive_message(w, viewer);
    }
}

static void decoders_stay_in_sync_through_random_events(void **state) {
    unsigned videos = 0, keys = 0, images = 0;
    for (unsigned seed = 1; seed <= 20; seed++) {
        struct world w;
        set_up(&w, *state, seed);
        for (int i = 0; i < 1500; i++)
            step(&w);
        change(&w);
        come_to_rest(&w);
        for (int i = 0; i < VIEWERS; i++) {
            assert_int_equal(w.viewers[i].version, w.viewers[0].version);
            assert_true(w.viewers[i].is_final);
            videos += w.viewers[i].videos;
            keys += w.viewers[i].keys;
            images += w.viewers[i].images;
        }
        tear_down(&w);
    }
    print_message("%u video frames, %u of them key frames; %u images\n", videos, keys, images);
    assert_compare(videos, >, 500);
    assert_compare(keys, >, 50);
    assert_compare(videos, >, keys + 200);
    assert_compare(images, >, 50);
}

/* All viewers keep up: each size begins with a key frame, and they share the delta frames. The
 * final image costs no further key frame. */
static void viewers_that_keep_up_share_delta_frames(void **state) {
    struct world w;
    set_up(&w, *state, 1);
    for (int round = 0; round < 2; round++) {
        for (int i = 0; i < 30; i++) {
            w.now_ms += 20;
            change(&w);
            if (start_job(&w))
                finish_job(&w, 0);
            for (int p = 0; p < VIEWERS; p++)
                while (receive_message(&w, &w.viewers[p]))
                    ;
        }
        come_to_rest(&w);
    }
    for (int p = 0; p < VIEWERS; p++) {
        assert_compare(w.viewers[p].videos, >=, 50);
        /* The first frame is smaller, because its time was not known. */
        assert_int_equal(w.viewers[p].keys, 2);
        assert_true(w.viewers[p].is_final);
    }
    tear_down(&w);
}

/* A video frame that waits for the socket is not replaced. The newer frame is skipped before it is
 * encoded, and the frame after it is a delta frame. */
static void a_frame_skipped_before_encoding_costs_no_key_frame(void **state) {
    struct world w;
    unsigned keys = 0, videos = 0;
    set_up(&w, *state, 1);
    for (int i = 0; i < 4; i++) {
        w.now_ms += 20;
        change(&w);
        assert_true(start_job(&w));
        if (i == 1) { /* two jobs end before any viewer takes the first frame */
            w.now_ms += 20;
            change(&w);
            assert_true(start_job(&w));
            keys = w.viewers[0].keys;
            videos = w.viewers[0].videos;
        }
        while (w.job_count > 0)
            finish_job(&w, 0);
        for (int p = 0; p < VIEWERS; p++)
            while (receive_message(&w, &w.viewers[p]))
                ;
        if (i == 1)
            assert_int_equal(w.viewers[0].videos, videos + 1);
    }
    assert_int_equal(w.viewers[0].videos, videos + 3);
    assert_compare(w.viewers[0].keys, <=, keys + 1); /* for the second size */
    tear_down(&w);
}

static void one_frame(struct world *w) {
    w->now_ms += 20;
    change(w);
    assert_true(start_job(w));
    finish_job(w, 0);
    for (int p = 0; p < VIEWERS; p++)
        while (receive_message(w, &w->viewers[p]))
            ;
}

/* An unused encoder is destroyed. The next frame comes from a new one, with a key frame. */
static void an_idle_encoder_is_destroyed(void **state) {
    struct world w;
    set_up(&w, *state, 1);
    assert_false(srv_video_encoders_are_idle(w.videos, w.now_ms + 1e6));
    one_frame(&w);
    one_frame(&w);
    one_frame(&w);
    unsigned keys = w.viewers[0].keys;
    assert_false(srv_video_encoders_are_idle(w.videos, 0));
    srv_video_encoders_tick(w.videos, 0);
    one_frame(&w);
    assert_int_equal(w.viewers[0].keys, keys);
    assert_true(srv_video_encoders_are_idle(w.videos, w.now_ms + 11000));
    srv_video_encoders_tick(w.videos, w.now_ms + 11000);
    assert_false(srv_video_encoders_are_idle(w.videos, w.now_ms + 1e6));
    one_frame(&w);
    assert_int_equal(w.viewers[0].keys, keys + 1);
    tear_down(&w);
}

/* The viewers get images instead, and a key frame once packets fit again. */
static void a_packet_that_does_not_fit_becomes_an_image(void **state) {
    struct world w;
    set_up(&w, *state, 1);
    one_frame(&w);
    one_frame(&w);
    const struct viewer before = w.viewers[0];
    const uint64_t others = BUDGET - sp_budget_total(w.budget);
    assert_true(sp_budget_acquire(w.budget, SP_BUDGET_ARENAS, others));
    one_frame(&w);
    assert_int_equal(w.viewers[0].videos, before.videos);
    assert_int_equal(w.viewers[0].images, before.images + 1);
    sp_budget_release(w.budget, SP_BUDGET_ARENAS, others);
    one_frame(&w);
    assert_int_equal(w.viewers[0].videos, before.videos + 1);
    assert_int_equal(w.viewers[0].keys, before.keys + 1);
    tear_down(&w);
}

/* Takes the image that waits for the participant; returns its codec. */
static int receive_frame(const struct world *w, struct srv_participant *p) {
    struct srv_message message;
    while (srv_hub_next_message(w->f->hub, p, SRV_NEXT_ALL, w->now_ms, &message) ==
           SRV_MESSAGE_TEXT)
        free(message.text);
    srv_blob_unref(&message.blob);
    return message.header.codec;
}

/* The state of a participant may change between its decision and the delivery. */
static void a_delivery_checks_the_mark_again(void **state) {
    struct world w;
    const struct proto_frame_header header = { .codec = PROTO_CODEC_VP8 };
    struct srv_render_result result = { .render_ms = 1 };
    struct srv_video_mark key = { 5, 0 }, second = { 5, 1 }, third = { 5, 2 };
    struct srv_blob *blob = srv_blob_create(NULL, NULL, (const uint8_t *)"12345678", 8, NULL);
    set_up(&w, *state, 1);
    struct srv_hub *hub = w.f->hub;
    struct srv_participant *p = w.viewers[0].p;
    struct srv_drawn_frame a, b, *frames[2] = { &a, &b };
    uint32_t at[2] = { 0, 0 };
    for (int i = 0; i < 2; i++) {
        change(&w);
        w.now_ms += 20;
        assert_true(start_job(&w));
        *frames[i] = srv_render_job_frame(&w.jobs[i].job);
        while (w.jobs[i].job.targets[at[i]].participant != srv_participant_id(p))
            at[i]++;
    }
    const struct srv_frame_target *to = &w.jobs[0].job.targets[at[0]];
    /* A newer image came first: the key frame is late, and its delta frames cannot be used. */
    assert_int_equal(srv_hub_video_need(hub, &a, to, &key), SRV_VIDEO_KEY);
    deliver_image(&w, &w.jobs[1].job, at[1], blob);
    srv_hub_deliver_video(hub, &a, to, &header, blob, &key);
    assert_int_equal(srv_hub_video_need(hub, &a, to, &second), SRV_VIDEO_NONE);
    a.order = b.order + 1;
    assert_int_equal(srv_hub_video_need(hub, &a, to, &second), SRV_VIDEO_WAITS);
    assert_int_equal(receive_frame(&w, p), PROTO_CODEC_JPEG);
    assert_int_equal(srv_hub_video_need(hub, &a, to, &second), SRV_VIDEO_KEY);
    /* A delta frame after a missing one is not delivered. */
    srv_hub_deliver_video(hub, &a, to, &header, blob, &key);
    assert_int_equal(receive_frame(&w, p), PROTO_CODEC_VP8);
    b.order = a.order + 1;
    to = &w.jobs[1].job.targets[at[1]];
    srv_hub_deliver_video(hub, &b, to, &header, blob, &third);
    assert_int_equal(srv_hub_video_need(hub, &b, to, &second), SRV_VIDEO_DELTA);
    assert_int_equal(srv_hub_video_need(hub, &b, to, &third), SRV_VIDEO_KEY);
    srv_blob_unref(&blob);
    while (w.job_count > 0) {
        free(w.jobs[--w.job_count].frame.pixels);
        srv_schedule_done(w.f->schedule, &w.jobs[w.job_count].job, &result);
    }
    tear_down(&w);
}

/* A viewer that asks for a key frame with every frame causes few key frames for the others. */
static void requests_for_key_frames_are_limited(void **state) {
    struct world w;
    set_up(&w, *state, 1);
    for (int i = 0; i < 150; i++) { /* 3 s */
        w.now_ms += 20;
        change(&w);
        send_text(&w, w.viewers[2].p, "{\"jsonrpc\":\"2.0\",\"method\":\"stream.key\"}");
        if (start_job(&w))
            finish_job(&w, 0);
        for (int p = 0; p < VIEWERS; p++)
            while (receive_message(&w, &w.viewers[p]))
                ;
    }
    assert_compare(w.viewers[0].videos, >, 100);
    assert_compare(w.viewers[0].keys, <=, 1 + w.viewers[2].keys);
    assert_compare(w.viewers[0].keys, <, 20);
    assert_compare(w.viewers[2].images, >, 50);
    tear_down(&w);
}

/* A viewer takes a tenth of the frames and lacks the frames between. It shares all its jobs with
 * the other viewers, and causes few key frames for them. */
static void a_slower_viewer_costs_few_key_frames(void **state) {
    struct world w;
    set_up(&w, *state, 1);
    send_text(
        &w, w.viewers[2].p,
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\",\"params\":{\"max_fps\":7}"
        "}");
    unsigned alone = 0;
    for (int i = 0; i < 600; i++) {
        w.now_ms += 5;
        change(&w); /* often enough for its frame to be due together with the others' */
        if (start_job(&w)) {
            alone += w.jobs[0].job.target_count == 1;
            finish_job(&w, 0);
        }
        for (int p = 0; p < VIEWERS; p++)
            while (receive_message(&w, &w.viewers[p]))
                ;
    }
    assert_int_equal(alone, 0);
    assert_compare(w.viewers[0].videos, >, 100);
    assert_compare(w.viewers[0].keys, <, 5);
    assert_compare(w.viewers[2].images, >, 3);
    tear_down(&w);
}

static void drag(struct world *w, int frames) {
    for (int i = 0; i < frames; i++) {
        w->now_ms += 20;
        change(w);
        while (start_job(w))
            ;
        while (w->job_count > 0)
            finish_job(w, 0);
        for (int p = 0; p < VIEWERS; p++)
            while (receive_message(w, &w->viewers[p]))
                ;
    }
}

/* A viewer whose frame exceeds the bound of all encoders receives JPEG and one policy that says so.
 * The video of other viewers continues. Its own video continues with a smaller frame. */
static void frames_above_the_bound_are_images(void **state) {
    struct world w;
    set_up(&w, *state, 1);
    struct viewer *large = &w.viewers[2];
    send_text(&w, large->p,
              "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\",\"params\":{\"size\":"
              "[1100,1000]}}");
    drag(&w, 1);
    unsigned policies = large->policies;
    drag(&w, 9);
    assert_int_equal(large->videos, 0);
    assert_compare(large->images, >, 0);
    assert_int_equal(large->refusals, 1);
    assert_int_equal(large->policies, policies);
    assert_compare(w.viewers[0].videos, >, 3);
    assert_int_equal(w.viewers[0].refusals, 0);
    send_text(&w, large->p,
              "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\",\"params\":{\"size\":"
              "[128,48]}}");
    w.now_ms += 20;
    change(&w);
    assert_true(start_job(&w));
    assert_true(start_job(&w));
    while (w.job_count > 0)
        finish_job(&w, 0);
    while (receive_message(&w, large))
        ;
    assert_int_equal(large->videos, 1);
    assert_compare(large->policies, >, policies);
    assert_int_equal(large->refusals, 1);
    tear_down(&w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, hub_set_up, hub_tear_down)
        TEST(viewers_that_keep_up_share_delta_frames),
        TEST(a_frame_skipped_before_encoding_costs_no_key_frame),
        TEST(an_idle_encoder_is_destroyed),
        TEST(a_packet_that_does_not_fit_becomes_an_image),
        TEST(a_delivery_checks_the_mark_again),
        TEST(frames_above_the_bound_are_images),
        TEST(requests_for_key_frames_are_limited),
        TEST(a_slower_viewer_costs_few_key_frames),
        TEST(decoders_stay_in_sync_through_random_events),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
