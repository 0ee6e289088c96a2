/* SPDX-License-Identifier: Apache-2.0
 *
 * The thread of the camera paths: renders one frame after the other, encodes it and writes its
 * file.
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
#define PAUSE_MS 1000.0 /* before the first retry; doubles with each further one */
#define PAUSE_MAX_MS 60000.0
#define KEY_SECONDS 2.0 /* between key frames of a movie; players seek to these */

struct encoder { /* the encoder of one movie; it lives between frames */
    struct encoder *next;
    char id[SRV_PATH_ID_BYTES];
    struct sp_video *video;
    uint64_t px;
    struct sp_budget *budget; /* NULL = no limit */
    uint64_t bytes;           /* taken from it */
};

struct drawing { /* the state of the thread */
    struct srv_paths *paths;
    struct sp_encoder *encoder;
    struct encoder *videos;          /* most recently used first */
    struct srv_path *path;           /* the current path; NULL = none */
    struct srv_keyframes *keyframes; /* of the path; NULL = not yet read */
};

static void leave_path(struct drawing *d) {
    srv_keyframes_free(&d->keyframes);
    if (d->path)
        srv_path_unref(d->path);
    d->path = NULL;
}

static void drop_video(struct encoder **at) {
    struct encoder *encoder = *at;
    *at = encoder->next;
    sp_video_destroy(&encoder->video);
    sp_budget_release(encoder->budget, SP_BUDGET_ENCODERS, encoder->bytes);
    free(encoder);
}

static struct encoder **find_video(struct drawing *d, const char *id) {
    struct encoder **at = &d->videos;
    while (*at && strcmp((*at)->id, id) != 0)
        at = &(*at)->next;
    return at;
}

/* Frees the encoder of a path that is done or must wait. */
static void drop_video_of(struct drawing *d, const char *id) {
    struct encoder **at = find_video(d, id);
    if (*at)
        drop_video(at);
}

/* Frees the least recently used encoders until `px` more pixels fit into --video-pixels. The next
 * frame of their movies becomes a key frame, which a movie may have anywhere. */
static void evict_videos(struct drawing *d, uint64_t px) {
    struct encoder **at = &d->videos;
    while (*at && px + (*at)->px <= d->paths->options.video_px) {
        px += (*at)->px;
        at = &(*at)->next;
    }
    while (*at)
        drop_video(at);
}

/* Acquires the memory of an encoder from the budget; frees other movies' encoders if it does not
 * suffice. */
static bool acquire_memory(struct drawing *d, uint64_t bytes, struct sp_error *err) {
    struct sp_budget *budget = d->paths->options.budget;
    bool is_acquired = sp_budget_acquire(budget, SP_BUDGET_ENCODERS, bytes);
    if (!is_acquired && d->videos) {
        while (d->videos)
            drop_video(&d->videos);
        is_acquired = sp_budget_acquire(budget, SP_BUDGET_ENCODERS, bytes);
    }
    return is_acquired || sp_budget_fail(budget, "encoder", bytes, err);
}

/* Returns the encoder of the path's movie, creating it if necessary. */
static struct sp_video *find_or_create_video(struct drawing *d, struct sp_error *err) {
    struct encoder **at = find_video(d, d->path->id), *encoder = *at;
    if (encoder) {
        *at = encoder->next;
    } else {
        uint64_t px = (uint64_t)d->path->size[0] * d->path->size[1];
        px = px < SRV_VIDEO_PX_MIN ? SRV_VIDEO_PX_MIN : px;
        evict_videos(d, px);
        const uint64_t bytes = sp_video_bytes(SP_VIDEO_VP9, d->path->size);
        if (!acquire_memory(d, bytes, err))
            return NULL;
        encoder = calloc(1, sizeof *encoder);
        if (!encoder || !(encoder->video = sp_video_create(SP_VIDEO_VP9, VIDEO_THREADS, err))) {
            if (!encoder)
                sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while creating a video encoder");
            sp_budget_release(d->paths->options.budget, SP_BUDGET_ENCODERS, bytes);
            free(encoder);
            return NULL;
        }
        encoder->px = px;
        encoder->budget = d->paths->options.budget;
        encoder->bytes = bytes;
        memcpy(encoder->id, d->path->id, sizeof encoder->id);
    }
    encoder->next = d->videos;
    d->videos = encoder;
    return encoder->video;
}

