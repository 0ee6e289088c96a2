/* SPDX-License-Identifier: Apache-2.0
 *
 * What jobs have made: files and archives of them.
 */
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "paths/paths_private.h"

/* What a request for results needs to know of a job. */
static bool look_up(struct srv_jobs *jobs, const char *id, struct srv_path_job *copy,
                    struct sp_error *err) {
    pthread_mutex_lock(&jobs->mutex);
    struct srv_path_job *job = *srv_job_find(jobs, id);
    if (job) {
        copy->output = job->output;
        copy->state = job->state;
        copy->done = job->done;
    }
    pthread_mutex_unlock(&jobs->mutex);
    if (!job)
        srv_job_missing(id, err);
    return job != NULL;
}

static bool open_file(struct srv_jobs *jobs, const char *id, const char *name, const char *mime,
                      struct srv_job_file *file, struct sp_error *err) {
    char path[SRV_FILE_BYTES];
    srv_folder_path(&jobs->folder, id, name, path);
    file->mime = mime;
    file->fd = open(path, O_RDONLY | O_CLOEXEC);
    off_t size = file->fd >= 0 ? lseek(file->fd, 0, SEEK_END) : -1;
    file->size = size < 0 ? 0 : (uint64_t)size;
    if (size >= 0)
        return true;
    if (errno == ENOENT) /* it was deleted meanwhile */
        srv_job_missing(id, err);
    else /* too many open files, say: another time */
        sp_fail(err, SP_ERR_BUDGET, NULL, "the file cannot be read: %s", strerror(errno));
    if (file->fd >= 0)
        close(file->fd);
    return false;
}

bool srv_jobs_open_frame(struct srv_jobs *jobs, const char *id, uint32_t frame,
                         struct srv_job_file *file, struct sp_error *err) {
    struct srv_path_job job;
    char name[32];
    if (!look_up(jobs, id, &job, err))
        return false;
    if (job.output.is_movie)
        return sp_fail(err, SP_ERR_NOT_FOUND, NULL, "this path has a movie, not frames");
    if (frame >= job.output.frames)
        return sp_fail(err, SP_ERR_NOT_FOUND, NULL, "this path has frames 0 to %u",
                       job.output.frames - 1);
    if (frame >= job.done)
        return sp_fail(err, SP_ERR_TIMEOUT, NULL, "frame %u is not drawn yet, %u are", frame,
                       job.done);
    srv_job_file_name(&job.output, frame, name);
    return open_file(jobs, id, name, sp_image_format_info(job.output.format)->mime, file, err);
}

static bool check_done(const struct srv_path_job *job, bool is_movie, struct sp_error *err) {
    if (job->output.is_movie != is_movie)
        return sp_fail(err, SP_ERR_NOT_FOUND, NULL, "this path has %s",
                       is_movie ? "frames, not a movie: \"format\": \"webm\" makes one"
                                : "a movie, not frames");
    return job->state == SRV_JOB_DONE ||
           sp_fail(err, SP_ERR_TIMEOUT, NULL, "this path is %s with %u of %u frames",
                   srv_job_state_name(job), job->done, job->output.frames);
}

bool srv_jobs_open_movie(struct srv_jobs *jobs, const char *id, struct srv_job_file *file,
                         struct sp_error *err) {
    struct srv_path_job job;
    return look_up(jobs, id, &job, err) && check_done(&job, true, err) &&
           open_file(jobs, id, SRV_JOB_MOVIE, "video/webm", file, err);
}

struct srv_archive *srv_jobs_open_archive(struct srv_jobs *jobs, const char *id,
                                          struct sp_error *err) {
    struct srv_path_job job;
    if (!look_up(jobs, id, &job, err) || !check_done(&job, false, err))
        return NULL;
    return srv_archive_create(&jobs->folder, id, sp_image_format_info(job.output.format)->extension,
                              job.done, err);
}
