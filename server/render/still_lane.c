/* SPDX-License-Identifier: Apache-2.0
 *
 * The still lane: single pictures, in the order in which they were asked for.
 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "clock.h"
#include "render/scheduler_private.h"
#include "sp/log.h"

enum { STILL_NICE = 10 };

void srv_still_answer(struct srv_scheduler *s, struct srv_still_item *item,
                      const struct srv_still_result *result) {
    item->still.done(item->still.user, result);
    srv_catalog_release(s->options.catalog, item->still.volume);
    free(item);
    pthread_mutex_lock(&s->mutex);
    s->still_unanswered--;
    pthread_mutex_unlock(&s->mutex);
}

void srv_still_fail(struct srv_scheduler *s, struct srv_still_item *item,
                    const struct sp_error *err) {
    srv_metrics_add(s->options.metrics,
                    err->code == SP_ERR_CANCELLED ? SRV_COUNT_DROP_LEFT : SRV_COUNT_DROP_FAILED, 1);
    struct srv_still_result result = { .ok = false, .err = *err };
    srv_still_answer(s, item, &result);
}

static void fail_all(struct srv_scheduler *s, struct srv_still_item *list, const char *why) {
    struct sp_error err;
    sp_fail(&err, SP_ERR_CANCELLED, NULL, "%s", why);
    while (list) {
        struct srv_still_item *next = list->next;
        srv_still_fail(s, list, &err);
        list = next;
    }
}

static bool is_gone(const struct srv_still_item *item) {
    return item->still.is_gone && item->still.is_gone(item->still.user);
}

/* The next still becomes still_now; NULL if there is none. */
static struct srv_still_item *take_still(struct srv_scheduler *s) {
    pthread_mutex_lock(&s->mutex);
    struct srv_still_item *item = s->still_head;
    if (item) {
        s->still_head = item->next;
        if (!s->still_head)
            s->still_tail = &s->still_head;
        s->still_waiting--;
        s->still_now = item;
        atomic_store(&s->still_cancel, s->stop);
    }
    pthread_mutex_unlock(&s->mutex);
    return item;
}

static void render_still(struct srv_scheduler *s, struct srv_still_item *item) {
    struct srv_lane *lane = &s->lanes[SRV_LANE_STILLS];
    struct sp_error err = { .code = SP_OK };
    struct sp_frame *frame = NULL;
    srv_metrics_time(s->options.metrics, SRV_TIME_QUEUE, srv_clock_ms() - item->queued_ms);
    enum sp_pixel_format format =
        sp_image_format_info(item->still.format)->wants_float ? SP_RGBAF32 : SP_RGBA8;
    if (!lane->renderer)
        lane->renderer = sp_renderer_create(&s->options.stills, &err);
    const struct sp_render_options options = { .format = format, .cancel = &s->still_cancel };
    if (lane->renderer) {
        frame = sp_renderer_render(lane->renderer, srv_volume_voxels(item->still.volume),
                                   &item->still.view, s->pool, &options, &err);
        srv_lane_note_frame(s, SRV_LANE_STILLS, item->still.volume);
    }
    pthread_mutex_lock(&s->mutex);
    s->still_now = NULL;
    pthread_mutex_unlock(&s->mutex);
    if (frame)
        srv_encode_pass_on(s, (struct srv_work){ .frame = frame, .still = item });
    else
        srv_still_fail(s, item, &err);
}

/* Nicer than the daemon by STILL_NICE: this thread, and the renderer's threads, which it will
 * start.
 */
static void be_nice(void) {
    id_t thread = (id_t)gettid();
    errno = 0;
    int niceness = getpriority(PRIO_PROCESS, thread);
    if (errno != 0 || setpriority(PRIO_PROCESS, thread, niceness + STILL_NICE) != 0)
        sp_log(SP_LOG_WARN, "the still lane cannot be nice: %s", strerror(errno));
}

void *srv_still_lane_main(void *user) {
    struct srv_scheduler *s = user;
    struct srv_lane *lane = &s->lanes[SRV_LANE_STILLS];
    be_nice();
    for (;;) {
        struct srv_turn turn = srv_lane_look(s, SRV_LANE_STILLS);
        srv_lane_forget(lane, turn.forget);
        if (turn.stop)
            break;
        struct srv_still_item *item = turn.room ? take_still(s) : NULL;
        if (item)
            render_still(s, item);
        else
            srv_lane_wait(s, lane, turn.generation, 1000);
    }
    return NULL;
}

bool srv_scheduler_submit(struct srv_scheduler *s, const struct srv_still *still,
                          struct sp_error *err) {
    struct srv_still_item *item = malloc(sizeof *item);
    bool ok = item || sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a render request");
    pthread_mutex_lock(&s->mutex);
    if (ok && s->stop)
        ok = sp_fail(err, SP_ERR_CANCELLED, NULL, "the daemon is shutting down");
    if (ok && s->still_waiting >= s->options.queue_max)
        ok = sp_fail(err, SP_ERR_BUDGET, NULL,
                     "%u renders wait already and --render-queue allows %u; try again later",
                     s->still_waiting, s->options.queue_max);
    if (ok) {
        *item = (struct srv_still_item){ .still = *still, .queued_ms = srv_clock_ms() };
        *s->still_tail = item;
        s->still_tail = &item->next;
        s->still_waiting++;
        s->still_unanswered++;
        srv_lane_wake(&s->lanes[SRV_LANE_STILLS]);
    }
    pthread_mutex_unlock(&s->mutex);
    if (!ok) {
        srv_catalog_release(s->options.catalog, still->volume);
        free(item);
    }
    return ok;
}

void srv_stills_tick(struct srv_scheduler *s) {
    struct srv_still_item *gone = NULL;
    pthread_mutex_lock(&s->mutex);
    for (struct srv_still_item **at = &s->still_head; *at;) {
        struct srv_still_item *item = *at;
        if (!is_gone(item)) {
            at = &item->next;
            continue;
        }
        *at = item->next;
        s->still_waiting--;
        item->next = gone;
        gone = item;
    }
    s->still_tail = &s->still_head;
    while (*s->still_tail)
        s->still_tail = &(*s->still_tail)->next;
    if (s->still_now && is_gone(s->still_now))
        atomic_store(&s->still_cancel, true);
    pthread_mutex_unlock(&s->mutex);
    fail_all(s, gone, "who asked for this picture has left");
}

void srv_stills_drop(struct srv_scheduler *s) {
    pthread_mutex_lock(&s->mutex);
    struct srv_still_item *left = s->still_head;
    s->still_head = NULL;
    s->still_tail = &s->still_head;
    s->still_waiting = 0;
    pthread_mutex_unlock(&s->mutex);
    fail_all(s, left, "the daemon is shutting down");
}
