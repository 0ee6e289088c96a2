/* SPDX-License-Identifier: Apache-2.0
 *
 * Which picture to make next, and where it goes.
 *
 *   a participant wants a frame if        and gets it if
 *     the view is newer than its last job   its window is open (flow.h) and its rate allows it
 *     or the view rests and its last frame
 *     was not of final quality
 */
#include <assert.h>
#include <math.h>
#include <string.h>

#include "session/hub_private.h"

enum { QUALITY_MOVING = 60 };
#define FIRST_PICTURE_MS 150.0 /* a first picture that takes longer is shown coarse first */

enum want { WANT_NOTHING, WANT_FINAL, WANT_MOVING };

struct wish {
    enum want want;
    bool refinement;
    double in_ms; /* if nothing is wanted now: ask again in; INFINITY = not by time */
};

static bool is_open(const struct srv_hub *hub, const struct srv_participant *p) {
    unsigned waiting = p->pipeline + (p->outbox.blob ? 1 : 0);
    return srv_flow_is_open(&p->flow, waiting, p->max_fps, hub->options.stream_bytes) &&
           p->flow.count + waiting < SRV_FLOW_MAX;
}

static struct wish wish_of(const struct srv_hub *hub, const struct srv_session *s,
                           const struct srv_participant *p, double now_ms) {
    struct wish wish = { .want = WANT_NOTHING, .in_ms = INFINITY };
    bool newer = p->taken_version < s->version;
    if ((!newer && p->taken_final) || p->failed_version == s->version || !is_open(hub, p))
        return wish;
    double rate_ms = p->next_frame_ms - now_ms;
    double rest_ms = s->changed_ms + hub->options.rest_ms - now_ms;
    if (!newer)
        rate_ms = fmax(rate_ms, rest_ms);
    if (rate_ms > 0) {
        wish.in_ms = rate_ms;
        return wish;
    }
    uint32_t size[2];
    srv_hub_size(s, p, size);
    bool slow = srv_pace_expect_ms(&s->pace[0], (double)size[0] * size[1]) > FIRST_PICTURE_MS;
    bool resting = rest_ms <= 0 && s->pace[0].weight > 0 && !slow;
    wish.refinement = p->progressive && (!newer || resting);
    wish.want = !p->progressive || wish.refinement ? WANT_FINAL : WANT_MOVING;
    return wish;
}

static bool same_picture(const struct srv_session *s, const struct srv_participant *a,
                         const struct srv_participant *b) {
    uint32_t size[2][2];
    srv_hub_size(s, a, size[0]);
    srv_hub_size(s, b, size[1]);
    return size[0][0] == size[1][0] && size[0][1] == size[1][1];
}

static int quality_of(const struct srv_participant *p, bool final) {
    return final || p->quality < QUALITY_MOVING ? p->quality : QUALITY_MOVING;
}

/* Fills the job for `first` and everybody else of the session who wants the same picture. */
static void make_job(struct srv_hub *hub, struct srv_session *s, struct srv_participant *first,
                     const struct wish *wish, double now_ms, struct srv_job *job) {
    job->session = s->number;
    job->version = s->version;
    job->order = ++hub->next_order;
    job->final = wish->want == WANT_FINAL;
    job->coarse = 0;
    job->refinement = wish->refinement;
    job->view = s->view;
    srv_hub_size(s, first, job->view.size);
    job->volume = hub->options.volumes.ref(hub->options.volumes.user, s->volume);
    job->target_count = 0;
    int max_fps = 1;
    for (struct srv_participant *p = s->participants; p; p = p->next) {
        struct wish other = wish_of(hub, s, p, now_ms);
        if (other.want != wish->want || !same_picture(s, first, p))
            continue;
        bool png = job->final && p->lossless;
        job->targets[job->target_count++] =
            (struct srv_target){ .participant = p->id,
                                 .seq = p->seq,
                                 .format = png ? SP_IMAGE_PNG : p->format,
                                 .quality = quality_of(p, job->final) };
        p->pipeline++;
        p->taken_version = s->version;
        p->taken_final = job->final;
        /* Keep to the grid of the rate instead of adding our own delay to every frame. */
        double period = 1000.0 / p->max_fps;
        p->next_frame_ms = fmax(p->next_frame_ms + period, now_ms + period / 2);
        if (p->max_fps > max_fps)
            max_fps = p->max_fps;
    }
    assert(job->target_count > 0);
    if (!job->final)
        job->coarse = srv_pace_level(s->pace, job->view.size, 1000.0 / max_fps, job->view.size);
    double since = now_ms - s->served_ms;
    if (since < 1000)
        s->frame_ms = s->frame_ms == 0 ? since : s->frame_ms + (since - s->frame_ms) / 4;
    s->served_ms = now_ms;
}

