/* SPDX-License-Identifier: Apache-2.0
 *
 * The thread of the jobs: a frame after the other, from the view to the file.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/background.h"
#include "common/clock.h"
#include "paths/movie.h"
#include "paths/paths_private.h"
#include "render/video.h"
#include "sp/log.h"

enum { VIDEO_THREADS = 1 };
#define PAUSE_MS 1000.0 /* before what failed is tried again: twice as long each time */
#define PAUSE_MAX_MS 60000.0
#define KEY_SECONDS 2.0 /* between key frames, to which players seek */

struct encoder { /* of a movie, between its frames, too */
    struct encoder *next;
    char id[SRV_JOB_ID_BYTES];
    struct sp_video *video;
    uint64_t px;
};

struct drawing { /* what the thread has */
    struct srv_jobs *jobs;
    struct sp_encoder *encoder;
    struct encoder *videos;   /* the last used one first */
    struct srv_path_job *job; /* that it is at; NULL = none */
    struct srv_path *path;    /* of the job; NULL = not read */
};

static void leave_job(struct drawing *d) {
    srv_path_free(&d->path);
    if (d->job)
        srv_job_unref(d->job);
    d->job = NULL;
}

static void drop_video(struct encoder **at) {
    struct encoder *encoder = *at;
    *at = encoder->next;
    sp_video_destroy(&encoder->video);
    free(encoder);
}

static struct encoder **find_video(struct drawing *d, const char *id) {
    struct encoder **at = &d->videos;
    while (*at && strcmp((*at)->id, id) != 0)
        at = &(*at)->next;
    return at;
}

/* The job needs it no more, or not for a while. */
static void forget_video(struct drawing *d, const char *id) {
    struct encoder **at = find_video(d, id);
    if (*at)
        drop_video(at);
}

/* Drops those that were not used for longest until there is room for so many px. The next frame of
 * their movies is a key frame, which any movie may have anywhere. */
static void make_room(struct drawing *d, uint64_t px) {
    struct encoder **at = &d->videos;
    while (*at && px + (*at)->px <= d->jobs->options.video_px) {
        px += (*at)->px;
        at = &(*at)->next;
    }
    while (*at)
        drop_video(at);
}

/* The encoder of the job's movie. */
static struct sp_video *take_video(struct drawing *d, struct sp_error *err) {
    struct encoder **at = find_video(d, d->job->id), *encoder = *at;
    if (encoder) {
        *at = encoder->next;
    } else {
        uint64_t px = (uint64_t)d->job->size[0] * d->job->size[1];
        px = px < SRV_VIDEO_PX_MIN ? SRV_VIDEO_PX_MIN : px;
        make_room(d, px);
        encoder = calloc(1, sizeof *encoder);
        if (!encoder || !(encoder->video = sp_video_create(SP_VIDEO_VP9, VIDEO_THREADS, err))) {
            if (!encoder)
                sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for an encoder");
            free(encoder);
            return NULL;
        }
        encoder->px = px;
        memcpy(encoder->id, d->job->id, sizeof encoder->id);
    }
    encoder->next = d->videos;
    d->videos = encoder;
    return encoder->video;
}

/* The mutex is held by the two, and by what is called in pairs of unlock and lock below. */

static void set_state(struct srv_jobs *jobs, struct srv_path_job *job, enum srv_job_state state,
                      const char *reason) {
    bool same = job->state == state && strcmp(job->reason, reason) == 0;
    job->state = state;
    snprintf(job->reason, sizeof job->reason, "%s", reason);
    if (!same)
        srv_jobs_tell(jobs, job);
}

static void fail_job(struct drawing *d, const struct sp_error *err) {
    struct srv_jobs *jobs = d->jobs;
    char reason[SP_ERROR_TEXT];
    snprintf(reason, sizeof reason, "frame %u: %.48s%s%.280s", d->job->done, err->place,
             err->place[0] ? ": " : "", err->text);
    sp_log_with(SP_LOG_ERROR, SP_LOG_FIELDS({ "path", d->job->id }), "path %s failed at %s",
                d->job->id, reason);
    pthread_mutex_lock(&jobs->records);
    if (!atomic_load(&d->job->is_removed)) /* else its record goes, or went */
        srv_record_fail(jobs, d->job->id, reason);
    pthread_mutex_unlock(&jobs->records);
    srv_metrics_add(jobs->options.metrics, SRV_COUNT_PATH_FAILED, 1);
    pthread_mutex_lock(&jobs->mutex);
    set_state(jobs, d->job, SRV_JOB_FAILED, reason);
    pthread_mutex_unlock(&jobs->mutex);
}

