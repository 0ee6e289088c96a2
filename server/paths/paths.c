/* SPDX-License-Identifier: Apache-2.0 */
#include "paths/paths.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "config/secret.h"
#include "config/tokens.h"
#include "paths/paths_private.h"
#include "sp/log.h"

void srv_job_file_name(const struct srv_path_output *output, uint32_t frame, char name[32]) {
    snprintf(name, 32, "%06u%s", frame,
             output->is_movie ? ".vp9" : sp_image_format_info(output->format)->extension);
}

/* Jobs. */

static struct srv_path_job *make_job(struct srv_jobs *jobs, const char *id) {
    struct srv_path_job *job = calloc(1, sizeof *job);
    if (!job)
        return NULL;
    atomic_init(&job->is_removed, false);
    job->jobs = jobs;
    job->refs = 1;
    snprintf(job->id, sizeof job->id, "%s", id);
    return job;
}

static struct srv_path_job *make_path_job(struct srv_jobs *jobs, const char *id, const char *owner,
                                          const struct srv_path *path,
                                          const struct srv_fingerprint *content) {
    struct srv_path_job *job = make_job(jobs, id);
    const struct sp_view *view = srv_path_key(path, 0);
    if (!job)
        return NULL;
    job->output = *srv_path_output(path);
    memcpy(job->size, view->size, sizeof job->size);
    memcpy(job->volume, view->volume, sizeof job->volume);
    job->content = *content;
    snprintf(job->owner, sizeof job->owner, "%s", owner);
    return job;
}

void srv_job_unref(struct srv_path_job *job) {
    if (--job->refs == 0)
        free(job);
}

const char *srv_job_state_name(const struct srv_path_job *job) {
    static const char *const names[] = { "waiting", "running", "done", "failed" };
    return names[job->state];
}

void srv_job_note(const struct srv_path_job *job, struct srv_job_note *note) {
    *note = (struct srv_job_note){ .state = srv_job_state_name(job),
                                   .size = { job->size[0], job->size[1] },
                                   .output = job->output,
                                   .done = job->done,
                                   .bytes = job->bytes };
    memcpy(note->id, job->id, sizeof note->id);
    memcpy(note->owner, job->owner, sizeof note->owner);
    memcpy(note->reason, job->reason, sizeof note->reason);
    memcpy(note->volume, job->volume, sizeof note->volume);
}

proto_json *srv_job_note_encode(const struct srv_job_note *note) {
    proto_json *json = proto_json_object(), *size = proto_json_array();
    bool ok = proto_json_set_string(json, "id", note->id);
    if (note->owner[0])
        ok = proto_json_set_string(json, "owner", note->owner) && ok;
    ok = proto_json_set_string(json, "state", note->state) && ok;
    if (note->reason[0])
        ok = proto_json_set_string(json, "reason", note->reason) && ok;
    ok = proto_json_set_string(json, "volume", note->volume) && ok;
    ok = proto_json_append_integer(size, note->size[0]) &&
         proto_json_append_integer(size, note->size[1]) && ok;
    ok = proto_json_set(json, "size", size) && ok;
    ok = proto_json_set_string(json, "format", srv_path_format(&note->output)) && ok;
    ok = proto_json_set_number(json, "fps", note->output.fps) && ok;
    ok = proto_json_set_integer(json, "frames", note->output.frames) && ok;
    ok = proto_json_set_integer(json, "done", note->done) && ok;
    ok = proto_json_set_integer(json, "bytes", (int64_t)note->bytes) && ok;
    if (!ok)
        proto_json_free(&json);
    return json;
}

struct srv_path_job **srv_job_find(struct srv_jobs *jobs, const char *id) {
    struct srv_path_job **at = &jobs->list;
    while (*at && strcmp((*at)->id, id) != 0)
        at = &(*at)->next;
    return at;
}

static void append(struct srv_jobs *jobs, struct srv_path_job *job) {
    struct srv_path_job **at = &jobs->list;
    while (*at)
        at = &(*at)->next;
    *at = job;
}

struct looking {
    struct srv_path_job *job;
    bool has_movie;
};

/* Is a file the job's? What was being written when the daemon was killed is not, nor are the
 * packets of a movie that is there. */
static bool is_of_job(void *user, const char *name) {
    const struct looking *l = user;
    char expected[32];
    if (l->has_movie)
        return strcmp(name, SRV_JOB_MOVIE) == 0;
    srv_job_file_name(&l->job->output, (uint32_t)strtoul(name, NULL, 10), expected);
    return strcmp(name, expected) == 0;
}

