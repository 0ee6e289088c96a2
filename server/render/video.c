/* SPDX-License-Identifier: Apache-2.0 */
#include "render/video.h"

#include <pthread.h>
#include <stdlib.h>

#include "common/clock.h"
#include "protocol/frame_header.h"
#include "sp/log.h"
#include "sp/video.h"

enum { LARGE_PX = 640 * 480 }; /* frames of this size and more are encoded by two threads */
#define KEY_MS 1000.0          /* at least, between key frames that only some participants need */
#define IDLE_MS 10000.0        /* an encoder that is unused for this long is destroyed */
#define BUSY_MS 1000.0         /* the same, when another encoder would exceed the bound */

_Static_assert((int)SRV_PARTICIPANTS_MAX <= 64, "a set of targets has one bit each");

struct encoder {
    struct encoder *next;
    uint64_t session;
    enum sp_video_codec codec;
    uint32_t full[2]; /* size at rest, px; moving frames may be smaller */
    unsigned users;   /* guarded by the list's mutex, as is used_ms */
    double used_ms;
    pthread_mutex_t mutex;    /* guards what follows */
    struct sp_budget *budget; /* from which its memory is taken; constant */
    struct sp_video *video;
    struct srv_video_mark mark; /* of the next frame; epoch 0 = it must be a key frame */
    uint64_t order;             /* of the newest job */
    double key_ms;
};

struct srv_video_encoders {
    struct sp_budget *budget;
    struct srv_blob_pool *blobs;
    struct srv_metrics *metrics;
    pthread_mutex_t mutex;
    struct encoder *list;
    uint64_t px, px_max; /* of all in the list; bound */
    uint64_t epochs;     /* so far */
};

struct srv_video_encoders *srv_video_encoders_create(uint64_t px, struct sp_budget *budget,
                                                     struct srv_blob_pool *blobs,
                                                     struct srv_metrics *metrics,
                                                     struct sp_error *err) {
    struct srv_video_encoders *encoders = calloc(1, sizeof *encoders);
    if (!encoders) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for video");
        return NULL;
    }
    encoders->px_max = px;
    encoders->budget = budget;
    encoders->blobs = blobs;
    encoders->metrics = metrics;
    pthread_mutex_init(&encoders->mutex, NULL);
    /* Loads the codecs now, so that no client waits for it. */
    for (int i = 0; i < SP_VIDEO_CODEC_COUNT; i++)
        if (!sp_video_is_available((enum sp_video_codec)i))
            sp_log(SP_LOG_DEBUG, "%s is not available: it is not built in",
                   sp_video_codec_name((enum sp_video_codec)i));
    return encoders;
}

static uint64_t cost_px(const uint32_t full[2]) {
    uint64_t px = (uint64_t)full[0] * full[1];
    return px > SRV_VIDEO_PX_MIN ? px : SRV_VIDEO_PX_MIN;
}

static void destroy(struct encoder *encoder) {
    sp_video_destroy(&encoder->video);
    sp_budget_release(encoder->budget, SP_BUDGET_ENCODERS,
                      sp_video_bytes(encoder->codec, encoder->full));
    pthread_mutex_destroy(&encoder->mutex);
    free(encoder);
}

static bool is_idle(const struct encoder *encoder, double until_ms) {
    return encoder->users == 0 && encoder->used_ms <= until_ms;
}

/* Removes the encoders from the list that were not used since `until_ms`. With the mutex held; the
 * caller destroys them after it has released the mutex. */
static struct encoder *unlink_idle(struct srv_video_encoders *encoders, double until_ms) {
    struct encoder *idle = NULL;
    for (struct encoder **link = &encoders->list; *link;) {
        struct encoder *encoder = *link;
        if (!is_idle(encoder, until_ms)) {
            link = &encoder->next;
            continue;
        }
        *link = encoder->next;
        encoder->next = idle;
        idle = encoder;
        encoders->px -= cost_px(encoder->full);
    }
    return idle;
}

static void destroy_all(struct encoder *list) {
    while (list) {
        struct encoder *next = list->next;
        destroy(list);
        list = next;
    }
}

