/* SPDX-License-Identifier: Apache-2.0
 *
 * Creates and destroys the scheduler, and handles the events of sessions.
 */
#include "schedule/schedule.h"

#include <math.h>
#include <stdlib.h>

#include "schedule/state.h"

#define PAUSE_MS 500.0 /* between two motions */
#define GAP_FADE 0.9   /* of the longest gap with each change */

static void interrupt(const struct srv_schedule *schedule, uint64_t of, enum srv_interrupt why) {
    schedule->options.interrupt(schedule->options.user, of, why);
}

void srv_schedule_wake(struct srv_schedule *schedule, struct srv_session *session) {
    if (session && !session->schedule->is_busy) {
        session->schedule->is_busy = true;
        session->schedule->next_busy = schedule->busy;
        schedule->busy = session;
    }
    if (schedule->cancellable > 0 && srv_has_motion(schedule))
        interrupt(schedule, 0, SRV_INTERRUPT_MOTION);
    schedule->options.wake(schedule->options.user);
}

void srv_schedule_rest(struct srv_schedule *schedule, struct srv_session *session) {
    struct srv_session **link = &schedule->busy;
    if (!session->schedule->is_busy)
        return;
    while (*link != session)
        link = &(*link)->schedule->next_busy;
    *link = session->schedule->next_busy;
    session->schedule->is_busy = false;
    session->schedule->wants_frame = false;
    schedule->rested_ms = fmax(schedule->rested_ms, session->schedule->account.end_ms);
}

/* The frame times of another session's view of the same volume are a first guess. */
static void init_quality(const struct srv_schedule *schedule, struct srv_session *session) {
    struct srv_quality *quality = &session->schedule->quality;
    srv_quality_init(quality);
    for (unsigned i = 0; i < SRV_QUALITIES; i++)
        if (schedule->qualities[i].volume == session->shared.volume)
            srv_quality_init_from(quality, &schedule->qualities[i].quality);
}

/* Notes the time since the last change. A pause ends the motion and says nothing about it. */
static void note_gap(struct srv_session_schedule *plan, double now_ms) {
    const double gap_ms = now_ms - plan->changed_ms;
    plan->gap_ms = gap_ms < PAUSE_MS ? fmax(gap_ms, plan->gap_ms * GAP_FADE) : 0;
    plan->changed_ms = now_ms;
}

/* The version is the new one. */
static void change_view(struct srv_schedule *schedule, struct srv_session *session,
                        enum srv_session_event event, double now_ms) {
    struct srv_session_schedule *plan = session->schedule;
    const uint64_t version = session->shared.version;
    if (event != SRV_VIEW_CHANGED)
        plan->start.cold = version;
    srv_motion_update(&plan->motion, &session->shared.view.camera, now_ms);
    note_gap(plan, now_ms);
    srv_past_add(&plan->past, &session->shared.view.camera, now_ms);
    if (event == SRV_VOLUME_CHANGED) {
        plan->motion.moved_ms = 0; /* the camera jumped */
        srv_past_clear(&plan->past);
        plan->start.volume = version;
        init_quality(schedule, session);
    }
    for (struct srv_participant *p = session->participants; p; p = p->next)
        if (p->schedule->newest.version == version - 1)
            p->schedule->behind_ms = now_ms;
    /* Nothing of another volume's frame is of use to the next frame. */
    bool is_useless = event == SRV_VOLUME_CHANGED && !plan->must_finish;
    interrupt(schedule, session->identity.number,
              is_useless ? SRV_INTERRUPT_UNWANTED : SRV_INTERRUPT_NEWER_VIEW);
}

/* The new version gives the same image: frames of the version before it are frames of this one.
 */
static void keep_image(struct srv_session *session) {
    const uint64_t version = session->shared.version;
    for (struct srv_participant *p = session->participants; p; p = p->next) {
        struct srv_participant_schedule *plan = p->schedule;
        if (plan->newest.version == version - 1)
            plan->newest.version = version;
        if (plan->failed_version == version - 1)
            plan->failed_version = version;
    }
}