/* What the disk has of a job: its frames up to the first that is not there, or its movie. */
static void look_at_files(struct srv_jobs *jobs, struct srv_path_job *job) {
    uint64_t size;
    char name[32];
    struct looking looking = { job, job->output.is_movie && srv_folder_size(&jobs->folder, job->id,
                                                                            SRV_JOB_MOVIE, &size) };
    srv_folder_clean(&jobs->folder, job->id, is_of_job, &looking);
    if (looking.has_movie) {
        job->done = job->output.frames;
        srv_room_add(jobs, job, size);
        job->state = SRV_JOB_DONE;
        return;
    }
    for (; job->done < job->output.frames; job->done++) {
        srv_job_file_name(&job->output, job->done, name);
        if (!srv_folder_size(&jobs->folder, job->id, name, &size))
            break;
        srv_room_add(jobs, job, size);
    }
    if (!job->output.is_movie && job->done == job->output.frames)
        job->state = SRV_JOB_DONE;
}

/* A path whose removal was not finished: the thread does that. */
static bool restore_gone(struct srv_jobs *jobs, const char *id, struct sp_error *err) {
    struct srv_path_job *job = make_job(jobs, id);
    if (!job)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a path");
    atomic_store(&job->is_removed, true);
    job->next = jobs->gone;
    jobs->gone = job;
    return true;
}

static bool restore_path(struct srv_jobs *jobs, const char *id, const proto_json *record,
                         struct sp_error *err) {
    struct srv_fingerprint content;
    const char *text = proto_json_string(proto_json_get(record, "content"));
    if (!srv_fingerprint_decode(text, &content))
        return sp_fail(err, SP_ERR_FORMAT, "/content", "this is no path");
    struct srv_path *path = srv_record_path(record, err);
    const char *owner = proto_json_string(proto_json_get(record, "owner"));
    struct srv_path_job *job =
        path ? make_path_job(jobs, id, owner ? owner : "", path, &content) : NULL;
    const char *failed = proto_json_string(proto_json_get(record, "failed"));
    if (job && !(job->by = srv_room_enter(jobs, job->owner, err))) {
        srv_job_unref(job);
        job = NULL;
    } else if (job) {
        look_at_files(jobs, job);
        if (failed && job->state != SRV_JOB_DONE) {
            job->state = SRV_JOB_FAILED;
            snprintf(job->reason, sizeof job->reason, "%s", failed);
        }
        append(jobs, job);
    } else if (path) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a path");
    }
    srv_path_free(&path);
    return job != NULL;
}

static bool restore(struct srv_jobs *jobs, const char *id, struct sp_error *err) {
    proto_json *record = srv_record_read(jobs, id, err);
    bool ok = record && (srv_record_is_removed(record) ? restore_gone(jobs, id, err)
                                                       : restore_path(jobs, id, record, err));
    proto_json_free(&record);
    return ok;
}

/* `user`: ids one behind the other. */
static bool is_among(void *user, const char *id) {
    const char *at = user;
    while (*at && strcmp(at, id) != 0)
        at += strlen(at) + 1;
    return *at != 0;
}

/* Files that no record knows, because the database is another one. */
static void look_at_strays(struct srv_jobs *jobs, char *ids) {
    uint64_t bytes;
    unsigned count = srv_folder_strays(&jobs->folder, is_among, ids, &bytes);
    jobs->bytes += bytes;
    if (count > 0)
        sp_log(SP_LOG_WARN,
               "%u folders in %s, of %llu bytes, belong to no camera path that is known; they "
               "stay, and count for --path-bytes: remove them, or bring back the database that had "
               "them",
               count, jobs->folder.root, (unsigned long long)bytes);
}

static bool restore_all(struct srv_jobs *jobs, struct sp_error *err) {
    char *ids = srv_store_ids(jobs->options.store, SRV_KIND_PATH);
    if (!ids)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for what was kept");
    for (const char *id = ids; *id; id += strlen(id) + 1) {
        struct sp_error why;
        if (restore(jobs, id, &why))
            continue;
        sp_log_with(SP_LOG_ERROR, SP_LOG_FIELDS({ "path", id }),
                    "the kept path %s cannot come back: %s%s%s", id, why.place,
                    why.place[0] ? ": " : "", why.text);
    }
    look_at_strays(jobs, ids);
    free(ids);
    return true;
}

struct srv_jobs *srv_jobs_create(const struct srv_jobs_options *options, struct sp_error *err) {
    struct srv_jobs *jobs = calloc(1, sizeof *jobs);
    if (!jobs) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for paths");
        return NULL;
    }
    jobs->options = *options;
    atomic_init(&jobs->stop, false);
    pthread_mutex_init(&jobs->records, NULL);
    pthread_mutex_init(&jobs->mutex, NULL);
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&jobs->wake, &monotonic);
    pthread_condattr_destroy(&monotonic);
    if (!(jobs->encoder = sp_encoder_create(err)) ||
        !srv_folder_open(&jobs->folder, options->state, err) || !restore_all(jobs, err))
        srv_jobs_destroy(&jobs);
    return jobs;
}

