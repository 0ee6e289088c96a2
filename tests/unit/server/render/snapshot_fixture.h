/* SPDX-License-Identifier: Apache-2.0
 *
 * The snapshot worker behind a gate (support/gate.h). The linker replaces sp_renderer_render(),
 * which only this worker calls: each snapshot waits there until the test lets it through or its
 * cancel flag is set. Session frames are rendered by the null backend. The linker also replaces
 * sp_encode(), sp_encoder_set_share() and clock_gettime(), to count, to block and to jump.
 */
#ifndef TESTS_UNIT_SERVER_RENDER_SNAPSHOT_FIXTURE_H
#define TESTS_UNIT_SERVER_RENDER_SNAPSHOT_FIXTURE_H

#include <stdatomic.h>

#include "support/render_fixture.h"

enum {
    SNAP_QUEUE = 4,
    SNAP_SHARP = 90,
    SNAP_STREAM_THREADS = 3, /* encode threads in the foreground */
    SNAP_ENCODE_THREADS = 5, /* all encode threads */
    SNAP_STRIPES = 8,
    SNAP_SLOW_PX = 2500000 /* a PNG of this size is slow to encode (SRV_SLOW_ENCODE_MS) */
};

struct snap_seen { /* guarded by the gate's mutex */
    unsigned encoded;
    unsigned sharp;     /* how many of these have the quality of final frames */
    unsigned width[16]; /* widths of the snapshots that entered the gate, in order */
    struct {            /* the callback of each encoder, in the order of the threads */
        struct sp_encoder *encoder;
        sp_share_fn *share;
        void *user;
    } sharers[SNAP_ENCODE_THREADS];
    unsigned sharer_count;
    bool shares;                   /* each encoding calls make_stripe() for SNAP_STRIPES stripes */
    unsigned at_stripes, together; /* threads in make_stripe(), and how many it waits for */
    unsigned made[SNAP_STRIPES], by[SNAP_ENCODE_THREADS];
    uint64_t blocked_png_px; /* PNGs of at least this size wait before encoding; 0 = none */
    unsigned pngs;           /* encodings of PNG that were begun */
};
extern struct snap_seen snap_seen;
extern _Atomic int64_t snap_ahead_s; /* seconds that the clock is ahead of the real one */

struct snap_fixture {
    struct render_fixture render;
    struct srv_participant *participant; /* NULL until one joins */
    char id[SRV_SESSION_ID_BYTES];
};

struct snap_client { /* the client of one snapshot; all zero: requests a JPEG */
    enum sp_image_format format;
    int quality; /* 0 = the quality of final frames */
    const char *owner;
    double expected_ms;
    bool wants_frame, is_admin;
    unsigned answers, images, frames;
    size_t size;
    uint32_t sum; /* sum of the bytes */
    atomic_bool left;
};

/* For cmocka; *state is a struct snap_fixture with one session. `threads`: for encoding in the
 * foreground. */
int snap_set_up(void **state, unsigned threads);
int snap_tear_down(void **state);

/* Requests a snapshot of this width. False if the queue refuses it. */
bool snap_request(struct snap_fixture *f, struct snap_client *client, unsigned width,
                  bool background);

void snap_send(struct snap_fixture *f, struct srv_participant *participant, const char *method,
               const char *params);
/* Waits for the participant's next frame and acknowledges it. */
struct proto_frame_header snap_next_frame(struct snap_fixture *f,
                                          struct srv_participant *participant);
/* Takes the participant's frames up to the final one. */
void snap_await_final_frame(struct snap_fixture *f, struct srv_participant *participant);

/* PNGs of at least so many pixels wait before they are encoded; 0 = none. */
void snap_block_png(uint64_t px);
/* From now on each encoding shares SNAP_STRIPES stripes, which wait until `together` threads have
 * begun one. */
void snap_share_by(unsigned together);

#endif