/* The caller of set_state() holds the mutex. */

static void set_state(struct srv_paths *paths, struct srv_path *path, enum srv_path_state state,
                      const char *reason) {
    bool same = path->state == state && strcmp(path->reason, reason) == 0;
    path->state = state;
    snprintf(path->reason, sizeof path->reason, "%s", reason);
    if (!same)
        srv_paths_notify(paths, path);
}

static void fail_path(struct drawing *d, const struct sp_error *err) {
    struct srv_paths *paths = d->paths;
    char reason[SP_ERROR_TEXT];
    snprintf(reason, sizeof reason, "frame %u: %.48s%s%.280s", d->path->done, err->place,
             err->place[0] ? ": " : "", err->text);
    sp_log_with(SP_LOG_ERROR, SP_LOG_FIELDS({ "path", d->path->id }), "path %s failed at %s",
                d->path->id, reason);
    pthread_mutex_lock(&paths->records);
    if (!atomic_load(&d->path->is_removed)) /* otherwise its record is removed */
        srv_path_record_fail(paths, d->path->id, reason);
    pthread_mutex_unlock(&paths->records);
    srv_metrics_add(paths->options.metrics, SRV_COUNT_PATH_FAILED, 1);
    pthread_mutex_lock(&paths->mutex);
    set_state(paths, d->path, SRV_PATH_FAILED, reason);
    pthread_mutex_unlock(&paths->mutex);
}

/* True if the error may go away by itself: a full disk, no memory, a quota in use. *missing is the
 * counter for it. */
static bool is_temporary(enum sp_code code, enum srv_counter *missing) {
    switch (code) {
    case SP_ERR_IO:
        *missing = SRV_COUNT_PATH_WAIT_DISK;
        return true;
    case SP_ERR_MEMORY:
        *missing = SRV_COUNT_PATH_WAIT_MEMORY;
        return true;
    case SP_ERR_BUDGET:
    case SP_ERR_FRAME_BUDGET:
    case SP_ERR_QUOTA:
        *missing = SRV_COUNT_PATH_WAIT_LIMIT;
        return true;
    case SP_ERR_VOLUME_UNKNOWN: /* of a layer */
    case SP_ERR_NOT_READY:
        *missing = SRV_COUNT_PATH_WAIT_VOLUME;
        return true;
    case SP_ERR_BACKEND:
    case SP_ERR_CRASHED:
        *missing = SRV_COUNT_PATH_WAIT_BACKEND;
        return true;
    case SP_OK:
    case SP_ERR_INVALID:
    case SP_ERR_UNSUPPORTED:
    case SP_ERR_FORMAT:
    case SP_ERR_DENIED:
    case SP_ERR_CANCELLED:
    case SP_ERR_TIMEOUT:
    case SP_ERR_NOT_FOUND:
    case SP_ERR_VOLUME_FAILED:
    case SP_ERR_TOO_LARGE:
        break;
    }
    return false;
}

/* Marks the path as waiting until something changes after `generation`, or until until_ms. */
static void block(struct drawing *d, uint64_t generation, double until_ms, enum srv_counter missing,
                  const char *reason) {
    struct srv_paths *paths = d->paths;
    srv_metrics_add(paths->options.metrics, missing, 1);
    drop_video_of(d, d->path->id); /* it may have encoded a frame that is not on the disk */
    pthread_mutex_lock(&paths->mutex);
    d->path->blocked_ms = paths->generation == generation ? until_ms : 0;
    set_state(paths, d->path, SRV_PATH_WAITING, reason);
    pthread_mutex_unlock(&paths->mutex);
}

/* Handles an error: a permanent one fails the path, a temporary one is retried after a pause that
 * doubles each time. */
