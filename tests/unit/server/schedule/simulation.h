/* SPDX-License-Identifier: Apache-2.0
 *
 * One worker and its clients in virtual time, for tests of the scheduler. A frame takes a time that
 * follows from its size and mip level. Clients change their views at fixed intervals, and take and
 * acknowledge every frame at once.
 */
#ifndef TESTS_UNIT_SERVER_SCHEDULE_SIMULATION_H
#define TESTS_UNIT_SERVER_SCHEDULE_SIMULATION_H

#include "unit/server/session/hub_fixture.h"

enum { SIM_CLIENTS = 3 };

struct sim_client {
    struct srv_participant *participant;
    double period_ms, next_ms; /* period of its updates, 0 = it sends none; time of the next */
    unsigned seq;              /* number of its newest update */
    bool is_stalled;           /* its socket takes no bytes */
    uint32_t unacked;          /* a frame that it took without acknowledging it; 0 = none */
    unsigned frames, finals;   /* frames and final frames that it received */
    double took_ms;            /* time of rendering its frames, cancelled ones included */
    double last_ms, gap_ms; /* when its last frame arrived; the longest time between two frames */
};

struct simulation {
    struct fixture *f;
    struct sim_client clients[SIM_CLIENTS];
    struct srv_render_job job; /* the running job, if there is one */
    bool yields;               /* since the job began, the hub asked unprotected jobs to end */
    double now_ms, begun_ms, end_ms; /* end_ms: INFINITY = no job is running */
    double fixed_ms, mpx_ms;         /* render time per frame, and per megapixel at level 0 */
    double paused_ms;                /* how long short frames have paused the running job */
    bool has_preemption;             /* short frames may preempt the running job */
    const struct sim_client *hog;    /* each frame of this client begins with work of once_ms */
    double once_ms;
    const struct sim_client *slow_encoder; /* each frame of this client takes encode_ms to encode */
    double encode_ms;
    size_t bytes;           /* size of each encoded image */
    struct srv_blob *image; /* an image of this size; owned */
    unsigned jobs;          /* jobs that were finished and delivered */
};

/* For cmocka; *state is a struct simulation with one session (f->id) and no clients. */
int sim_set_up(void **state);
int sim_tear_down(void **state);

/* Creates another session and writes its id. */
void sim_session(struct simulation *s, char id[SRV_SESSION_ID_BYTES]);
/* Creates a session of this owner and writes its id. */
void sim_session_of(struct simulation *s, const char *name, char id[SRV_SESSION_ID_BYTES]);
/* Joins client `i` to the session. `settings` are the parameters of stream.configure. */
struct sim_client *sim_join(struct simulation *s, unsigned i, const char *id, double period_ms,
                            const char *settings);
/* Sends a request of the client. */
void sim_send(struct simulation *s, struct sim_client *c, const char *method, const char *params);
/* The client changes its view. Cancels the running job if the hub asks to end it. */
void sim_turn(struct simulation *s, struct sim_client *c);
/* The client takes all its messages, and acknowledges the frames if `acks`. */
void sim_receive(struct simulation *s, struct sim_client *c, bool acks);
void sim_ack(struct simulation *s, struct sim_client *c, uint32_t frame);

/* Runs the worker and the clients for for_ms of virtual time. */
void sim_run(struct simulation *s, double for_ms);
/* Sets the counters of the clients to 0. */
void sim_reset(struct simulation *s);

bool sim_is_for(const struct srv_render_job *job, const struct sim_client *c);
/* Returns how long the job takes to render [ms]. */
double sim_duration(const struct simulation *s, const struct srv_render_job *job);
/* Delivers the job's frame; clients whose sockets are not stalled take it at once. */
void sim_deliver(struct simulation *s, struct srv_render_job *job, double render_ms);
struct srv_running_job sim_running_job(const struct srv_render_job *job, double drawn_ms);

#endif
