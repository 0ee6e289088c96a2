/* SPDX-License-Identifier: Apache-2.0
 *
 * Carries decisions out: makes render jobs, charges accounts, and learns from what jobs took.
 *
 * A newer view cancels a refinement at once. A moving frame is finished, so that a long drag always
 * shows something, unless it takes more than twice its budget: then the next one, with less detail,
 * is ready sooner. Of two moving frames in a row at least one is finished. A frame is also finished
 * if the next one would have to do the same work: work that is done once, or a frame at the
 * coarsest level.
 */
#include <assert.h>
#include <math.h>
#include <string.h>

#include "schedule/state.h"

enum { FIRST_SHARE = 5 };  /* first frames have a fifth of the time at most */
enum { PLAY_BUDGETS = 3 }; /* a frame of a view that plays may take that many */

static struct srv_detail detail_of(const struct srv_render_job *job) {
    return (struct srv_detail){ .mip_level = job->mip_level,
                                .size = { job->view.size[0], job->view.size[1] },
                                .is_draft = job->is_draft };
}

/* NULL = it ended. */
static struct srv_session *find_session(const struct srv_schedule *schedule,
                                        const struct srv_render_job *job) {
    /* A session with a job in progress is busy. */
    for (struct srv_session *s = schedule->busy; s; s = s->schedule->next_busy)
        if (s->identity.number == job->session)
            return s;
    return NULL;
}

/* NULL = it left. */
static struct srv_participant *find_participant(struct srv_session *s, uint64_t id) {
    for (struct srv_participant *p = s ? s->participants : NULL; p; p = p->next)
        if (p->identity.id == id)
            return p;
    return NULL;
}

/* True if the job is the participant's newest one, and its frame is still what is asked for. Its
 * version does not tell: the view may have a newer one with the same image. */
static bool is_newest(const struct srv_participant *p, const struct srv_render_job *job) {
    return p->schedule->newest.order == job->order && p->schedule->newest.version != 0;
}

/* Do frames of this step have the same size for both participants? */
static bool has_same_size(const struct srv_session *s, const struct srv_participant *a,
                          const struct srv_participant *b, enum srv_frame_step step) {
    uint32_t size[2][2];
    srv_hub_size(s, a, size[0]);
    srv_hub_size(s, b, size[1]);
    return size[0][0] == size[1][0] && size[0][1] == size[1][1] &&
           (step != SRV_STEP_MOVING || srv_rate_control_step(&a->delivery.rate_control).side ==
                                           srv_rate_control_step(&b->delivery.rate_control).side);
}

/* Accounts. */

/* The participant that holds control counts as much as all others of its session together. So it
 * keeps half of the session's time, however many others there are. */
static double participant_weight(const struct srv_session *s, const struct srv_participant *p) {
    return p == s->holder && s->participant_count > 1 ? s->participant_count - 1 : 1;
}

double srv_participant_portion(const struct srv_session *s, const struct srv_participant *p) {
    const double all = s->holder ? 2 * (s->participant_count - 1.0) : s->participant_count;
    return participant_weight(s, p) / fmax(1, all);
}

/* Charges the expected time to the session and to each participant that gets the frame. */
static void charge(struct srv_schedule *schedule, struct srv_session *s,
                   struct srv_render_job *job) {
    struct srv_session_schedule *plan = s->schedule;
    const struct srv_detail detail = detail_of(job);
    bool is_known = plan->start.done >= plan->start.cold;
    job->charged_ms = srv_quality_expected_ms(&plan->quality, &detail);
    job->expected_ms = is_known && job->charged_ms > 0 ? job->charged_ms : INFINITY;
    job->start_ms = srv_fair_start(&plan->account, schedule->clock_ms);
    job->participant_start_ms = plan->clock_ms;
    job->price = srv_session_price(schedule, s);
    srv_fair_charge(&plan->account, schedule->clock_ms, job->charged_ms * job->price);
    srv_fair_add_use(&schedule->use, job->charged_ms, schedule->now_ms);
    for (uint32_t i = 0; i < job->target_count; i++) {
        struct srv_participant *p = find_participant(s, job->targets[i].participant);
        srv_fair_charge(&p->schedule->account, plan->clock_ms,
                        job->charged_ms / participant_weight(s, p));
        srv_fair_add_use(&p->schedule->use, job->charged_ms, schedule->now_ms);
    }
}

