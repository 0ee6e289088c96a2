/* SPDX-License-Identifier: Apache-2.0
 *
 * Which moving frames are drawn ahead of the hand, and by how much.
 */
#include <math.h>

#include "schedule/state.h"

/* Means and sums have no depth by which the client could warp the frame. */
static bool shows_depth(const struct srv_session *s) {
    const enum sp_compositing mode = s->shared.view.compositing.mode;
    return s->schedule->has_depth && mode != SP_COMPOSITE_MEAN && mode != SP_COMPOSITE_SUM;
}

double srv_predict_job(const struct srv_schedule *schedule, const struct srv_participant *only,
                       struct srv_render_job *job, double now_ms) {
    const struct srv_session *s = only->session;
    const double delay_ms = srv_display_delay_ms(&only->delivery.display_delay);
    if (job->step != SRV_STEP_MOVING || only != s->holder || !only->settings.depth ||
        !shows_depth(s) || srv_play_is_on(s) || !(delay_ms > 0) || s->shared.is_waiting ||
        now_ms >= srv_settles_at_ms(schedule, s))
        return 0;
    /* In the mean, a frame is displayed half an interval later than when it appears. */
    const double ahead_ms = fmin(delay_ms + s->stats.interval_ms / 2, only->settings.predict_ms);
    return srv_predict(&s->schedule->past, now_ms, ahead_ms, &job->view.camera)
               ? srv_motion_between(&s->shared.view.camera, &job->view.camera)
               : 0;
}