bool srv_video_encoders_are_idle(struct srv_video_encoders *encoders, double now_ms) {
    bool idle = false;
    pthread_mutex_lock(&encoders->mutex);
    for (const struct encoder *e = encoders->list; e && !idle; e = e->next)
        idle = is_idle(e, now_ms - IDLE_MS);
    pthread_mutex_unlock(&encoders->mutex);
    return idle;
}

void srv_video_encoders_tick(struct srv_video_encoders *encoders, double now_ms) {
    pthread_mutex_lock(&encoders->mutex);
    struct encoder *idle = unlink_idle(encoders, now_ms - IDLE_MS);
    pthread_mutex_unlock(&encoders->mutex);
    destroy_all(idle);
}

void srv_video_encoders_destroy(struct srv_video_encoders **encoders_pointer) {
    struct srv_video_encoders *encoders = *encoders_pointer;
    *encoders_pointer = NULL;
    if (!encoders)
        return;
    destroy_all(encoders->list);
    pthread_mutex_destroy(&encoders->mutex);
    free(encoders);
}

static struct encoder *create(struct sp_budget *budget, const struct srv_render_job *job,
                              enum sp_video_codec codec) {
    const uint64_t bytes = sp_video_bytes(codec, job->full);
    if (!sp_budget_acquire(budget, SP_BUDGET_ENCODERS, bytes))
        return NULL;
    struct encoder *encoder = calloc(1, sizeof *encoder);
    struct sp_error err = { .code = SP_ERR_MEMORY, .text = "out of memory" };
    unsigned threads = (uint64_t)job->full[0] * job->full[1] >= LARGE_PX ? 2 : 1;
    if (!encoder || !(encoder->video = sp_video_create(codec, threads, &err))) {
        sp_log(SP_LOG_WARN, "cannot create a %s encoder for a session: %s",
               sp_video_codec_name(codec), err.text);
        sp_budget_release(budget, SP_BUDGET_ENCODERS, bytes);
        free(encoder);
        return NULL;
    }
    encoder->budget = budget;
    encoder->session = job->session;
    encoder->codec = codec;
    encoder->full[0] = job->full[0];
    encoder->full[1] = job->full[1];
    pthread_mutex_init(&encoder->mutex, NULL);
    return encoder;
}

/* Returns the encoder for a job's frames, in use until give_back(). NULL if there is none and none
 * can be created. */
static struct encoder *borrow(struct srv_video_encoders *encoders, const struct srv_render_job *job,
                              enum sp_video_codec codec, double now_ms) {
    pthread_mutex_lock(&encoders->mutex);
    struct encoder *encoder = encoders->list;
    while (encoder && !(encoder->session == job->session && encoder->codec == codec &&
                        encoder->full[0] == job->full[0] && encoder->full[1] == job->full[1]))
        encoder = encoder->next;
    /* For example while a client resizes its window: encoders of earlier sizes are useless now. */
    uint64_t cost = cost_px(job->full);
    struct encoder *idle = NULL;
    if (!encoder && encoders->px + cost > encoders->px_max)
        idle = unlink_idle(encoders, now_ms - BUSY_MS);
    if (!encoder && encoders->px + cost <= encoders->px_max &&
        (encoder = create(encoders->budget, job, codec))) {
        encoder->next = encoders->list;
        encoders->list = encoder;
        encoders->px += cost;
    }
    if (encoder)
        encoder->users++;
    pthread_mutex_unlock(&encoders->mutex);
    destroy_all(idle);
    return encoder;
}

static void give_back(struct srv_video_encoders *encoders, struct encoder *encoder, double now_ms) {
    pthread_mutex_lock(&encoders->mutex);
    encoder->users--;
    encoder->used_ms = now_ms;
    pthread_mutex_unlock(&encoders->mutex);
}

static uint8_t codec_number(enum sp_video_codec codec) {
    return codec == SP_VIDEO_VP8   ? PROTO_CODEC_VP8
           : codec == SP_VIDEO_VP9 ? PROTO_CODEC_VP9
                                   : PROTO_CODEC_H264;
}