/* The last frame of the participant is not what it asks for now. */
static void change_image(const struct srv_schedule *schedule, struct srv_participant *p,
                         double now_ms) {
    p->schedule->newest.version = p->schedule->failed_version = 0;
    p->schedule->behind_ms = now_ms;
    interrupt(schedule, p->identity.id, SRV_INTERRUPT_NEWER_REQUEST);
}

/* Names of owners are compared for each pair of busy sessions, so a number stands for each (FNV-1a;
 * owners with equal numbers would share what one gets). */
static uint64_t hash(const char *name) {
    uint64_t hash = UINT64_C(0xcbf29ce484222325);
    for (; *name; name++)
        hash = (hash ^ (unsigned char)*name) * UINT64_C(0x100000001b3);
    return hash;
}

static void on_event(void *user, enum srv_session_event event, struct srv_session *session,
                     struct srv_participant *p, double now_ms) {
    struct srv_schedule *schedule = user;
    schedule->now_ms = now_ms;
    switch (event) {
    case SRV_SESSION_STARTED:
        session->schedule->owner = hash(session->identity.owner.name);
        session->schedule->start.cold = session->shared.version;
        srv_motion_update(&session->schedule->motion, &session->shared.view.camera, now_ms);
        init_quality(schedule, session);
        return;
    case SRV_SESSION_ENDED:
        srv_schedule_rest(schedule, session);
        interrupt(schedule, session->identity.number, SRV_INTERRUPT_UNWANTED);
        return;
    case SRV_SESSION_EMPTIED:
        interrupt(schedule, session->identity.number, SRV_INTERRUPT_UNWANTED);
        return;
    case SRV_IMAGE_CHANGED:
        change_image(schedule, p, now_ms);
        return;
    case SRV_SLICES_CHANGED:
        keep_image(session);
        break;
    case SRV_VIEW_CHANGED:
    case SRV_TRANSFER_FUNCTION_CHANGED:
    case SRV_VOLUME_CHANGED:
        change_view(schedule, session, event, now_ms);
        break;
    case SRV_PARTICIPANT_JOINED:
        p->schedule->behind_ms = now_ms;
        break;
    case SRV_CONFIGURED:
        p->schedule->next_frame_ms =
            fmin(p->schedule->next_frame_ms, now_ms + 1000.0 / p->settings.max_fps);
        break;
    case SRV_CONGESTION_CHANGED:
        break;
    }
    srv_schedule_wake(schedule, session);
}

struct srv_schedule *srv_schedule_create(struct srv_hub *hub,
                                         const struct srv_schedule_options *options,
                                         struct sp_error *err) {
    const unsigned sessions_max = hub->options.sessions_max;
    struct srv_schedule *schedule = calloc(1, sizeof *schedule);
    bool ok = schedule &&
              (schedule->candidates = calloc(sessions_max, sizeof *schedule->candidates)) &&
              (schedule->choices = calloc(sessions_max, sizeof *schedule->choices));
    if (!ok) {
        srv_schedule_destroy(&schedule);
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the scheduler");
        return NULL;
    }
    schedule->hub = hub;
    schedule->options = *options;
    const struct srv_session_observer observer = { .user = schedule,
                                                   .session_bytes =
                                                       sizeof(struct srv_session_schedule),
                                                   .participant_bytes =
                                                       sizeof(struct srv_participant_schedule),
                                                   .event = on_event };
    srv_hub_observe(hub, &observer);
    return schedule;
}

void srv_schedule_destroy(struct srv_schedule **schedule_pointer) {
    struct srv_schedule *schedule = *schedule_pointer;
    *schedule_pointer = NULL;
    if (!schedule)
        return;
    free(schedule->candidates);
    free(schedule->choices);
    free(schedule);
}

struct srv_hub *srv_schedule_hub(const struct srv_schedule *schedule) {
    return schedule->hub;
}
