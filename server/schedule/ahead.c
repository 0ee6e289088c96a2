/* SPDX-License-Identifier: Apache-2.0
 *
 * Which moving frames are drawn ahead of the hand, by how much, and when they are given up.
 */
#include <math.h>

#include "schedule/state.h"

#define LATE_MS 20.0 /* after the last update: more than the time between two of them */

/* Means and sums have no depth by which the client could warp the frame. */
static bool shows_depth(const struct srv_session *s) {
    const enum sp_compositing mode = s->shared.view.compositing.mode;
    return s->schedule->has_depth && mode != SP_COMPOSITE_MEAN && mode != SP_COMPOSITE_SUM;
}

/* True if the participant shows each frame as the hand's camera sees it. */
static bool warps_to_hand(const struct srv_participant *p) {
    const struct srv_session *s = p->session;
    return p == s->holder && p->settings.depth && shows_depth(s) && !srv_play_is_on(s);
}

/* Expected time of a sharp frame; INFINITY = not known. */
static double sharp_ms(const struct srv_participant *p) {
    struct srv_detail sharp = { .mip_level = 0 };
    srv_hub_size(p->session, p, sharp.size);
    const double ms = srv_quality_expected_ms(&p->session->schedule->quality, &sharp);
    return ms > 0 ? ms : INFINITY;
}

bool srv_skips_intermediate(const struct srv_schedule *schedule, const struct srv_participant *p) {
    return schedule->hub->options.rest_ms <= SRV_SETTLED_SHARP_MS && warps_to_hand(p) &&
           sharp_ms(p) <= SRV_SETTLED_SHARP_MS;
}

double srv_predict_job(const struct srv_schedule *schedule, const struct srv_participant *only,
                       struct srv_render_job *job, double now_ms) {
    const struct srv_session *s = only->session;
    const double delay_ms = srv_display_delay_ms(&only->delivery.display_delay);
    if (job->step != SRV_STEP_MOVING || !warps_to_hand(only) || !(delay_ms > 0) ||
        s->shared.is_waiting || now_ms >= srv_settles_at_ms(schedule, s))
        return 0;
    /* In the mean, a frame is displayed half an interval later than when it appears. */
    const double ahead_ms = fmin(delay_ms + s->stats.interval_ms / 2, only->settings.predict_ms);
    return srv_predict(&s->schedule->past, now_ms, ahead_ms, &job->view.camera)
               ? srv_motion_between(&s->shared.view.camera, &job->view.camera)
               : 0;
}

bool srv_ends_with_motion(const struct srv_schedule *schedule, const struct srv_participant *only,
                          const struct srv_render_job *job, double now_ms) {
    const struct srv_session *s = only->session;
    const struct srv_session_schedule *plan = s->schedule;
    const bool is_late = now_ms - s->shared.changed_ms > LATE_MS && plan->gap_ms > 0 &&
                         srv_skips_intermediate(schedule, only);
    return job->step == SRV_STEP_MOVING && (job->ahead > SRV_FAR_AHEAD || is_late) &&
           !plan->has_stopped && !plan->must_finish && plan->start.done >= plan->start.cold;
}

double srv_schedule_stops_in_ms(struct srv_schedule *schedule, const struct srv_running_job *job,
                                double now_ms) {
    double in_ms = INFINITY;
    pthread_mutex_lock(&schedule->hub->mutex);
    for (const struct srv_session *s = schedule->busy; s; s = s->schedule->next_busy)
        if (s->identity.number == job->session && s->shared.image == job->image)
            in_ms = srv_settles_at_ms(schedule, s) - now_ms;
    pthread_mutex_unlock(&schedule->hub->mutex);
    return in_ms;
}

bool srv_has_stopped(const struct srv_session *s, const struct srv_render_job *job) {
    return s && job->ends_with_motion && s->shared.image == job->image;
}