static void stop_path(struct drawing *d, uint64_t generation, const struct sp_error *err) {
    struct srv_path *path = d->path;
    char reason[SP_ERROR_TEXT];
    const char *slash = strrchr(err->place, '/');
    enum srv_counter missing;
    if (err->code == SP_ERR_CANCELLED) /* the path was removed, or the daemon stops */
        return;
    if (!is_temporary(err->code, &missing)) {
        fail_path(d, err);
        return;
    }
    snprintf(reason, sizeof reason, "%.100s%s%.280s", err->place, err->place[0] ? ": " : "",
             err->text);
    if (path->pause_ms == 0)
        sp_log_with(SP_LOG_WARN, SP_LOG_FIELDS({ "path", path->id }),
                    "path %s waits at frame %u: %s", path->id, path->done, reason);
    if (err->code == SP_ERR_IO) /* clients must not learn the folder */
        snprintf(reason, sizeof reason, "%.100s: %.280s", slash ? slash + 1 : err->place,
                 err->text);
    path->pause_ms = fmin(fmax(2 * path->pause_ms, PAUSE_MS), PAUSE_MAX_MS);
    block(d, generation, srv_clock_ms() + path->pause_ms, missing, reason);
}

/* Rendering a frame. */

struct answer {
    struct srv_paths *paths;
    struct srv_path *path;
    bool is_there, ok;
    struct sp_frame *frame;
    double drawn_ms;
    struct sp_error err;
};

static void on_done(void *user, const struct srv_snapshot_result *result) {
    struct answer *answer = user;
    struct srv_paths *paths = answer->paths;
    pthread_mutex_lock(&paths->mutex);
    answer->ok = result->ok;
    answer->drawn_ms = result->drawn_ms;
    if (result->ok)
        answer->frame = sp_frame_ref(result->frame);
    else
        answer->err = result->err;
    answer->is_there = true; /* the waiter may free `answer` once the mutex is released */
    pthread_cond_broadcast(&paths->wake);
    pthread_mutex_unlock(&paths->mutex);
}

static bool is_cancelled(void *user) {
    const struct answer *answer = user;
    return atomic_load(&answer->path->is_removed) || atomic_load(&answer->paths->stop);
}

/* Renders one view; takes over the reference to the volume. */
static struct sp_frame *render(struct drawing *d, const struct sp_view *view,
                               struct srv_volume *volume, struct sp_error *err) {
    struct answer answer = { .paths = d->paths, .path = d->path };
    struct srv_snapshot still = { .view = *view,
                                  .volume = volume,
                                  .format = d->path->output.format,
                                  .background = true,
                                  .expected_ms = d->path->frame_ms,
                                  .wants_frame = true,
                                  .done = on_done,
                                  .is_gone = is_cancelled,
                                  .user = &answer };
    if (d->path->output.is_movie)
        still.format = SP_IMAGE_PNG;
    snprintf(still.owner, sizeof still.owner, "%s", d->path->owner);
    if (!srv_snapshot_queue_submit(srv_render_pool_snapshots(d->paths->options.render_pool), &still,
                                   err))
        return NULL;
    pthread_mutex_lock(&d->paths->mutex);
    while (!answer.is_there)
        pthread_cond_wait(&d->paths->wake, &d->paths->mutex);
    pthread_mutex_unlock(&d->paths->mutex);
    if (!answer.ok && err)
        *err = answer.err;
    if (answer.drawn_ms > 0)
        d->path->frame_ms = answer.drawn_ms;
    return answer.frame;
}

/* Writes the subject of a quota error: "frame 7 has". */
static const char *frame_has(const struct srv_path *path, char text[32]) {
    snprintf(text, 32, "frame %u has", path->done);
    return text;
}

static void give_back_bytes(struct drawing *d, uint64_t bytes) {
    pthread_mutex_lock(&d->paths->mutex);
    srv_path_quota_release(d->paths, d->path, bytes);
    pthread_mutex_unlock(&d->paths->mutex);
}

