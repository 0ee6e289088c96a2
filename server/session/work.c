/* SPDX-License-Identifier: Apache-2.0
 *
 * The jobs: what is made of a wish (turn.c), and where the picture goes.
 *
 * A newer view gives up a refinement at once. A moving frame is finished, so that a long drag
 * always shows something, unless it takes more than twice its budget: then the next one, which is
 * drawn with less detail, is there sooner. Of two moving frames in a row one is always finished;
 * and one that does what the next one would have to do as well (work that is done once, or there is
 * no less detail) is finished, too.
 */
#include <assert.h>
#include <math.h>
#include <string.h>

#include "session/hub_private.h"
#include "session/policy.h"

enum { PAUSE_SLOTS = 2 }; /* without a frame: slots begin anew */
#define ROUNDING 1e-6     /* of a time that is the beginning of a slot, in slots */

static struct srv_detail detail_of(const struct srv_render_job *job) {
    return (struct srv_detail){ .mip_level = job->mip_level,
                                .size = { job->view.size[0], job->view.size[1] } };
}

static bool same_picture(const struct srv_session *s, const struct srv_participant *a,
                         const struct srv_participant *b) {
    uint32_t size[2][2];
    srv_hub_size(s, a, size[0]);
    srv_hub_size(s, b, size[1]);
    return size[0][0] == size[1][0] && size[0][1] == size[1][1];
}

/* Sessions that get moving frames just now, with this one. Who asks for them and does not take them
 * is none. */
static unsigned moving_sessions(const struct srv_hub *hub, const struct srv_session *this,
                                double now_ms) {
    unsigned count = 0;
    for (const struct srv_session *s = hub->busy; s; s = s->next_busy)
        count += s == this || (s->moved_ms > 0 && now_ms - s->moved_ms < SRV_MOVING_MS);
    return count;
}

/* Those who move share the time of a frame: each has less detail instead of fewer frames. */
static double budget_ms(const struct srv_hub *hub, const struct srv_session *s, int max_fps,
                        double now_ms) {
    return srv_quality_budget_ms(max_fps) / moving_sessions(hub, s, now_ms);
}

double srv_hub_moving_ms(const struct srv_hub *hub, const struct srv_session *s,
                         const struct srv_participant *p, double now_ms) {
    uint32_t full[2];
    srv_hub_size(s, p, full);
    return srv_quality_moving_ms(&s->pace, full, budget_ms(hub, s, p->max_fps, now_ms));
}

/* Detail for the job; its view has the full size and gets the one to render. */
static void choose_detail(const struct srv_hub *hub, struct srv_session *s,
                          struct srv_render_job *job, const struct srv_participant *first,
                          int max_fps, double now_ms) {
    uint32_t full[2] = { job->view.size[0], job->view.size[1] };
    struct srv_detail detail = { .mip_level = 0, .size = { full[0], full[1] } };
    job->budget_ms = budget_ms(hub, s, max_fps, now_ms);
    if (job->step == SRV_STEP_MOVING)
        srv_quality_moving(&s->pace, full, job->budget_ms, &detail);
    else if (job->step == SRV_STEP_INTERMEDIATE)
        srv_quality_intermediate(&s->pace, full, &first->taken_detail, &detail);
    job->mip_level = detail.mip_level;
    memcpy(job->view.size, detail.size, sizeof detail.size);
    job->is_sharp = detail.mip_level == 0 && detail.size[0] == full[0] && detail.size[1] == full[1];
}

static double cancellable_from_ms(const struct srv_session *s, const struct srv_render_job *job,
                                  double now_ms) {
    bool cold = s->done_version < s->cold_version;
    if (job->is_refinement)
        return 0;
    if (job->step != SRV_STEP_MOVING || cold || s->must_finish ||
        job->mip_level == SP_MIP_LEVEL_MAX)
        return INFINITY;
    return now_ms + 2 * job->budget_ms;
}

static struct srv_render_target target_of(const struct srv_participant *p,
                                          const struct srv_render_job *job) {
    struct srv_encoding e = srv_policy_encoding(p, job->step);
    return (struct srv_render_target){ .participant = p->id,
                                       .seq = p->seq,
                                       .format = e.format,
                                       .video = e.video,
                                       .quality = e.quality,
                                       .chroma = e.chroma,
                                       .final = job->step == SRV_STEP_FINAL ||
                                                (job->is_sharp && srv_policy_is_final(p, &e)) };
}

