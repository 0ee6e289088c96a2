/* SPDX-License-Identifier: Apache-2.0
 *
 * Those who watch a job: each is told what holds now, and sleeps until that changes.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "paths/paths_private.h"

#define SILENCE_MS 15000.0 /* after which a comment keeps proxies from giving up */

/* The id of the event that tells what holds now: of two reasons there are two. */
static void event_id(const struct srv_path_job *job, char id[32]) {
    uint32_t hash = 2166136261; /* FNV-1a */
    for (const char *c = job->reason; *c; c++)
        hash = (hash ^ (uint8_t)*c) * 16777619;
    int n = snprintf(id, 32, "%s-%u", srv_job_state_name(job), job->done);
    if (job->reason[0])
        snprintf(id + n, 32 - (size_t)n, "-%08x", hash);
}

static bool is_over(const struct srv_path_job *job) {
    return job->state == SRV_JOB_DONE || job->state == SRV_JOB_FAILED ||
           atomic_load(&job->is_removed);
}

/* With the mutex held. */
static void wake(struct srv_watch *watch) {
    if (!watch->is_asleep)
        return;
    watch->is_asleep = false;
    watch->watcher.wake(watch->watcher.user);
}

void srv_jobs_tell(struct srv_jobs *jobs, const struct srv_path_job *job) {
    for (struct srv_watch *watch = jobs->watches; watch; watch = watch->next)
        if (watch->job == job)
            wake(watch);
}

void srv_jobs_close(struct srv_jobs *jobs) {
    pthread_mutex_lock(&jobs->mutex);
    atomic_store(&jobs->stop, true);
    for (struct srv_watch *watch = jobs->watches; watch; watch = watch->next)
        wake(watch);
    pthread_cond_broadcast(&jobs->wake);
    pthread_mutex_unlock(&jobs->mutex);
}

void srv_jobs_tick(struct srv_jobs *jobs, double now_ms) {
    pthread_mutex_lock(&jobs->mutex);
    for (struct srv_watch *watch = jobs->watches; watch; watch = watch->next)
        if (watch->is_asleep &&
            (now_ms - watch->told_ms >= SILENCE_MS || watch->watcher.is_gone(watch->watcher.user)))
            wake(watch);
    pthread_mutex_unlock(&jobs->mutex);
}

struct srv_watch *srv_jobs_watch(struct srv_jobs *jobs, const char *id, const char *after,
                                 const struct srv_watcher *watcher, bool *over,
                                 struct sp_error *err) {
    struct srv_watch *watch = calloc(1, sizeof *watch);
    *over = false;
    if (!watch) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory to watch a path");
        return NULL;
    }
    watch->jobs = jobs;
    watch->watcher = *watcher;
    watch->told_ms = srv_clock_ms();
    snprintf(watch->last, sizeof watch->last, "%s", after ? after : "");
    pthread_mutex_lock(&jobs->mutex);
    struct srv_path_job *job = jobs->list;
    while (job && strcmp(job->id, id) != 0)
        job = job->next;
    if (job) {
        char now[32];
        event_id(job, now);
        *over = is_over(job) && strcmp(now, watch->last) == 0;
    }
    if (job && !*over) {
        job->refs++;
        watch->job = job;
        watch->next = jobs->watches;
        jobs->watches = watch;
    }
    pthread_mutex_unlock(&jobs->mutex);
    if (watch->job)
        return watch;
    if (!*over)
        sp_fail(err, SP_ERR_NOT_FOUND, NULL, "there is no path '%.64s'", id);
    free(watch);
    return NULL;
}

void srv_watch_end(struct srv_watch **pointer) {
    struct srv_watch *watch = *pointer;
    *pointer = NULL;
    if (!watch)
        return;
    struct srv_jobs *jobs = watch->jobs;
    pthread_mutex_lock(&jobs->mutex);
    struct srv_watch **at = &jobs->watches;
    while (*at != watch)
        at = &(*at)->next;
    *at = watch->next;
    srv_job_unref(watch->job);
    pthread_mutex_unlock(&jobs->mutex);
    free(watch);
}

/* With the mutex held. */
static char *event_text(const struct srv_path_job *job, const char *id, size_t *size) {
    struct srv_job_note note;
    srv_job_note(job, &note);
    proto_json *json = srv_job_note_encode(&note);
    char *data = proto_json_to_text(json, NULL), *text = NULL;
    const char *name = atomic_load(&job->is_removed) ? "removed"
                       : is_over(job)                ? srv_job_state_name(job)
                                                     : "progress";
    int n = data ? asprintf(&text, "id: %s\nevent: %s\ndata: %s\n\n", id, name, data) : -1;
    *size = n < 0 ? 0 : (size_t)n;
    proto_json_free(&json);
    free(data);
    return n < 0 ? NULL : text;
}

enum srv_watched srv_watch_next(struct srv_watch *watch, char **text, size_t *size) {
    struct srv_jobs *jobs = watch->jobs;
    struct srv_path_job *job = watch->job;
    enum srv_watched result = SRV_WATCH_OVER;
    double now_ms = srv_clock_ms();
    char now[32];
    *text = NULL;
    pthread_mutex_lock(&jobs->mutex);
    event_id(job, now);
    if (atomic_load(&job->is_removed))
        snprintf(now, sizeof now, "removed");
    bool has_news = strcmp(now, watch->last) != 0;
    if (has_news)
        *text = event_text(job, now, size);
    else if (!is_over(job) && now_ms - watch->told_ms >= SILENCE_MS)
        *text = strdup(":\n\n"); /* a comment */
    if (*text && !has_news)
        *size = strlen(*text);
    if (*text) {
        memcpy(watch->last, now, sizeof watch->last);
        watch->told_ms = now_ms;
        result = SRV_WATCH_EVENT;
    } else if (has_news) {
        result = SRV_WATCH_FAILED;
    } else if (!is_over(job) && !atomic_load(&jobs->stop) &&
               !watch->watcher.is_gone(watch->watcher.user)) {
        watch->watcher.sleep(watch->watcher.user);
        watch->is_asleep = true;
        result = SRV_WATCH_SLEEPS;
    }
    pthread_mutex_unlock(&jobs->mutex);
    return result;
}