/* Encodes the frame and writes its file. */
static bool encode_frame(struct drawing *d, const struct sp_frame *frame, struct sp_error *err) {
    const struct srv_path_output *output = &d->path->output;
    struct sp_video_packet packet = { .size = 0 };
    const uint8_t *image = NULL;
    uint8_t head = SRV_PACKET_DELTA;
    struct sp_video *video = output->is_movie ? find_or_create_video(d, err) : NULL;
    if (output->is_movie && !video)
        return false;
    bool is_key = d->path->done % (uint32_t)(KEY_SECONDS * output->fps) == 0;
    bool ok = output->is_movie
                  ? sp_video_encode(video, frame, output->quality, is_key, &packet, err)
                  : sp_encode(d->encoder, frame, output->format, output->quality, &image,
                              &packet.size, err);
    if (!ok)
        return false;
    if (packet.is_key)
        head = SRV_PACKET_KEY;
    uint64_t bytes = packet.size + output->is_movie + SRV_SEAL_BYTES;
    char name[32], what[32];
    d->path->wants = bytes;
    if (!srv_path_quota_acquire(d->paths, d->path, bytes, frame_has(d->path, what), err))
        return false;
    srv_path_file_name(output, d->path->done, name);
    ok = srv_folder_write(&d->paths->folder, d->path->id, name, &head, output->is_movie,
                          output->is_movie ? packet.bytes : image, packet.size, err);
    if (!ok)
        give_back_bytes(d, bytes);
    return ok;
}

/* Encodes a frame with memory for the encoder of an image; the encoder of a movie already has its
 * own. */
static bool write_frame(struct drawing *d, const struct sp_frame *frame, struct sp_error *err) {
    const struct srv_path_output *output = &d->path->output;
    const uint32_t size[2] = { frame->width, frame->height };
    const uint64_t bytes = output->is_movie ? 0 : sp_encode_bytes(output->format, size);
    if (!acquire_memory(d, bytes, err))
        return false;
    const bool ok = encode_frame(d, frame, err);
    sp_encoder_trim(d->encoder);
    sp_budget_release(d->paths->options.budget, SP_BUDGET_ENCODERS, bytes);
    return ok;
}

static void count_frame(struct drawing *d) {
    struct srv_paths *paths = d->paths;
    srv_metrics_add(paths->options.metrics, SRV_COUNT_PATH_FRAMES, 1);
    pthread_mutex_lock(&paths->mutex);
    d->path->done++;
    d->path->wants = 0;
    d->path->pause_ms = 0;
    d->path->state = SRV_PATH_RUNNING;
    d->path->reason[0] = 0;
    srv_paths_notify(paths, d->path);
    pthread_mutex_unlock(&paths->mutex);
}

/* Acquires the path's volume. SP_ERR_INVALID = the path can never have it again. */
static struct srv_volume *acquire(struct drawing *d, struct sp_error *err) {
    struct srv_catalog *catalog = d->paths->options.catalog;
    const struct srv_path *path = d->path;
    struct sp_error why = { .code = SP_OK };
    struct srv_volume *volume = srv_catalog_acquire(catalog, path->volume, &why);
    pthread_mutex_lock(&d->paths->mutex);
    bool is_unloaded = path->is_unloaded;
    pthread_mutex_unlock(&d->paths->mutex);
    bool is_other =
        volume && !srv_fingerprint_equal(srv_volume_fingerprint(volume), &path->content);
    if (volume && !is_unloaded && !is_other)
        return volume;
    if (volume)
        srv_catalog_release(catalog, volume);
    if (is_unloaded)
        sp_fail(err, SP_ERR_INVALID, NULL, "the volume '%s' was unloaded", path->volume);
    else if (why.code == SP_ERR_VOLUME_UNKNOWN)
        sp_fail(err, why.code, NULL,
                "there is no volume '%s'; load it under this id, or delete the path", path->volume);
    else if (!volume)
        *err = why;
    else
        sp_fail(err, SP_ERR_INVALID, NULL,
                "the volume '%s' is not the one that the path was created for: its file was "
                "replaced, or another volume has its name",
                path->volume);
    return NULL;
}