static void correct_charge(struct srv_schedule *schedule, struct srv_session *s,
                           struct srv_render_job *job, double took_ms) {
    srv_fair_correct(&s->schedule->account, (took_ms - job->charged_ms) * job->price);
    srv_fair_add_use(&schedule->use, took_ms - job->charged_ms, schedule->now_ms);
    for (uint32_t i = 0; i < job->target_count; i++) {
        struct srv_participant *p = find_participant(s, job->targets[i].participant);
        if (!p)
            continue;
        srv_fair_correct(&p->schedule->account,
                         (took_ms - job->charged_ms) / participant_weight(s, p));
        srv_fair_add_use(&p->schedule->use, took_ms - job->charged_ms, schedule->now_ms);
    }
    job->charged_ms = took_ms;
}

/* Making a job. */

/* True if the view shows points alone. */
static bool shows_points(const struct sp_view *view) {
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (view->layers[i].visible && view->layers[i].type != SP_LAYER_POINTS)
            return false;
    return true;
}

/* Chooses the detail. The job's view has the full size and gets the size to render. */
static void choose_detail(const struct srv_schedule *schedule, struct srv_session *s,
                          struct srv_render_job *job, const struct srv_participant *first,
                          int max_fps) {
    struct srv_quality *quality = &s->schedule->quality;
    const uint32_t *full = job->full;
    quality->prefers_levels = shows_points(&s->shared.view);
    struct srv_detail detail = { .mip_level = 0, .size = { full[0], full[1] } };
    struct srv_quality_budget budget = srv_moving_budget(schedule, first, max_fps);
    if (srv_play_moves(s)) { /* small images lose the streaks */
        budget.ms *= PLAY_BUDGETS;
        budget.most_ms *= PLAY_BUDGETS;
    }
    job->part = budget.part;
    job->budget_ms = budget.ms;
    if (job->step == SRV_STEP_MOVING) {
        uint32_t most[2];
        job->budget_ms = srv_quality_moving(quality, full, &budget, &detail);
        srv_rate_control_size(&first->delivery.rate_control, full, most);
        for (int i = 0; i < 2; i++) {
            detail.is_draft = detail.is_draft || most[i] < detail.size[i];
            detail.size[i] = detail.size[i] < most[i] ? detail.size[i] : most[i];
        }
    } else if (job->step == SRV_STEP_INTERMEDIATE)
        srv_intermediate(s, first, &detail);
    job->mip_level = detail.mip_level;
    job->is_draft = detail.is_draft;
    memcpy(job->view.size, detail.size, sizeof detail.size);
    job->is_sharp = detail.mip_level == 0 && !detail.is_draft && detail.size[0] == full[0] &&
                    detail.size[1] == full[1] && !s->shared.is_waiting;
}

static double cancellable_from_ms(const struct srv_session *s, const struct srv_render_job *job,
                                  double now_ms) {
    bool is_cold = s->schedule->start.done < s->schedule->start.cold;
    if (job->is_refinement)
        return 0;
    if (job->step != SRV_STEP_MOVING || is_cold || s->schedule->must_finish ||
        job->mip_level == SP_MIP_LEVEL_MAX)
        return INFINITY;
    return now_ms + 2 * job->budget_ms;
}

static struct srv_frame_target target_of(const struct srv_participant *p,
                                         const struct srv_render_job *job) {
    struct srv_encoding e = srv_policy_encoding(p, job->step);
    const char *owner = p->session->identity.owner.name;
    return (struct srv_frame_target){ .participant = p->identity.id,
                                      .is_guest = strcmp(p->identity.token, owner) != 0,
                                      .seq = p->delivery.seq,
                                      .updated_ms = p->delivery.updated_ms,
                                      .format = e.format,
                                      .video = e.video,
                                      .quality = e.quality,
                                      .chroma = e.chroma,
                                      .depth = p->settings.depth,
                                      .final = job->step == SRV_STEP_FINAL ||
                                               (job->is_sharp && job->ahead == 0 &&
                                                srv_policy_is_final(p, &e)) };
}