bool srv_jobs_start(struct srv_jobs *jobs, struct sp_error *err) {
    int failed = pthread_create(&jobs->thread, NULL, srv_jobs_main, jobs);
    jobs->is_running = failed == 0;
    return !failed ||
           sp_fail(err, SP_ERR_IO, NULL, "cannot start the thread for paths: %s", strerror(failed));
}

static void drop(struct srv_jobs *jobs, struct srv_path_job *list) {
    while (list) {
        struct srv_path_job *next = list->next;
        if (jobs->folder.is_private)
            srv_folder_remove(&jobs->folder, list->id, NULL);
        srv_job_unref(list);
        list = next;
    }
}

void srv_jobs_destroy(struct srv_jobs **pointer) {
    struct srv_jobs *jobs = *pointer;
    *pointer = NULL;
    if (!jobs)
        return;
    srv_jobs_close(jobs);
    if (jobs->is_running)
        pthread_join(jobs->thread, NULL);
    drop(jobs, jobs->list);
    drop(jobs, jobs->gone);
    while (jobs->owners) {
        struct srv_path_owner *owner = jobs->owners;
        jobs->owners = owner->next;
        free(owner);
    }
    srv_folder_close(&jobs->folder);
    sp_encoder_destroy(&jobs->encoder);
    pthread_cond_destroy(&jobs->wake);
    pthread_mutex_destroy(&jobs->mutex);
    pthread_mutex_destroy(&jobs->records);
    free(jobs);
}

void srv_jobs_unblock(struct srv_jobs *jobs) {
    jobs->generation++;
    for (struct srv_path_job *job = jobs->list; job; job = job->next)
        job->blocked_ms = 0;
    pthread_cond_broadcast(&jobs->wake);
}

void srv_jobs_wake(struct srv_jobs *jobs) {
    pthread_mutex_lock(&jobs->mutex);
    srv_jobs_unblock(jobs);
    pthread_mutex_unlock(&jobs->mutex);
}

void srv_jobs_unloaded(struct srv_jobs *jobs, const char *volume) {
    pthread_mutex_lock(&jobs->mutex);
    for (struct srv_path_job *job = jobs->list; job; job = job->next)
        if (strcmp(job->volume, volume) == 0)
            job->is_unloaded = true;
    srv_jobs_unblock(jobs);
    pthread_mutex_unlock(&jobs->mutex);
}

/* Requests. */

static const char *const members[] = { "view",   "keyframes", "frames", "fps",
                                       "format", "quality",   "size",   NULL };

/* Is there ever room for its encoder? */
static bool check_movie(struct srv_jobs *jobs, const struct srv_path *path, struct sp_error *err) {
    const uint32_t *size = srv_path_key(path, 0)->size;
    uint64_t px = (uint64_t)size[0] * size[1], max = jobs->options.video_px;
    return !srv_path_output(path)->is_movie || px <= max ||
           sp_fail(err, SP_ERR_INVALID, "/size",
                   "a movie of %u x %u has %llu px and --video-pixels allows %llu", size[0],
                   size[1], (unsigned long long)px, (unsigned long long)max);
}

/* Can all that is between be drawn? Names, which decide that, are those of the keys. */
static bool check_support(struct srv_jobs *jobs, const struct srv_path *path,
                          struct sp_error *err) {
    struct sp_error why;
    const struct sp_view *view;
    for (unsigned i = 0; (view = srv_path_key(path, i)); i++) {
        if (srv_render_pool_supports(jobs->options.render_pool, view, &why))
            continue;
        *err = why;
        if (i == 0)
            snprintf(err->place, sizeof err->place, "/view%.200s", why.place);
        else
            snprintf(err->place, sizeof err->place, "/keyframes/%u/view%.200s", i - 1, why.place);
        return false;
    }
    return true;
}

/* With the mutex held: the record has changed, and flush() follows without it. */
static void begin_write(struct srv_path_job *job) {
    job->unwritten++;
    job->refs++;
}

/* Written or not: what the disk does not take holds in memory. */
static void on_written(void *user, bool durable) {
    struct srv_path_job *job = user;
    struct srv_jobs *jobs = job->jobs;
    (void)durable;
    pthread_mutex_lock(&jobs->mutex);
    job->unwritten--;
    srv_job_unref(job);
    pthread_cond_broadcast(&jobs->wake);
    pthread_mutex_unlock(&jobs->mutex);
}

static void flush(struct srv_path_job *job) {
    srv_store_flush(job->jobs->options.store, on_written, job);
}