static void draw_frame(struct drawing *d, uint64_t generation) {
    struct sp_error err = { .code = SP_OK };
    struct sp_view view;
    char what[32];
    bool has_bytes =
        srv_path_quota_has(d->paths, d->path, d->path->wants, frame_has(d->path, what), &err);
    struct srv_volume *volume = has_bytes ? acquire(d, &err) : NULL;
    if (!volume) {
        /* The volume is loading, failed to load or is unknown: wait until a volume changes. */
        if (err.code == SP_ERR_NOT_READY || err.code == SP_ERR_VOLUME_FAILED ||
            err.code == SP_ERR_VOLUME_UNKNOWN)
            block(d, generation, INFINITY, SRV_COUNT_PATH_WAIT_VOLUME, err.text);
        else
            stop_path(d, generation, &err);
        return;
    }
    pthread_mutex_lock(&d->paths->mutex);
    if (d->path->pause_ms == 0) /* otherwise it stays "waiting" until this frame is done */
        set_state(d->paths, d->path, SRV_PATH_RUNNING, "");
    pthread_mutex_unlock(&d->paths->mutex);
    struct sp_frame *frame = NULL;
    if (srv_keyframes_view(d->keyframes, d->path->done, &view, &err))
        frame = render(d, &view, volume, &err);
    else
        srv_catalog_release(d->paths->options.catalog, volume);
    bool ok = frame && write_frame(d, frame, &err);
    sp_frame_unref(&frame);
    if (ok)
        count_frame(d);
    else
        stop_path(d, generation, &err);
}

/* Writes the movie from the packets. Until it is complete, both count towards the quotas. */
static bool make_movie(struct drawing *d, struct sp_error *err) {
    struct srv_paths *paths = d->paths;
    struct srv_path *path = d->path;
    uint64_t bytes, reserved = srv_movie_bytes_max(path->bytes, path->output.frames);
    char name[32];
    if (!srv_path_quota_acquire(paths, path, reserved, "the movie up to", err))
        return false;
    if (!srv_movie_write(&paths->folder, path->id, SRV_PATH_MOVIE_NAME, &path->output, path->size,
                         &bytes, err)) {
        give_back_bytes(d, reserved);
        return false;
    }
    for (uint32_t i = 0; i < path->output.frames; i++) {
        srv_path_file_name(&path->output, i, name);
        srv_folder_remove_file(&paths->folder, path->id, name);
    }
    give_back_bytes(d, path->bytes - bytes);
    return true;
}

/* Called when all frames are on the disk. */
static void finish_path(struct drawing *d, uint64_t generation) {
    struct srv_paths *paths = d->paths;
    struct srv_path *path = d->path;
    struct sp_error err;
    if (path->output.is_movie && !make_movie(d, &err)) {
        stop_path(d, generation, &err);
        return;
    }
    pthread_mutex_lock(&paths->mutex);
    set_state(paths, path, SRV_PATH_DONE, "");
    if (path->output.is_movie) /* the movie is smaller than its packets: other paths may continue */
        srv_paths_unblock(paths);
    pthread_mutex_unlock(&paths->mutex);
    sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "path", path->id }),
                "path %s finished: %u frames, %llu bytes", path->id, path->output.frames,
                (unsigned long long)path->bytes);
}

static bool is_over(const struct srv_path *path) {
    return path->state == SRV_PATH_DONE || path->state == SRV_PATH_FAILED;
}

/* Returns the time when the path can continue; INFINITY = not before something changes. */
static double ready_ms(const struct srv_path *path) {
    return is_over(path) || path->unwritten > 0 ? INFINITY : path->blocked_ms;
}

/* Returns the oldest path that can continue of the owner whose turn it is; NULL = none. The caller
 * holds the mutex. */
static struct srv_path *next_path(struct srv_paths *paths) {
    struct srv_path *next = NULL;
    uint64_t first = UINT64_MAX;
    double now_ms = srv_clock_ms();
    for (struct srv_path *path = paths->list; path; path = path->next) {
        if (ready_ms(path) > now_ms)
            continue;
        if (path->by->last_served < first) {
            first = path->by->last_served;
            next = path;
        }
    }
    return next;
}