/* When the next frame is due after one at now_ms. For each rate time is cut into slots, the same
 * for all of a session, and each has one frame: who looks on together asks together, whenever it
 * joined, and our own delay is not added to every frame. The first frame after a pause is in the
 * middle of its slot: whose changes come as often as frames are due does not wait with any of them.
 */
static double next_due_ms(const struct srv_session *s, int max_fps, double now_ms) {
    double slot_ms = 1000.0 / max_fps;
    double at = (now_ms - s->slots_ms) / slot_ms + ROUNDING;
    return s->slots_ms + (floor(at) + 1) * slot_ms;
}

static void take_job(struct srv_hub *hub, struct srv_session *s, struct srv_participant *p,
                     struct srv_render_job *job, double now_ms) {
    struct srv_render_target target = target_of(p, job);
    job->targets[job->target_count++] = target;
    p->pipeline++;
    p->taken_version = s->version;
    p->taken_step = target.final ? SRV_STEP_FINAL : job->step;
    p->taken_detail = detail_of(job);
    p->taken_order = job->order;
    srv_policy_taken(hub, p, job, now_ms);
    p->ready_ms = 0;
    if (job->step == SRV_STEP_MOVING)
        p->waited_ms = p->spent_ms = 0;
    p->next_frame_ms = next_due_ms(s, p->max_fps, now_ms);
}

static struct srv_participant *participant_of(struct srv_session *s, uint64_t id) {
    for (struct srv_participant *p = s ? s->participants : NULL; p; p = p->next)
        if (p->id == id)
            return p;
    return NULL;
}

/* Who holds control counts for all others together. */
static double weight_of(const struct srv_session *s, const struct srv_participant *p) {
    return p == s->holder && s->participant_count > 1 ? s->participant_count - 1 : 1;
}

/* The session, and each of its participants who gets the picture, gets what it is expected to take.
 */
static void take_share(struct srv_hub *hub, struct srv_session *s, struct srv_render_job *job) {
    const struct srv_detail detail = detail_of(job);
    bool is_known = s->done_version >= s->cold_version;
    job->charged_ms = srv_quality_expected_ms(&s->pace, &detail);
    job->expected_ms = is_known && job->charged_ms > 0 ? job->charged_ms : INFINITY;
    job->start_ms = srv_fair_start(&s->share, hub->clock_ms);
    job->part_start_ms = s->clock_ms;
    srv_fair_charge(&s->share, hub->clock_ms, job->charged_ms);
    for (uint32_t i = 0; i < job->target_count; i++) {
        struct srv_participant *p = participant_of(s, job->targets[i].participant);
        srv_fair_charge(&p->share, s->clock_ms, job->charged_ms / weight_of(s, p));
    }
}

static void correct_share(struct srv_session *s, struct srv_render_job *job, double took_ms) {
    srv_fair_correct(&s->share, took_ms - job->charged_ms);
    for (uint32_t i = 0; i < job->target_count; i++) {
        struct srv_participant *p = participant_of(s, job->targets[i].participant);
        if (p)
            srv_fair_correct(&p->share, (took_ms - job->charged_ms) / weight_of(s, p));
    }
    job->charged_ms = took_ms;
}

/* Fills the job for `first` and everybody else of the session who wants the same picture. */
static void make_job(struct srv_hub *hub, struct srv_session *s, struct srv_participant *first,
                     const struct srv_frame_request *wish, double now_ms,
                     struct srv_render_job *job) {
    struct srv_participant *takers[SRV_PARTICIPANTS_MAX];
    uint32_t count = 0;
    int max_fps = 1;
    for (struct srv_participant *p = s->participants; p; p = p->next) {
        struct srv_frame_request other = srv_turn_wish(hub, s, p, now_ms);
        if (!other.wanted || other.step != wish->step ||
            other.is_slow_to_encode != wish->is_slow_to_encode || !same_picture(s, first, p))
            continue;
        takers[count++] = p;
        max_fps = p->max_fps > max_fps ? p->max_fps : max_fps;
    }
    assert(count > 0);
    job->session = s->number;
    job->version = s->version;
    job->order = ++hub->next_order;
    job->step = wish->step;
    job->is_refinement = wish->is_refinement;
    job->protected_ms = wish->protected_ms;
    job->is_alone = hub->participant_count == 1;
    job->is_slow_to_encode = wish->is_slow_to_encode;
    job->view = s->view;
    srv_hub_size(s, first, job->full);
    memcpy(job->view.size, job->full, sizeof job->full);
    job->volume = hub->options.volumes.ref(hub->options.volumes.user, s->volume);
    job->target_count = 0;
    choose_detail(hub, s, job, first, max_fps, now_ms);
    job->cancellable_from_ms = cancellable_from_ms(s, job, now_ms);
    if (now_ms - s->taken_ms > PAUSE_SLOTS * 1000.0 / max_fps)
        s->slots_ms = now_ms - 500.0 / max_fps;
    for (uint32_t i = 0; i < count; i++)
        take_job(hub, s, takers[i], job, now_ms);
    s->taken_order = job->order;
    s->taken_ms = now_ms;
    s->clock_ms = srv_fair_start(&first->share, s->clock_ms);
    take_share(hub, s, job);
    s->jobs++;
    s->dear += job->is_slow_to_encode;
    hub->dear += job->is_slow_to_encode;
    hub->giving_way += job->protected_ms < INFINITY;
    if (job->step == SRV_STEP_MOVING) {
        s->moved_ms = now_ms;
        srv_metrics_time(hub->options.metrics, SRV_TIME_QUEUE, now_ms - s->changed_ms);
    }
    double since = now_ms - s->served_ms;
    if (since < 1000)
        s->frame_ms = s->frame_ms == 0 ? since : s->frame_ms + (since - s->frame_ms) / 4;
    s->served_ms = now_ms;
}