bool srv_hub_next_job(struct srv_hub *hub, double now_ms, struct srv_job *job, double *wait_ms) {
    struct srv_session *best_session = NULL;
    struct srv_participant *best = NULL;
    struct wish best_wish = { .want = WANT_NOTHING };
    *wait_ms = 1000;
    pthread_mutex_lock(&hub->mutex);
    for (struct srv_session *s = hub->sessions; s; s = s->next) {
        for (struct srv_participant *p = s->participants; p; p = p->next) {
            struct wish wish = wish_of(hub, s, p, now_ms);
            *wait_ms = fmin(*wait_ms, wish.in_ms);
            if (wish.want == WANT_NOTHING)
                continue;
            bool better =
                !best || best_wish.refinement > wish.refinement ||
                (best_wish.refinement == wish.refinement && s->served_ms < best_session->served_ms);
            if (better) {
                best_session = s;
                best = p;
                best_wish = wish;
            }
        }
    }
    if (best)
        make_job(hub, best_session, best, &best_wish, now_ms, job);
    pthread_mutex_unlock(&hub->mutex);
    return best != NULL;
}

static struct srv_session *session_of(struct srv_hub *hub, const struct srv_job *job) {
    for (struct srv_session *s = hub->sessions; s; s = s->next)
        if (s->number == job->session)
            return s;
    return NULL;
}

bool srv_hub_is_newest(struct srv_hub *hub, const struct srv_job *job) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *s = session_of(hub, job);
    bool newest = s && s->version == job->version;
    pthread_mutex_unlock(&hub->mutex);
    return newest;
}

static struct srv_participant *participant_of(struct srv_session *s, uint64_t id) {
    for (struct srv_participant *p = s ? s->participants : NULL; p; p = p->next)
        if (p->id == id)
            return p;
    return NULL;
}

void srv_hub_deliver(struct srv_hub *hub, const struct srv_job *job, uint32_t i,
                     const struct proto_frame_header *header, struct srv_blob *blob) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_participant *p = participant_of(session_of(hub, job), job->targets[i].participant);
    if (p) {
        struct proto_frame_header full = *header;
        full.flags |= PROTO_FRAME_KEY | (job->final ? PROTO_FRAME_FINAL : 0);
        full.seq = job->targets[i].seq;
        full.payload_bytes = (uint32_t)blob->size;
        if (srv_outbox_put(&p->outbox, job->order, &full, blob))
            srv_hub_note(hub, p, 0);
    }
    pthread_mutex_unlock(&hub->mutex);
}

/* The job no longer counts for its participants; returns its session if that still exists. Call
 * with the mutex held. */
static struct srv_session *end_job(struct srv_hub *hub, struct srv_job *job) {
    struct srv_session *s = session_of(hub, job);
    for (uint32_t i = 0; i < job->target_count; i++) {
        struct srv_participant *p = participant_of(s, job->targets[i].participant);
        if (p)
            p->pipeline--;
    }
    hub->options.volumes.release(hub->options.volumes.user, job->volume);
    job->volume = NULL;
    hub->options.work(hub->options.user);
    return s;
}

void srv_hub_job_done(struct srv_hub *hub, struct srv_job *job,
                      const struct srv_job_result *result) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *s = end_job(hub, job);
    if (s) {
        s->last = *result;
        srv_pace_drawn(s->pace, job->coarse);
        if (job->final)
            srv_pace_rest(s->pace);
        /* What is at rest is told once more; the numbers of a moving view follow in time. */
        for (uint32_t i = 0; job->final && i < job->target_count; i++) {
            struct srv_participant *p = participant_of(s, job->targets[i].participant);
            if (p)
                srv_hub_note(hub, p, SRV_NOTE_STATS);
        }
        srv_pace_add(&s->pace[job->coarse], (double)result->width * result->height,
                     fmax(result->render_ms - result->once_ms, 0) + result->encode_ms);
    }
    pthread_mutex_unlock(&hub->mutex);
}

void srv_hub_job_failed(struct srv_hub *hub, struct srv_job *job, const struct sp_error *err) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *s = end_job(hub, job);
    for (uint32_t i = 0; i < job->target_count; i++) {
        struct srv_participant *p = participant_of(s, job->targets[i].participant);
        if (p) {
            p->failed_version = job->version;
            p->error = *err;
            srv_hub_note(hub, p, SRV_NOTE_ERROR);
        }
    }
    pthread_mutex_unlock(&hub->mutex);
}

void srv_hub_job_cancelled(struct srv_hub *hub, struct srv_job *job) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *s = end_job(hub, job);
    for (uint32_t i = 0; i < job->target_count; i++) {
        struct srv_participant *p = participant_of(s, job->targets[i].participant);
        if (p && p->taken_version == job->version)
            p->taken_final = false;
    }
    pthread_mutex_unlock(&hub->mutex);
}