static struct srv_moving_detail moving_detail_of(const struct srv_session *s,
                                                 const struct srv_participant *p,
                                                 const struct srv_render_job *job) {
    const struct srv_detail sharp = { .size = { job->full[0], job->full[1] } };
    return (struct srv_moving_detail){
        .full_size = { job->full[0], job->full[1] },
        .size = { job->view.size[0], job->view.size[1] },
        .mip_level = job->mip_level,
        .is_draft = job->is_draft && !s->schedule->quality.ignores_drafts,
        .budget_ms = job->budget_ms,
        .sharp_ms = srv_quality_expected_ms(&s->schedule->quality, &sharp),
        .is_shared = job->part < 0.99,
        .rate_step = p->delivery.rate_control.step,
        .is_video = p->delivery.rate_control.is_video,
    };
}

static void add_target(struct srv_schedule *schedule, struct srv_session *s,
                       struct srv_participant *p, struct srv_render_job *job, double now_ms) {
    struct srv_participant_schedule *plan = p->schedule;
    const struct srv_frame_target target = target_of(p, job);
    job->targets[job->target_count++] = target;
    plan->jobs++;
    plan->newest = (struct srv_newest_job){ .order = job->order,
                                            .version = s->shared.version,
                                            .step = target.final ? SRV_STEP_FINAL : job->step,
                                            .detail = detail_of(job),
                                            .is_ahead = job->ahead > SRV_FAR_AHEAD };
    const struct srv_moving_detail moving = moving_detail_of(s, p, job);
    srv_policy_update(schedule->hub, p, job->step == SRV_STEP_MOVING ? &moving : NULL, now_ms);
    plan->waiting.ready_ms = 0;
    if (job->step == SRV_STEP_MOVING)
        plan->waiting.waited_ms = plan->waiting.spent_ms = 0;
    plan->next_frame_ms = srv_next_frame_ms(plan->next_frame_ms, p->settings.max_fps, now_ms);
}

/* Collects the participants of the session that want the same frame as the chosen one. */
static uint32_t collect_recipients(const struct srv_schedule *schedule,
                                   const struct srv_choice *choice, double now_ms,
                                   struct srv_participant *recipients[SRV_PARTICIPANTS_MAX]) {
    struct srv_session *s = choice->participant->session;
    uint32_t count = 0;
    for (struct srv_participant *p = s->participants; p; p = p->next) {
        const struct srv_frame_request other = srv_request_to_share(schedule, s, p, now_ms);
        if (other.is_wanted && other.step == choice->request.step &&
            other.is_slow_to_encode == choice->request.is_slow_to_encode &&
            has_same_size(s, choice->participant, p, other.step))
            recipients[count++] = p;
    }
    assert(count > 0);
    return count;
}

static struct srv_blob_owner owner_of(const struct srv_session *s) {
    const struct srv_owner *owner = &s->identity.owner;
    struct srv_blob_owner of = { .is_limited = owner->quota.is_limited };
    memcpy(of.name, owner->name, sizeof of.name);
    return of;
}

static void fill_job(struct srv_schedule *schedule, const struct srv_choice *choice, double now_ms,
                     struct srv_render_job *job) {
    const struct srv_session *s = choice->participant->session;
    const struct srv_volume_source *source = &schedule->hub->options.volumes;
    job->session = s->identity.number;
    memcpy(job->id, s->identity.id, sizeof job->id);
    job->version = s->shared.version;
    job->image = s->shared.image;
    job->order = ++schedule->next_order;
    job->step = choice->request.step;
    job->is_refinement = choice->request.is_refinement;
    job->protected_ms = choice->request.protected_ms;
    job->is_alone = schedule->hub->participants.count == 1;
    job->view = s->shared.view;
    srv_play_place(s, now_ms, &job->view);
    srv_hub_size(s, choice->participant, job->full);
    memcpy(job->view.size, job->full, sizeof job->full);
    job->volume = source->ref(source->user, s->shared.displayed);
    job->owner = owner_of(s);
    job->too_large = 0;
    job->target_count = 0;
    job->encoder_bytes = 0;
    job->depth = (struct srv_bytes){ .size = 0 };
}