/* Can it be otherwise another time: a full disk, memory, what others take up? Which one is what
 * *missing counts. */
static bool passes(enum sp_code code, enum srv_counter *missing) {
    switch (code) {
    case SP_ERR_IO:
        *missing = SRV_COUNT_PATH_WAIT_DISK;
        return true;
    case SP_ERR_MEMORY:
        *missing = SRV_COUNT_PATH_WAIT_MEMORY;
        return true;
    case SP_ERR_BUDGET:
        *missing = SRV_COUNT_PATH_WAIT_LIMIT;
        return true;
    case SP_ERR_TIMEOUT:
        *missing = SRV_COUNT_PATH_WAIT_VOLUME;
        return true;
    case SP_ERR_BACKEND:
    case SP_ERR_CRASHED:
        *missing = SRV_COUNT_PATH_WAIT_BACKEND;
        return true;
    case SP_OK:
    case SP_ERR_INVALID:
    case SP_ERR_UNSUPPORTED:
    case SP_ERR_NOT_FOUND:
    case SP_ERR_FORMAT:
    case SP_ERR_DENIED:
    case SP_ERR_CANCELLED:
        break;
    }
    return false;
}

/* Waits until what it waits for has changed since `generation`, or until_ms. */
static void block(struct drawing *d, uint64_t generation, double until_ms, enum srv_counter missing,
                  const char *reason) {
    struct srv_jobs *jobs = d->jobs;
    srv_metrics_add(jobs->options.metrics, missing, 1);
    forget_video(d, d->job->id); /* it may have seen a frame that is not on the disk */
    pthread_mutex_lock(&jobs->mutex);
    d->job->blocked_ms = jobs->generation == generation ? until_ms : 0;
    set_state(jobs, d->job, SRV_JOB_WAITING, reason);
    pthread_mutex_unlock(&jobs->mutex);
}

/* The job cannot go on: what passes is waited for, longer and longer. */
static void stop_job(struct drawing *d, uint64_t generation, const struct sp_error *err) {
    struct srv_path_job *job = d->job;
    char reason[SP_ERROR_TEXT];
    const char *slash = strrchr(err->place, '/');
    enum srv_counter missing;
    if (err->code == SP_ERR_CANCELLED) /* it was removed, or the daemon stops */
        return;
    if (!passes(err->code, &missing)) {
        fail_job(d, err);
        return;
    }
    snprintf(reason, sizeof reason, "%.100s%s%.280s", err->place, err->place[0] ? ": " : "",
             err->text);
    if (job->pause_ms == 0)
        sp_log_with(SP_LOG_WARN, SP_LOG_FIELDS({ "path", job->id }),
                    "path %s waits at frame %u: %s", job->id, job->done, reason);
    if (err->code == SP_ERR_IO) /* where its files lie is not for clients */
        snprintf(reason, sizeof reason, "%.100s: %.280s", slash ? slash + 1 : err->place,
                 err->text);
    job->pause_ms = fmin(fmax(2 * job->pause_ms, PAUSE_MS), PAUSE_MAX_MS);
    block(d, generation, srv_clock_ms() + job->pause_ms, missing, reason);
}

/* The frame, by the scheduler. */

struct answer {
    struct srv_jobs *jobs;
    struct srv_path_job *job;
    bool is_there, ok;
    struct sp_frame *frame;
    double drawn_ms;
    struct sp_error err;
};

static void on_done(void *user, const struct srv_snapshot_result *result) {
    struct answer *answer = user;
    struct srv_jobs *jobs = answer->jobs;
    pthread_mutex_lock(&jobs->mutex);
    answer->ok = result->ok;
    answer->drawn_ms = result->drawn_ms;
    if (result->ok)
        answer->frame = sp_frame_ref(result->frame);
    else
        answer->err = result->err;
    answer->is_there = true; /* it may be gone once the mutex is */
    pthread_cond_broadcast(&jobs->wake);
    pthread_mutex_unlock(&jobs->mutex);
}

static bool is_given_up(void *user) {
    const struct answer *answer = user;
    return atomic_load(&answer->job->is_removed) || atomic_load(&answer->jobs->stop);
}