bool srv_schedule_next(struct srv_hub *hub, double now_ms, struct srv_render_job *job,
                       double *wait_ms) {
    struct srv_frame_request wish;
    *wait_ms = 1000;
    pthread_mutex_lock(&hub->mutex);
    struct srv_participant *next = srv_turn_next(hub, now_ms, &wish, wait_ms);
    if (next)
        make_job(hub, next->session, next, &wish, now_ms, job);
    pthread_mutex_unlock(&hub->mutex);
    return next != NULL;
}

/* It is busy while a job of it is under way. */
static struct srv_session *session_of(struct srv_hub *hub, const struct srv_render_job *job) {
    for (struct srv_session *s = hub->busy; s; s = s->next_busy)
        if (s->number == job->session)
            return s;
    return NULL;
}

bool srv_schedule_next_short(struct srv_hub *hub, const struct srv_running_job *running,
                             double now_ms, struct srv_render_job *job, double *wait_ms) {
    struct srv_frame_request wish;
    *wait_ms = 1000;
    pthread_mutex_lock(&hub->mutex);
    struct srv_participant *next = srv_turn_before(hub, running, now_ms, &wish, wait_ms);
    if (next)
        make_job(hub, next->session, next, &wish, now_ms, job);
    pthread_mutex_unlock(&hub->mutex);
    return next != NULL;
}

bool srv_schedule_is_newest(struct srv_hub *hub, const struct srv_render_job *job) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *s = session_of(hub, job);
    bool newest = s && s->version == job->version;
    pthread_mutex_unlock(&hub->mutex);
    return newest;
}

bool srv_schedule_has_motion(struct srv_hub *hub) {
    pthread_mutex_lock(&hub->mutex);
    bool moves = srv_turn_moves(hub);
    pthread_mutex_unlock(&hub->mutex);
    return moves;
}

static bool put(struct srv_hub *hub, struct srv_participant *p, const struct srv_render_job *job,
                const struct srv_render_target *target, const struct proto_frame_header *header,
                struct srv_blob *blob) {
    struct proto_frame_header full = *header;
    full.flags |= target->final ? PROTO_FRAME_FINAL : 0;
    full.seq = target->seq;
    full.payload_bytes = (uint32_t)blob->size;
    bool replaces = p->outbox.blob != NULL;
    bool is_put = srv_outbox_put(&p->outbox, job->order, &full, blob);
    if (is_put)
        srv_hub_notify(hub, p, 0);
    if (!is_put || replaces)
        srv_hub_count_drop(hub, is_put ? SRV_COUNT_DROP_REPLACED : SRV_COUNT_DROP_LATE);
    return is_put;
}

void srv_schedule_deliver(struct srv_hub *hub, const struct srv_render_job *job, uint32_t i,
                          const struct proto_frame_header *header, struct srv_blob *blob) {
    struct proto_frame_header still = *header;
    still.flags |= PROTO_FRAME_KEY;
    pthread_mutex_lock(&hub->mutex);
    struct srv_participant *p = participant_of(session_of(hub, job), job->targets[i].participant);
    if (p) {
        bool holds_video = p->outbox.blob && proto_codec_is_video(p->outbox.header.codec);
        if (put(hub, p, job, &job->targets[i], &still, blob) && holds_video)
            p->mark.epoch = 0; /* that one never arrives */
    } else {
        srv_hub_count_drop(hub, SRV_COUNT_DROP_LEFT);
    }
    pthread_mutex_unlock(&hub->mutex);
}