/* Counts a new job in its session, and in the mean time between frames. */
static void count_job(struct srv_schedule *schedule, struct srv_session *s,
                      const struct srv_render_job *job, double now_ms) {
    struct srv_session_schedule *plan = s->schedule;
    double since_ms = now_ms - plan->newest_ms, *interval_ms = &s->stats.interval_ms;
    if (since_ms < 1000)
        *interval_ms = *interval_ms == 0 ? since_ms : *interval_ms + (since_ms - *interval_ms) / 4;
    plan->newest_order = job->order;
    plan->newest_ms = now_ms;
    plan->jobs++;
    plan->slow_jobs += job->is_slow_to_encode;
    schedule->slow_jobs += job->is_slow_to_encode;
    schedule->cancellable += job->protected_ms < INFINITY;
    if (job->step == SRV_STEP_MOVING) {
        plan->moved_ms = now_ms;
        srv_metrics_time(schedule->hub->options.metrics, SRV_TIME_QUEUE,
                         now_ms - s->shared.changed_ms);
    }
}

/* Would the frame in its chosen size be slow to encode for one of them? The request could only
 * assume a size. */
static bool is_slow_to_encode(const struct srv_render_job *job,
                              struct srv_participant *const *recipients, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        const struct srv_encoding encoding = srv_policy_encoding(recipients[i], job->step);
        if (srv_encoding_expected_ms(&encoding, job->view.size) > SRV_SLOW_ENCODE_MS)
            return true;
    }
    return false;
}

static void make_job(struct srv_schedule *schedule, const struct srv_choice *choice, double now_ms,
                     struct srv_render_job *job) {
    struct srv_participant *first = choice->participant, *recipients[SRV_PARTICIPANTS_MAX];
    struct srv_session *s = first->session;
    struct srv_session_schedule *plan = s->schedule;
    uint32_t count = collect_recipients(schedule, choice, now_ms, recipients);
    int max_fps = 1;
    for (uint32_t i = 0; i < count; i++)
        max_fps =
            recipients[i]->settings.max_fps > max_fps ? recipients[i]->settings.max_fps : max_fps;
    fill_job(schedule, choice, now_ms, job);
    job->is_first = choice->request.rank == SRV_RANK_FIRST;
    choose_detail(schedule, s, job, first, max_fps);
    job->is_slow_to_encode = is_slow_to_encode(job, recipients, count);
    job->cancellable_from_ms = cancellable_from_ms(s, job, now_ms);
    job->ahead = count == 1 ? srv_predict_job(schedule, first, job, now_ms) : 0;
    job->ends_with_motion = count == 1 && srv_ends_with_motion(schedule, first, job, now_ms);
    for (uint32_t i = 0; i < count; i++)
        add_target(schedule, s, recipients[i], job, now_ms);
    plan->clock_ms = srv_fair_start(&first->schedule->account, plan->clock_ms);
    charge(schedule, s, job);
    count_job(schedule, s, job, now_ms);
}

/* Gives a new version to the views that play, once the frame that took the last one is done: a
 * newer version would cancel it. */
static void play(struct srv_schedule *schedule, double now_ms, double *wait_ms) {
    for (struct srv_session *s = schedule->busy; s; s = s->schedule->next_busy) {
        const double due_ms = srv_play_due_ms(s);
        bool is_taken = false;
        if (due_ms == INFINITY || s->schedule->jobs > 0)
            continue;
        for (const struct srv_participant *p = s->participants; p; p = p->next)
            is_taken = is_taken || p->schedule->newest.version >= s->shared.version;
        if (is_taken && due_ms <= now_ms)
            srv_play_advance(schedule->hub, s, now_ms);
        else if (is_taken)
            *wait_ms = fmin(*wait_ms, due_ms - now_ms);
    }
}