/* Takes over the use of the volume. */
static struct sp_frame *render(struct drawing *d, const struct sp_view *view,
                               struct srv_volume *volume, struct sp_error *err) {
    struct answer answer = { .jobs = d->jobs, .job = d->job };
    struct srv_snapshot still = { .view = *view,
                                  .volume = volume,
                                  .format = d->job->output.format,
                                  .background = true,
                                  .expected_ms = d->job->frame_ms,
                                  .wants_frame = true,
                                  .done = on_done,
                                  .is_gone = is_given_up,
                                  .user = &answer };
    if (d->job->output.is_movie)
        still.format = SP_IMAGE_PNG;
    snprintf(still.owner, sizeof still.owner, "%s", d->job->owner);
    if (!srv_render_pool_submit(d->jobs->options.render_pool, &still, err))
        return NULL;
    pthread_mutex_lock(&d->jobs->mutex);
    while (!answer.is_there)
        pthread_cond_wait(&d->jobs->wake, &d->jobs->mutex);
    pthread_mutex_unlock(&d->jobs->mutex);
    if (!answer.ok && err)
        *err = answer.err;
    if (answer.drawn_ms > 0)
        d->job->frame_ms = answer.drawn_ms;
    return answer.frame;
}

/* The job's frame as messages of room have it. */
static const char *frame_has(const struct srv_path_job *job, char text[32]) {
    snprintf(text, 32, "frame %u has", job->done);
    return text;
}

static void give_room(struct drawing *d, uint64_t bytes) {
    pthread_mutex_lock(&d->jobs->mutex);
    srv_room_give(d->jobs, d->job, bytes);
    pthread_mutex_unlock(&d->jobs->mutex);
}

/* Writes the frame's file. */
static bool write_frame(struct drawing *d, const struct sp_frame *frame, struct sp_error *err) {
    const struct srv_path_output *output = &d->job->output;
    struct sp_video_packet packet = { .size = 0 };
    const uint8_t *image = NULL;
    uint8_t head = SRV_PACKET_DELTA;
    struct sp_video *video = output->is_movie ? take_video(d, err) : NULL;
    if (output->is_movie && !video)
        return false;
    bool is_key = d->job->done % (uint32_t)(KEY_SECONDS * output->fps) == 0;
    bool ok = output->is_movie
                  ? sp_video_encode(video, frame, output->quality, is_key, &packet, err)
                  : sp_encode(d->encoder, frame, output->format, output->quality, &image,
                              &packet.size, err);
    if (!ok)
        return false;
    if (packet.is_key)
        head = SRV_PACKET_KEY;
    uint64_t bytes = packet.size + output->is_movie;
    char name[32], what[32];
    d->job->wants = bytes;
    if (!srv_room_take(d->jobs, d->job, bytes, frame_has(d->job, what), err))
        return false;
    srv_job_file_name(output, d->job->done, name);
    ok = srv_folder_write(&d->jobs->folder, d->job->id, name, &head, output->is_movie,
                          output->is_movie ? packet.bytes : image, packet.size, err);
    if (!ok)
        give_room(d, bytes);
    return ok;
}

static void count_frame(struct drawing *d) {
    struct srv_jobs *jobs = d->jobs;
    srv_metrics_add(jobs->options.metrics, SRV_COUNT_PATH_FRAMES, 1);
    pthread_mutex_lock(&jobs->mutex);
    d->job->done++;
    d->job->wants = 0;
    d->job->pause_ms = 0;
    d->job->state = SRV_JOB_RUNNING;
    d->job->reason[0] = 0;
    srv_jobs_tell(jobs, d->job);
    pthread_mutex_unlock(&jobs->mutex);
}

/* A use of the job's volume. SP_ERR_INVALID: it will never have one. */
static struct srv_volume *acquire(struct drawing *d, struct sp_error *err) {
    struct srv_catalog *catalog = d->jobs->options.catalog;
    const struct srv_path_job *job = d->job;
    struct sp_error why = { .code = SP_OK };
    struct srv_volume *volume = srv_catalog_acquire(catalog, job->volume, &why);
    pthread_mutex_lock(&d->jobs->mutex);
    bool is_unloaded = job->is_unloaded;
    pthread_mutex_unlock(&d->jobs->mutex);
    bool is_other = volume && !srv_fingerprint_equal(srv_volume_fingerprint(volume), &job->content);
    if (volume && !is_unloaded && !is_other)
        return volume;
    if (volume)
        srv_catalog_release(catalog, volume);
    if (is_unloaded)
        sp_fail(err, SP_ERR_INVALID, NULL, "the volume '%s' was unloaded", job->volume);
    else if (why.code == SP_ERR_NOT_FOUND)
        sp_fail(err, why.code, NULL,
                "the volume '%s' is not there: load it under this id, or delete the path",
                job->volume);
    else if (!volume)
        *err = why;
    else
        sp_fail(err, SP_ERR_INVALID, NULL,
                "the volume '%s' is not the one that the path was made for: its file was replaced, "
                "or another has its name",
                job->volume);
    return NULL;
}