/* With the mutex held. */
static void set_refused(struct srv_hub *hub, struct srv_participant *p, bool refused) {
    if (p->video_refused != refused)
        srv_hub_notify(hub, p, SRV_NOTIFY_POLICY);
    p->video_refused = refused;
}

void srv_schedule_refuse_video(struct srv_hub *hub, const struct srv_render_job *job,
                               uint64_t set) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *s = session_of(hub, job);
    for (uint32_t i = 0; i < job->target_count; i++) {
        struct srv_participant *p = participant_of(s, job->targets[i].participant);
        if (p && set >> i & 1 && p->video == job->targets[i].video)
            set_refused(hub, p, true);
    }
    pthread_mutex_unlock(&hub->mutex);
}

static bool has_all(const struct srv_participant *p, const struct srv_video_mark *next) {
    return p->mark.epoch && p->mark.epoch == next->epoch && p->mark.number == next->number;
}

static bool is_target(const struct srv_render_job *job, const struct srv_participant *p) {
    for (uint32_t i = 0; i < job->target_count; i++)
        if (job->targets[i].participant == p->id)
            return true;
    return false;
}

bool srv_schedule_has_video(struct srv_hub *hub, const struct srv_render_job *job,
                            const struct srv_video_mark *next) {
    bool has = false;
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *s = session_of(hub, job);
    for (const struct srv_participant *p = s ? s->participants : NULL; p; p = p->next)
        has = has || (has_all(p, next) && !is_target(job, p));
    pthread_mutex_unlock(&hub->mutex);
    return has;
}

enum srv_video_need srv_schedule_video_need(struct srv_hub *hub, const struct srv_render_job *job,
                                            uint32_t i, const struct srv_video_mark *next) {
    enum srv_video_need claim = SRV_VIDEO_NONE;
    pthread_mutex_lock(&hub->mutex);
    struct srv_participant *p = participant_of(session_of(hub, job), job->targets[i].participant);
    if (!p)
        srv_hub_count_drop(hub, SRV_COUNT_DROP_LEFT);
    if (p && p->video == job->targets[i].video)
        set_refused(hub, p, false);
    if (p && p->outbox.blob && job->order > p->outbox.order) {
        if (p->taken_version == job->version)
            p->taken_version = 0;
    } else if (p && job->order > p->outbox.order) {
        claim = has_all(p, next) ? SRV_VIDEO_DELTA : SRV_VIDEO_KEY;
    }
    pthread_mutex_unlock(&hub->mutex);
    return claim;
}

void srv_schedule_deliver_video(struct srv_hub *hub, const struct srv_render_job *job, uint32_t i,
                                const struct proto_frame_header *header, struct srv_blob *blob,
                                const struct srv_video_mark *mark) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_participant *p = participant_of(session_of(hub, job), job->targets[i].participant);
    bool fits =
        p && !p->outbox.blob &&
        (mark->number == 0 || (p->mark.epoch == mark->epoch && p->mark.number == mark->number));
    if (fits && put(hub, p, job, &job->targets[i], header, blob))
        p->mark = (struct srv_video_mark){ mark->epoch, mark->number + 1 };
    else if (!p)
        srv_hub_count_drop(hub, SRV_COUNT_DROP_LEFT);
    pthread_mutex_unlock(&hub->mutex);
}

/* The job no longer counts for its participants; returns its session if that still exists. Call
 * with the mutex held. */
static struct srv_session *end_job(struct srv_hub *hub, struct srv_render_job *job) {
    struct srv_session *s = session_of(hub, job);
    for (uint32_t i = 0; i < job->target_count; i++) {
        struct srv_participant *p = participant_of(s, job->targets[i].participant);
        if (p)
            p->pipeline--;
    }
    hub->options.volumes.release(hub->options.volumes.user, job->volume);
    job->volume = NULL;
    hub->giving_way -= job->protected_ms < INFINITY;
    hub->dear -= job->is_slow_to_encode;
    if (s) {
        s->jobs--;
        s->dear -= job->is_slow_to_encode;
    }
    return s;
}

static struct srv_known_quality *pace_of(struct srv_hub *hub, const void *volume) {
    for (unsigned i = 0; i < SRV_QUALITIES; i++)
        if (hub->paces[i].volume == volume)
            return &hub->paces[i];
    struct srv_known_quality *oldest = &hub->paces[hub->next_pace++ % SRV_QUALITIES];
    oldest->volume = volume;
    return oldest;
}