bool srv_schedule_next(struct srv_schedule *schedule, double now_ms, struct srv_render_job *job,
                       double *wait_ms) {
    *wait_ms = 1000;
    pthread_mutex_lock(&schedule->hub->mutex);
    play(schedule, now_ms, wait_ms);
    const struct srv_choice choice = srv_choose(schedule, now_ms, wait_ms);
    if (choice.participant)
        make_job(schedule, &choice, now_ms, job);
    pthread_mutex_unlock(&schedule->hub->mutex);
    return choice.participant != NULL;
}

bool srv_schedule_next_short(struct srv_schedule *schedule, const struct srv_running_job *running,
                             double now_ms, struct srv_render_job *job, double *wait_ms) {
    *wait_ms = 1000;
    pthread_mutex_lock(&schedule->hub->mutex);
    play(schedule, now_ms, wait_ms);
    const struct srv_choice choice = srv_choose_short(schedule, running, now_ms, wait_ms);
    if (choice.participant)
        make_job(schedule, &choice, now_ms, job);
    pthread_mutex_unlock(&schedule->hub->mutex);
    return choice.participant != NULL;
}

bool srv_schedule_is_newest(struct srv_schedule *schedule, const struct srv_render_job *job) {
    pthread_mutex_lock(&schedule->hub->mutex);
    const struct srv_session *s = find_session(schedule, job);
    bool newest = s && s->shared.image == job->image;
    pthread_mutex_unlock(&schedule->hub->mutex);
    return newest;
}

bool srv_schedule_has_motion(struct srv_schedule *schedule) {
    pthread_mutex_lock(&schedule->hub->mutex);
    bool has_motion = srv_has_motion(schedule);
    pthread_mutex_unlock(&schedule->hub->mutex);
    return has_motion;
}

bool srv_schedule_has_clients(struct srv_schedule *schedule) {
    pthread_mutex_lock(&schedule->hub->mutex);
    const bool has_clients = schedule->hub->participants.count > 0;
    pthread_mutex_unlock(&schedule->hub->mutex);
    return has_clients;
}

bool srv_schedule_shrink(struct srv_schedule *schedule, const struct srv_render_job *job,
                         uint64_t set, double now_ms) {
    const uint64_t px = (uint64_t)job->view.size[0] * job->view.size[1], least = 128 * 128;
    bool shrinks = false;
    pthread_mutex_lock(&schedule->hub->mutex);
    struct srv_session *s = find_session(schedule, job);
    for (uint32_t i = 0; px / 2 >= least && i < job->target_count; i++) {
        struct srv_participant *p = find_participant(s, job->targets[i].participant);
        if (!p || !(set >> i & 1))
            continue;
        p->memory = (struct srv_memory_limit){ px / 2, now_ms + SRV_SHRINK_MS };
        shrinks = true;
    }
    pthread_mutex_unlock(&schedule->hub->mutex);
    return shrinks;
}

struct srv_blob_owner srv_render_job_owner(const struct srv_render_job *job, uint64_t set) {
    struct srv_blob_owner owner = job->owner;
    owner.is_guests = true;
    for (uint32_t i = 0; i < job->target_count; i++)
        owner.is_guests = owner.is_guests && !(set >> i & 1 && !job->targets[i].is_guest);
    return owner;
}

/* Ending a job. */

/* Removes the job from all counts and releases its volume. Returns its session, NULL = it ended. */
static struct srv_session *end_job(struct srv_schedule *schedule, struct srv_render_job *job) {
    const struct srv_volume_source *source = &schedule->hub->options.volumes;
    struct srv_session *s = find_session(schedule, job);
    for (uint32_t i = 0; i < job->target_count; i++) {
        struct srv_participant *p = find_participant(s, job->targets[i].participant);
        if (p)
            p->schedule->jobs--;
    }
    source->release(source->user, job->volume);
    job->volume = NULL;
    schedule->cancellable -= job->protected_ms < INFINITY;
    schedule->slow_jobs -= job->is_slow_to_encode;
    if (s) {
        s->schedule->jobs--;
        s->schedule->slow_jobs -= job->is_slow_to_encode;
    }
    return s;
}