/* Deletes the files of a removed path, then its record. The caller does not hold the mutex. */
static bool clear(struct drawing *d, const char *id) {
    struct srv_paths *paths = d->paths;
    struct sp_error err;
    drop_video_of(d, id);
    if (srv_folder_remove(&paths->folder, id, &err)) {
        srv_store_remove(paths->options.store, SRV_KIND_PATH, id);
        return true;
    }
    sp_log_with(SP_LOG_ERROR, SP_LOG_FIELDS({ "path", id }),
                "cannot delete the files of path %s; trying again at the next start: %s: %s", id,
                err.place, err.text);
    return false;
}

/* Deletes the files of all removed paths whose records say so on the disk. The caller holds the
 * mutex, which is released in between. */
static void clear_gone(struct drawing *d) {
    struct srv_paths *paths = d->paths;
    for (struct srv_path **at = &paths->gone, *path = *at; path; path = *at) {
        if (path->unwritten > 0) {
            at = &path->next;
            continue;
        }
        *at = path->next;
        pthread_mutex_unlock(&paths->mutex);
        bool is_clear = clear(d, path->id);
        pthread_mutex_lock(&paths->mutex);
        if (is_clear && path->by) {
            srv_path_quota_release(paths, path, path->bytes);
            srv_path_quota_release_owner(paths, path->by);
        }
        srv_path_unref(path);
        srv_paths_unblock(paths);
        at = &paths->gone; /* the list may have changed */
    }
}

/* Waits until there is something to do or a retry is due. The caller holds the mutex. */
static void wait(struct srv_paths *paths) {
    double until_ms = INFINITY;
    for (const struct srv_path *path = paths->list; path; path = path->next)
        until_ms = fmin(until_ms, ready_ms(path));
    if (isinf(until_ms)) {
        pthread_cond_wait(&paths->wake, &paths->mutex);
        return;
    }
    struct timespec until = srv_clock_at(until_ms);
    pthread_cond_timedwait(&paths->wake, &paths->mutex, &until);
}

/* Reads the keyframes of the path from its record. */
static struct srv_keyframes *read_keyframes(struct srv_paths *paths, const char *id,
                                            struct sp_error *err) {
    proto_json *record = srv_path_record_read(paths, id, err);
    struct srv_keyframes *keyframes = record ? srv_path_record_keyframes(record, err) : NULL;
    proto_json_free(&record);
    if (!keyframes && err->code == SP_ERR_FORMAT) /* the record was valid, so parsing failed for
                                                     want of memory: see proto_json_parse() */
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while reading a camera path");
    return keyframes;
}

/* Does one step of a path. The caller holds the mutex, which is released in between. */
static void step(struct drawing *d, struct srv_path *path) {
    struct srv_paths *paths = d->paths;
    struct sp_error err;
    uint64_t generation = paths->generation;
    if (d->path != path) {
        leave_path(d);
        d->path = path;
        path->refs++;
    }
    path->by->last_served = ++paths->served;
    pthread_mutex_unlock(&paths->mutex);
    if (!d->keyframes && !(d->keyframes = read_keyframes(paths, path->id, &err))) {
        if (!atomic_load(&path->is_removed)) /* otherwise its record was also removed */
            stop_path(d, generation, &err);
    } else if (path->done < path->output.frames) {
        draw_frame(d, generation);
    } else {
        finish_path(d, generation);
    }
    pthread_mutex_lock(&paths->mutex);
    if (is_over(path))
        drop_video_of(d, path->id);
}

void *srv_paths_main(void *user) {
    struct drawing d = { .paths = user };
    struct srv_paths *paths = user;
    srv_background_thread_enter("the thread for camera paths", SRV_NICE_BACKGROUND);
    d.encoder = paths->encoder;
    pthread_mutex_lock(&paths->mutex);
    while (!atomic_load(&paths->stop)) {
        clear_gone(&d);
        struct srv_path *path = next_path(paths);
        if (path)
            step(&d, path);
        else if (!atomic_load(&paths->stop))
            wait(paths);
        if (d.path && next_path(paths) != d.path)
            leave_path(&d);
    }
    leave_path(&d);
    pthread_mutex_unlock(&paths->mutex);
    while (d.videos)
        drop_video(&d.videos);
    return NULL;
}