static void draw_frame(struct drawing *d, uint64_t generation) {
    struct sp_error err = { .code = SP_OK };
    struct sp_view view;
    char what[32];
    bool has_room = srv_room_has(d->jobs, d->job, d->job->wants, frame_has(d->job, what), &err);
    struct srv_volume *volume = has_room ? acquire(d, &err) : NULL;
    if (!volume) {
        /* One that loads, could not, or is not there is waited for until there is news of volumes.
         */
        if (err.code == SP_ERR_TIMEOUT || err.code == SP_ERR_UNSUPPORTED ||
            err.code == SP_ERR_NOT_FOUND)
            block(d, generation, INFINITY, SRV_COUNT_PATH_WAIT_VOLUME, err.text);
        else
            stop_job(d, generation, &err);
        return;
    }
    pthread_mutex_lock(&d->jobs->mutex);
    if (d->job->pause_ms == 0) /* else it waits until this frame is there */
        set_state(d->jobs, d->job, SRV_JOB_RUNNING, "");
    pthread_mutex_unlock(&d->jobs->mutex);
    struct sp_frame *frame = NULL;
    if (srv_path_view(d->path, d->job->done, &view, &err))
        frame = render(d, &view, volume, &err);
    else
        srv_catalog_release(d->jobs->options.catalog, volume);
    bool ok = frame && write_frame(d, frame, &err);
    sp_frame_unref(&frame);
    if (ok)
        count_frame(d);
    else
        stop_job(d, generation, &err);
}

/* The packets become a movie: until it is whole both take room. */
static bool make_movie(struct drawing *d, struct sp_error *err) {
    struct srv_jobs *jobs = d->jobs;
    struct srv_path_job *job = d->job;
    uint64_t bytes, room = srv_movie_room(job->bytes, job->output.frames);
    char name[32];
    if (!srv_room_take(jobs, job, room, "the movie up to", err))
        return false;
    if (!srv_movie_write(&jobs->folder, job->id, SRV_JOB_MOVIE, &job->output, job->size, &bytes,
                         err)) {
        give_room(d, room);
        return false;
    }
    for (uint32_t i = 0; i < job->output.frames; i++) {
        srv_job_file_name(&job->output, i, name);
        srv_folder_remove_file(&jobs->folder, job->id, name);
    }
    give_room(d, job->bytes - bytes);
    return true;
}

/* All frames are there. */
static void finish_job(struct drawing *d, uint64_t generation) {
    struct srv_jobs *jobs = d->jobs;
    struct srv_path_job *job = d->job;
    struct sp_error err;
    if (job->output.is_movie && !make_movie(d, &err)) {
        stop_job(d, generation, &err);
        return;
    }
    pthread_mutex_lock(&jobs->mutex);
    set_state(jobs, job, SRV_JOB_DONE, "");
    if (job->output.is_movie) /* another file has taken its frames' place */
        srv_jobs_unblock(jobs);
    pthread_mutex_unlock(&jobs->mutex);
    sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "path", job->id }),
                "path %s is done: %u frames, %llu bytes", job->id, job->output.frames,
                (unsigned long long)job->bytes);
}

static bool is_over(const struct srv_path_job *job) {
    return job->state == SRV_JOB_DONE || job->state == SRV_JOB_FAILED;
}

/* When it can go on; INFINITY = not before something happens. */
static double ready_ms(const struct srv_path_job *job) {
    return is_over(job) || job->unwritten > 0 ? INFINITY : job->blocked_ms;
}

/* Of those that can go on the oldest of the owner whose turn it is; NULL = none. With the mutex
 * held. */