static struct srv_known_quality *known_quality(struct srv_schedule *schedule,
                                               const struct srv_volume *volume) {
    for (unsigned i = 0; i < SRV_QUALITIES; i++)
        if (schedule->qualities[i].volume == volume)
            return &schedule->qualities[i];
    struct srv_known_quality *oldest =
        &schedule->qualities[schedule->next_quality++ % SRV_QUALITIES];
    oldest->volume = volume;
    return oldest;
}

/* Work that is done once says nothing about the next frame. */
static void learn(struct srv_schedule *schedule, struct srv_session *s,
                  const struct srv_render_job *job, const struct srv_render_result *result) {
    const struct srv_detail drawn = detail_of(job);
    double took_ms = fmax(result->render_ms - result->once_ms, 0) + result->encode_ms;
    if (result->again || job->version < s->schedule->start.volume)
        return;
    if (job->is_draft)
        srv_quality_drafts(&s->schedule->quality, result->is_draft);
    srv_quality_done(&s->schedule->quality, &drawn, job->step == SRV_STEP_MOVING, job->budget_ms,
                     took_ms);
    known_quality(schedule, s->shared.volume)->quality = s->schedule->quality;
}

static void set_stats(struct srv_session_stats *stats, const struct srv_render_result *result) {
    *stats = (struct srv_session_stats){ .width = result->width,
                                         .height = result->height,
                                         .mip_level = result->mip_level,
                                         .render_ms = result->render_ms,
                                         .encode_ms = result->encode_ms,
                                         .splats = result->splats,
                                         .visible_voxels = result->visible_voxels,
                                         .bricks = result->bricks,
                                         .interval_ms = stats->interval_ms };
}

static void finish_job(struct srv_schedule *schedule, struct srv_session *s,
                       struct srv_render_job *job, const struct srv_render_result *result) {
    struct srv_session_schedule *plan = s->schedule;
    bool is_moving = job->step == SRV_STEP_MOVING, is_final = job->step == SRV_STEP_FINAL;
    set_stats(&s->stats, result);
    plan->must_finish = plan->must_finish && !is_moving;
    plan->has_stopped = plan->has_stopped && !is_moving;
    plan->start.done = plan->start.done > job->version ? plan->start.done : job->version;
    learn(schedule, s, job, result);
    if (srv_render_job_wants_depth(job))
        plan->has_depth = result->has_depth;
    if (is_final)
        srv_quality_rest(&plan->quality, job->view.size);
    const double took_ms = (result->again ? 0 : result->render_ms) + result->encode_ms;
    correct_charge(schedule, s, job, took_ms);
    if (job->is_first)
        schedule->first_ms = fmax(schedule->first_ms, schedule->now_ms) + FIRST_SHARE * took_ms;
    /* Statistics of a view at rest are sent at once; of a moving view, now and then. */
    for (uint32_t i = 0; !is_moving && i < job->target_count; i++) {
        struct srv_participant *p = find_participant(s, job->targets[i].participant);
        if (p && is_final)
            p->schedule->waiting.waited_ms = p->schedule->waiting.spent_ms = 0;
        if (p)
            srv_hub_notify(schedule->hub, p, SRV_NOTIFY_STATS);
    }
}

void srv_schedule_done(struct srv_schedule *schedule, struct srv_render_job *job,
                       const struct srv_render_result *result) {
    pthread_mutex_lock(&schedule->hub->mutex);
    struct srv_session *s = end_job(schedule, job);
    if (s)
        finish_job(schedule, s, job, result);
    srv_schedule_wake(schedule, s);
    pthread_mutex_unlock(&schedule->hub->mutex);
}