struct recipients { /* sets of targets, one bit each, by what they receive */
    uint64_t delta, key, images;
};

/* Decides what each target of the set receives of this frame. A key frame would also end the video
 * of participants that skip this frame. With the encoder locked. */
static struct recipients ask(struct srv_schedule *schedule, const struct srv_render_job *job,
                             uint64_t set, const struct encoder *encoder, double now_ms) {
    struct recipients recipients = { 0 };
    struct srv_hub *hub = srv_schedule_hub(schedule);
    const struct srv_drawn_frame frame = srv_render_job_frame(job);
    for (uint32_t i = 0; i < job->target_count; i++) {
        uint64_t bit = set & UINT64_C(1) << i;
        enum srv_video_need need =
            bit ? srv_hub_video_need(hub, &frame, &job->targets[i], &encoder->mark)
                : SRV_VIDEO_NONE;
        if (need == SRV_VIDEO_DELTA)
            recipients.delta |= bit;
        else if (need == SRV_VIDEO_KEY)
            recipients.key |= bit;
        else if (need == SRV_VIDEO_WAITS)
            srv_schedule_skipped(schedule, job, i);
    }
    bool is_late = job->order <= encoder->order;
    bool is_shared = recipients.delta || srv_hub_has_video(hub, &frame, job->targets,
                                                           job->target_count, &encoder->mark);
    if (is_late) {
        recipients.images = recipients.delta | recipients.key;
        recipients.delta = recipients.key = 0;
    } else if (recipients.key && (!is_shared || now_ms - encoder->key_ms >= KEY_MS)) {
        recipients.key |= recipients.delta;
        recipients.delta = 0;
    } else {
        recipients.images = recipients.key;
        recipients.key = 0;
    }
    return recipients;
}

static int best_quality(const struct srv_render_job *job, uint64_t set) {
    int best = 1;
    for (uint32_t i = 0; i < job->target_count; i++)
        if (set >> i & 1 && job->targets[i].quality > best)
            best = job->targets[i].quality;
    return best;
}

/* Begins a new epoch if the frame that was just encoded is a key frame. */
static void advance(struct srv_video_encoders *encoders, struct encoder *encoder, bool is_key,
                    double now_ms) {
    if (!is_key)
        return;
    pthread_mutex_lock(&encoders->mutex);
    encoder->mark.epoch = ++encoders->epochs;
    pthread_mutex_unlock(&encoders->mutex);
    encoder->mark.number = 0;
    encoder->key_ms = now_ms;
}

/* Returns the targets of the set that get depth, or those that do not. */
static uint64_t with_depth(const struct srv_render_job *job, uint64_t set, bool depth) {
    uint64_t found = 0;
    for (uint32_t i = 0; i < job->target_count; i++)
        if (set >> i & 1 && job->targets[i].depth == depth)
            found |= UINT64_C(1) << i;
    return found;
}

/* Gets the bytes of a packet for targets that get no depth, [0], and for the others, [1]; NULL =
 * the set has none of them. False if a blob could not be made. */
static bool create_blobs(struct srv_blob_pool *pool, const struct srv_render_job *job, uint64_t set,
                         const struct sp_video_packet *packet, struct srv_blob *blobs[2],
                         struct sp_error *err) {
    const struct srv_bytes before[2] = { { .size = 0 }, job->depth };
    for (int depth = 0; depth < 2; depth++) {
        const uint64_t own = with_depth(job, set, depth);
        const struct srv_blob_owner owner = srv_render_job_owner(job, own);
        if (own && !(blobs[depth] = srv_blob_create_with(pool, &owner, &before[depth],
                                                         packet->bytes, packet->size, err)))
            return false;
    }
    return true;
}

/* Encodes one packet and delivers it to all targets of the set. False if it failed: no target
 * received anything. With the encoder locked. */