static void note_pace(struct srv_hub *hub, struct srv_session *s, const struct srv_detail *drawn,
                      const struct srv_render_job *job, double took_ms) {
    bool moving = job->step == SRV_STEP_MOVING;
    srv_quality_done(&s->pace, drawn, moving, job->budget_ms, took_ms);
    pace_of(hub, s->volume)->pace = s->pace;
}

void srv_hub_first_pace(const struct srv_hub *hub, struct srv_session *s) {
    srv_quality_init(&s->pace);
    for (unsigned i = 0; i < SRV_QUALITIES; i++)
        if (hub->paces[i].volume == s->volume)
            srv_quality_init_from(&s->pace, &hub->paces[i].pace);
}

void srv_schedule_done(struct srv_hub *hub, struct srv_render_job *job,
                       const struct srv_render_result *result) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *s = end_job(hub, job);
    if (s) {
        struct srv_detail drawn = detail_of(job);
        bool moving = job->step == SRV_STEP_MOVING;
        double took_ms = fmax(result->render_ms - result->once_ms, 0) + result->encode_ms;
        s->last = *result;
        s->must_finish = s->must_finish && !moving;
        s->done_version = s->done_version > job->version ? s->done_version : job->version;
        if (!result->again && job->version >= s->volume_version)
            note_pace(hub, s, &drawn, job, took_ms);
        if (job->step == SRV_STEP_FINAL)
            srv_quality_rest(&s->pace, job->view.size);
        correct_share(s, job, (result->again ? 0 : result->render_ms) + result->encode_ms);
        /* What is at rest is told once more; the numbers of a moving view follow in time. */
        for (uint32_t i = 0; !moving && i < job->target_count; i++) {
            struct srv_participant *p = participant_of(s, job->targets[i].participant);
            if (p && job->step == SRV_STEP_FINAL)
                p->waited_ms = p->spent_ms = 0;
            if (p)
                srv_hub_notify(hub, p, SRV_NOTIFY_STATS);
        }
    }
    srv_hub_work(hub, s);
    pthread_mutex_unlock(&hub->mutex);
}

void srv_schedule_rendered(struct srv_hub *hub, struct srv_render_job *job, double render_ms) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *s = session_of(hub, job);
    if (s)
        correct_share(s, job, render_ms);
    pthread_mutex_unlock(&hub->mutex);
}

void srv_schedule_failed(struct srv_hub *hub, struct srv_render_job *job,
                         const struct sp_error *err) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *s = end_job(hub, job);
    srv_hub_count_drop(hub, SRV_COUNT_DROP_FAILED);
    for (uint32_t i = 0; i < job->target_count; i++) {
        struct srv_participant *p = participant_of(s, job->targets[i].participant);
        if (p) {
            p->failed_version = job->version;
            p->waited_ms = p->spent_ms = 0;
            p->error = *err;
            srv_hub_notify(hub, p, SRV_NOTIFY_ERROR);
        }
    }
    srv_hub_work(hub, s);
    pthread_mutex_unlock(&hub->mutex);
}

/* Have all left for whom it was made? */
static bool is_for_nobody(struct srv_session *s, const struct srv_render_job *job) {
    for (uint32_t i = 0; i < job->target_count; i++)
        if (participant_of(s, job->targets[i].participant))
            return false;
    return true;
}

void srv_schedule_cancelled(struct srv_hub *hub, struct srv_render_job *job, double elapsed_ms) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *s = end_job(hub, job);
    srv_hub_count_drop(hub, is_for_nobody(s, job) ? SRV_COUNT_DROP_LEFT : SRV_COUNT_DROP_OUTDATED);
    if (s && elapsed_ms > 0)
        correct_share(s, job, elapsed_ms);
    if (s && job->step == SRV_STEP_MOVING) {
        struct srv_detail drawn = detail_of(job);
        s->must_finish = true;
        if (job->version >= s->volume_version)
            srv_quality_cancelled(&s->pace, &drawn, elapsed_ms);
    }
    for (uint32_t i = 0; i < job->target_count; i++) {
        struct srv_participant *p = participant_of(s, job->targets[i].participant);
        if (!p || p->taken_version != job->version)
            continue;
        p->taken_step = SRV_STEP_MOVING;
        if (job->protected_ms < INFINITY)
            p->spent_ms = fmax(p->spent_ms, elapsed_ms);
        if (!job->is_refinement)
            p->taken_version = 0;
    }
    srv_hub_work(hub, s);
    pthread_mutex_unlock(&hub->mutex);
}