/* Keeps the job and its record. Room for it was taken. */
static proto_json *keep_job(struct srv_jobs *jobs, struct srv_path_job *job,
                            const struct srv_path *path, const proto_json *body,
                            const struct sp_view *defaults, struct sp_error *err) {
    struct srv_job_note note;
    srv_job_note(job, &note);
    proto_json *json = srv_job_note_encode(&note);
    bool ok = json || sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a path");
    ok = ok && srv_record_put(jobs, job, path, body, defaults, err);
    pthread_mutex_lock(&jobs->mutex);
    if (ok) {
        append(jobs, job);
        begin_write(job);
    } else {
        srv_room_leave(jobs, job->by);
        srv_room_release(jobs, job->by);
    }
    pthread_mutex_unlock(&jobs->mutex);
    if (ok) {
        flush(job);
    } else {
        free(job);
        proto_json_free(&json);
    }
    return json;
}

proto_json *srv_jobs_add(struct srv_jobs *jobs, const proto_json *body,
                         const struct srv_job_view *view, const char *owner,
                         char id[SRV_JOB_ID_BYTES], bool *is_full, struct sp_error *err) {
    struct srv_path_job *job = NULL;
    proto_json *json = NULL;
    *is_full = false;
    struct srv_path *path =
        proto_json_only(body, members, err)
            ? srv_path_read(body, &view->view, &view->defaults, jobs->options.frames_max, err)
            : NULL;
    bool ok = path && check_movie(jobs, path, err) && check_support(jobs, path, err) &&
              srv_secret_hex(id, SRV_JOB_ID_BYTES - 1, err);
    if (ok && !(job = make_path_job(jobs, id, owner, path, srv_volume_fingerprint(view->volume))))
        ok = sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a path");
    if (ok && (job->by = srv_room_request(jobs, owner, is_full, err)))
        json = keep_job(jobs, job, path, body, &view->defaults, err);
    else
        free(job);
    srv_path_free(&path);
    return json;
}

bool srv_job_missing(const char *id, struct sp_error *err) {
    return sp_fail(err, SP_ERR_NOT_FOUND, NULL, "there is no path '%.64s'", id);
}

proto_json *srv_jobs_get(struct srv_jobs *jobs, const char *id, struct sp_error *err) {
    struct srv_job_note note;
    pthread_mutex_lock(&jobs->mutex);
    struct srv_path_job *job = *srv_job_find(jobs, id);
    if (job)
        srv_job_note(job, &note);
    pthread_mutex_unlock(&jobs->mutex);
    proto_json *json = job ? srv_job_note_encode(&note) : NULL;
    if (!job)
        srv_job_missing(id, err);
    else if (!json)
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a path");
    return json;
}

void srv_jobs_list(struct srv_jobs *jobs, const char *owner, struct srv_page *page) {
    pthread_mutex_lock(&jobs->mutex);
    for (struct srv_path_job *job = jobs->list; job; job = job->next) {
        bool is_shown = !owner || strcmp(job->owner, owner) == 0;
        struct srv_job_note *note = is_shown ? srv_page_slot(page, job->id) : NULL;
        if (note)
            srv_job_note(job, note);
    }
    pthread_mutex_unlock(&jobs->mutex);
}

/* Nobody finds it from here on. */
static void give_up(struct srv_jobs *jobs, struct srv_path_job *job) {
    pthread_mutex_lock(&jobs->mutex);
    *srv_job_find(jobs, job->id) = job->next;
    job->next = jobs->gone;
    jobs->gone = job;
    srv_room_leave(jobs, job->by);
    atomic_store(&job->is_removed, true);
    begin_write(job);
    srv_jobs_tell(jobs, job);
    pthread_cond_broadcast(&jobs->wake);
    pthread_mutex_unlock(&jobs->mutex);
}

bool srv_jobs_remove(struct srv_jobs *jobs, const char *id, struct sp_error *err) {
    pthread_mutex_lock(&jobs->records); /* who holds it alone takes jobs out */
    pthread_mutex_lock(&jobs->mutex);
    struct srv_path_job *job = *srv_job_find(jobs, id);
    pthread_mutex_unlock(&jobs->mutex);
    bool ok = job ? srv_record_remove(jobs, id, err) : srv_job_missing(id, err);
    if (ok)
        give_up(jobs, job);
    pthread_mutex_unlock(&jobs->records);
    if (ok)
        flush(job);
    return ok;
}

void srv_jobs_numbers(struct srv_jobs *jobs, struct srv_jobs_numbers *numbers) {
    pthread_mutex_lock(&jobs->mutex);
    *numbers = (struct srv_jobs_numbers){ .jobs = jobs->count, .bytes = jobs->bytes };
    for (struct srv_path_job *job = jobs->list; job; job = job->next) {
        numbers->unfinished += job->state == SRV_JOB_WAITING || job->state == SRV_JOB_RUNNING;
        numbers->waiting += job->state == SRV_JOB_WAITING && job->reason[0] != 0;
    }
    pthread_mutex_unlock(&jobs->mutex);
}
