/* SPDX-License-Identifier: Apache-2.0
 *
 * A hub with one session and no sockets, renderer or clock.
 */
#ifndef TESTS_UNIT_SERVER_HUB_FIXTURE_H
#define TESTS_UNIT_SERVER_HUB_FIXTURE_H

#include "schedule/quality.h"
#include "schedule/schedule.h"
#include "session/participant.h"
#include "sp/pick.h"
#include "sp/volume.h"

struct fixture_step { /* a time step: srv_volume_source.step() returns its address */
    bool is_loaded, has_failed;
};

struct fixture {
    struct srv_hub *hub;
    struct srv_schedule *schedule;
    struct srv_metrics *metrics;
    struct srv_work_queue *picking; /* its thread has ended, so work runs at once */
    struct sp_volume_info info;
    struct sp_view view; /* the default view of all volumes */
    int uses;
    unsigned interrupts, yields; /* yields: for SRV_INTERRUPT_MOTION; interrupts: all others */
    enum srv_interrupt why;      /* reason of the last one in `interrupts` */
    uint64_t of;
    char id[SRV_SESSION_ID_BYTES];
    struct srv_quota *quota; /* of the token ann; NULL = there is no such token */
    unsigned rights;         /* of the token ann */
    bool draws_drafts;       /* a frame that is asked for as a draft is one */
    bool has_depth;          /* frames have depth */
    uint32_t step_count;
    struct fixture_step steps[4];
    struct fixture_step others[4]; /* steps of the volume "w", which a layer of the view may name */
    bool is_missing;               /* "w" is not loaded */
    bool is_out_of_memory;         /* acquiring a time step of "w" fails */
    struct sp_pick picked;         /* the result of picks in the right half of the image */
};

/* For cmocka; *state is a struct fixture. The tear-down fails if the hub has not released each use
 * of a volume. */
int hub_set_up(void **state);
int hub_set_up_series(void **state); /* volumes have four time steps */
int hub_tear_down(void **state);

struct srv_participant *hub_join(struct fixture *f, enum srv_role role, double now_ms);

/* Sends a request of a participant, which must succeed. */
void hub_send(struct fixture *f, struct srv_participant *p, const char *method, const char *params,
              double now_ms);
/* Sends view.update number `seq`, which changes the background. */
void hub_update(struct fixture *f, struct srv_participant *p, unsigned seq, double now_ms);
void hub_ack(struct fixture *f, struct srv_participant *p, unsigned frame, double now_ms);
/* Takes all messages of a participant. Returns the last frame's header, or frame 0. */
struct proto_frame_header hub_drain(struct fixture *f, struct srv_participant *p, double now_ms);

bool hub_next_job(struct fixture *f, double now_ms, struct srv_render_job *job);
/* Delivers a frame to all targets of the job and ends it. */
void hub_finish(struct fixture *f, struct srv_render_job *job, double render_ms);
/* One frame of a drag: updates the view, renders it in render_ms and acknowledges it. Returns the
 * scheduled job. */
struct srv_render_job hub_drag(struct fixture *f, struct srv_participant *p, unsigned seq,
                               double now_ms, double render_ms);
/* Renders the first frames of a participant at time 0, up to a moving one in full detail, after
 * which no other frame is due. */
void hub_drag_until_final(struct fixture *f, struct srv_participant *p);

#endif