void srv_schedule_incomplete(struct srv_schedule *schedule, struct srv_render_job *job,
                             bool is_being_read) {
    job->is_sharp = false;
    if (job->step == SRV_STEP_FINAL && !is_being_read)
        return;
    if (job->step == SRV_STEP_FINAL)
        job->step = SRV_STEP_INTERMEDIATE;
    pthread_mutex_lock(&schedule->hub->mutex);
    struct srv_session *s = find_session(schedule, job);
    for (uint32_t i = 0; i < job->target_count; i++) {
        struct srv_participant *p = find_participant(s, job->targets[i].participant);
        job->targets[i].final = false;
        if (p && is_newest(p, job))
            p->schedule->newest.step = job->step;
    }
    pthread_mutex_unlock(&schedule->hub->mutex);
}

void srv_schedule_skipped(struct srv_schedule *schedule, const struct srv_render_job *job,
                          uint32_t i) {
    pthread_mutex_lock(&schedule->hub->mutex);
    struct srv_participant *p =
        find_participant(find_session(schedule, job), job->targets[i].participant);
    if (p && is_newest(p, job))
        p->schedule->newest.version = 0;
    pthread_mutex_unlock(&schedule->hub->mutex);
}

void srv_schedule_rendered(struct srv_schedule *schedule, struct srv_render_job *job,
                           double render_ms) {
    pthread_mutex_lock(&schedule->hub->mutex);
    struct srv_session *s = find_session(schedule, job);
    if (s)
        correct_charge(schedule, s, job, render_ms);
    pthread_mutex_unlock(&schedule->hub->mutex);
}

void srv_schedule_failed(struct srv_schedule *schedule, struct srv_render_job *job,
                         const struct sp_error *err) {
    pthread_mutex_lock(&schedule->hub->mutex);
    struct srv_session *s = end_job(schedule, job);
    srv_hub_count_drop(schedule->hub, SRV_COUNT_DROP_FAILED);
    for (uint32_t i = 0; i < job->target_count; i++) {
        struct srv_participant *p = find_participant(s, job->targets[i].participant);
        if (!p)
            continue;
        p->schedule->failed_version =
            s->shared.image == job->image ? s->shared.version : job->version;
        p->schedule->waiting.waited_ms = p->schedule->waiting.spent_ms = 0;
        p->pending.error = *err;
        srv_hub_notify(schedule->hub, p, SRV_NOTIFY_ERROR);
    }
    srv_schedule_wake(schedule, s);
    pthread_mutex_unlock(&schedule->hub->mutex);
}

static bool has_target_left(struct srv_session *s, const struct srv_render_job *job) {
    for (uint32_t i = 0; i < job->target_count; i++)
        if (find_participant(s, job->targets[i].participant))
            return true;
    return false;
}

void srv_schedule_cancelled(struct srv_schedule *schedule, struct srv_render_job *job,
                            double elapsed_ms) {
    pthread_mutex_lock(&schedule->hub->mutex);
    struct srv_session *s = end_job(schedule, job);
    srv_hub_count_drop(schedule->hub,
                       has_target_left(s, job) ? SRV_COUNT_DROP_OUTDATED : SRV_COUNT_DROP_LEFT);
    if (s && elapsed_ms > 0)
        correct_charge(schedule, s, job, elapsed_ms);
    if (srv_has_stopped(s, job))
        s->schedule->has_stopped = true;
    else if (s && job->step == SRV_STEP_MOVING) {
        const struct srv_detail drawn = detail_of(job);
        s->schedule->must_finish = true;
        if (job->version >= s->schedule->start.volume)
            srv_quality_cancelled(&s->schedule->quality, &drawn, elapsed_ms);
    }
    for (uint32_t i = 0; i < job->target_count; i++) {
        struct srv_participant *p = find_participant(s, job->targets[i].participant);
        if (!p || !is_newest(p, job) || srv_has_stopped(s, job))
            continue;
        p->schedule->newest.step = SRV_STEP_MOVING;
        p->schedule->newest.detail = (struct srv_detail){ .mip_level = SP_MIP_LEVEL_MAX };
        if (job->protected_ms < INFINITY)
            p->schedule->waiting.spent_ms = fmax(p->schedule->waiting.spent_ms, elapsed_ms);
        if (!job->is_refinement)
            p->schedule->newest.version = 0;
    }
    srv_schedule_wake(schedule, s);
    pthread_mutex_unlock(&schedule->hub->mutex);
}