static struct srv_path_job *next_job(struct srv_jobs *jobs) {
    struct srv_path_job *next = NULL;
    uint64_t first = UINT64_MAX;
    double now_ms = srv_clock_ms();
    for (struct srv_path_job *job = jobs->list; job; job = job->next) {
        if (ready_ms(job) > now_ms)
            continue;
        if (job->by->turn < first) {
            first = job->by->turn;
            next = job;
        }
    }
    return next;
}

/* Removes the files of a removed job, then its record. Without the mutex. */
static bool clear(struct drawing *d, const char *id) {
    struct srv_jobs *jobs = d->jobs;
    struct sp_error err;
    forget_video(d, id);
    if (srv_folder_remove(&jobs->folder, id, &err)) {
        srv_store_remove(jobs->options.store, SRV_KIND_PATH, id);
        return true;
    }
    sp_log_with(SP_LOG_ERROR, SP_LOG_FIELDS({ "path", id }),
                "files of path %s stay until the next start: %s: %s", id, err.place, err.text);
    return false;
}

/* All whose records say that they are removed. With the mutex held, which is let go meanwhile. */
static void clear_gone(struct drawing *d) {
    struct srv_jobs *jobs = d->jobs;
    for (struct srv_path_job **at = &jobs->gone, *job = *at; job; job = *at) {
        if (job->unwritten > 0) {
            at = &job->next;
            continue;
        }
        *at = job->next;
        pthread_mutex_unlock(&jobs->mutex);
        bool is_clear = clear(d, job->id);
        pthread_mutex_lock(&jobs->mutex);
        if (is_clear && job->by) {
            srv_room_give(jobs, job, job->bytes);
            srv_room_release(jobs, job->by);
        }
        srv_job_unref(job);
        srv_jobs_unblock(jobs);
        at = &jobs->gone; /* there may be others */
    }
}

/* Until there is something to do, or a job to be tried again. With the mutex held. */
static void wait(struct srv_jobs *jobs) {
    double until_ms = INFINITY;
    for (const struct srv_path_job *job = jobs->list; job; job = job->next)
        until_ms = fmin(until_ms, ready_ms(job));
    if (isinf(until_ms)) {
        pthread_cond_wait(&jobs->wake, &jobs->mutex);
        return;
    }
    struct timespec until = srv_clock_at(until_ms);
    pthread_cond_timedwait(&jobs->wake, &jobs->mutex, &until);
}

/* Of a job that is not removed. */
static struct srv_path *read_path(struct srv_jobs *jobs, const char *id, struct sp_error *err) {
    proto_json *record = srv_record_read(jobs, id, err);
    struct srv_path *path = record ? srv_record_path(record, err) : NULL;
    proto_json_free(&record);
    if (!path && err->code == SP_ERR_FORMAT) /* it was valid before: see proto_json_parse() */
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a path");
    return path;
}

/* One step of a job. With the mutex held, which is let go meanwhile. */
static void step(struct drawing *d, struct srv_path_job *job) {
    struct srv_jobs *jobs = d->jobs;
    struct sp_error err;
    uint64_t generation = jobs->generation;
    if (d->job != job) {
        leave_job(d);
        d->job = job;
        job->refs++;
    }
    job->by->turn = ++jobs->turn;
    pthread_mutex_unlock(&jobs->mutex);
    if (!d->path && !(d->path = read_path(jobs, job->id, &err))) {
        if (!atomic_load(&job->is_removed)) /* else its record has gone, too */
            stop_job(d, generation, &err);
    } else if (job->done < job->output.frames) {
        draw_frame(d, generation);
    } else {
        finish_job(d, generation);
    }
    pthread_mutex_lock(&jobs->mutex);
    if (is_over(job))
        forget_video(d, job->id);
}

void *srv_jobs_main(void *user) {
    struct drawing d = { .jobs = user };
    struct srv_jobs *jobs = user;
    srv_be_nice("the thread for paths");
    d.encoder = jobs->encoder;
    pthread_mutex_lock(&jobs->mutex);
    while (!atomic_load(&jobs->stop)) {
        clear_gone(&d);
        struct srv_path_job *job = next_job(jobs);
        if (job)
            step(&d, job);
        else if (!atomic_load(&jobs->stop))
            wait(jobs);
        if (d.job && next_job(jobs) != d.job)
            leave_job(&d);
    }
    leave_job(&d);
    pthread_mutex_unlock(&jobs->mutex);
    while (d.videos)
        drop_video(&d.videos);
    return NULL;
}