static bool encode(struct srv_video_encoders *encoders, struct srv_hub *hub,
                   const struct srv_render_job *job, const struct sp_frame *frame,
                   struct encoder *encoder, uint64_t set, bool key, double now_ms,
                   double *encode_ms) {
    struct sp_video_packet packet;
    struct sp_error err;
    double start_ms = srv_clock_ms();
    struct srv_blob *blobs[2] = { NULL, NULL };
    const bool ok =
        sp_video_encode(encoder->video, frame, best_quality(job, set), key, &packet, &err) &&
        create_blobs(encoders->blobs, job, set, &packet, blobs, &err);
    double took_ms = srv_clock_ms() - start_ms;
    *encode_ms += took_ms;
    srv_metrics_time(encoders->metrics, SRV_TIME_ENCODE, took_ms);
    if (!ok) { /* the encoder may have advanced: the next frame must be a key frame */
        sp_log(err.code == SP_ERR_FRAME_BUDGET ? SP_LOG_INFO : SP_LOG_ERROR,
               "encoding a video frame failed: %s", err.text);
        encoder->mark.epoch = 0;
        srv_blob_unref(&blobs[0]);
        return false;
    }
    advance(encoders, encoder, packet.is_key, now_ms);
    encoder->order = job->order;
    struct proto_frame_header header = {
        .codec = codec_number(encoder->codec),
        .flags = (packet.is_key ? PROTO_FRAME_KEY : 0) |
                 (sp_frame_bricks_is_complete(&frame->stats.bricks) ? 0 : PROTO_FRAME_INCOMPLETE),
        .width = (uint16_t)frame->width,
        .height = (uint16_t)frame->height,
        .render_us = (uint32_t)(frame->stats.render_ms * 1000),
        .encode_us = (uint32_t)(took_ms * 1000),
    };
    const struct srv_drawn_frame drawn = srv_render_job_frame(job);
    for (uint32_t i = 0; i < job->target_count; i++)
        if (set >> i & 1)
            srv_hub_deliver_video(hub, &drawn, &job->targets[i], &header,
                                  blobs[job->targets[i].depth], &encoder->mark);
    encoder->mark.number++;
    srv_blob_unref(&blobs[0]);
    srv_blob_unref(&blobs[1]);
    return true;
}

/* Returns the targets of the set that need an image instead. */
static uint64_t encode_set(struct srv_video_encoders *encoders, struct srv_schedule *schedule,
                           const struct srv_render_job *job, const struct sp_frame *frame,
                           enum sp_video_codec codec, uint64_t set, double now_ms,
                           double *encode_ms) {
    struct encoder *encoder = borrow(encoders, job, codec, now_ms);
    if (!encoder) {
        const struct srv_drawn_frame drawn = srv_render_job_frame(job);
        srv_hub_refuse_video(srv_schedule_hub(schedule), &drawn, job->targets, job->target_count,
                             set);
        return set;
    }
    pthread_mutex_lock(&encoder->mutex);
    struct recipients recipients = ask(schedule, job, set, encoder, now_ms);
    uint64_t served = recipients.delta | recipients.key;
    if (served && !encode(encoders, srv_schedule_hub(schedule), job, frame, encoder, served,
                          recipients.key != 0, now_ms, encode_ms))
        recipients.images |= served;
    pthread_mutex_unlock(&encoder->mutex);
    give_back(encoders, encoder, now_ms);
    return recipients.images;
}

uint64_t srv_video_encoders_encode(struct srv_video_encoders *encoders,
                                   struct srv_schedule *schedule, const struct srv_render_job *job,
                                   const struct sp_frame *frame, double now_ms, double *encode_ms) {
    uint64_t sets[SP_VIDEO_CODEC_COUNT + 1] = { 0 };
    for (uint32_t i = 0; i < job->target_count; i++)
        sets[job->targets[i].video] |= UINT64_C(1) << i;
    uint64_t images = sets[SP_VIDEO_CODEC_COUNT];
    for (int codec = 0; codec < SP_VIDEO_CODEC_COUNT; codec++)
        if (sets[codec])
            images |= encode_set(encoders, schedule, job, frame, (enum sp_video_codec)codec,
                                 sets[codec], now_ms, encode_ms);
    return images;
}
