/* SPDX-License-Identifier: Apache-2.0
 *
 * The results of paths: frames, movies and archives.
 */
#include <stdio.h>
#include <unistd.h>

#include "paths/paths_private.h"
#include "sp/log.h"

/* Copies the state of the path for a request for results. */
static bool look_up(struct srv_paths *paths, const char *id, struct srv_path *copy,
                    struct sp_error *err) {
    pthread_mutex_lock(&paths->mutex);
    struct srv_path *path = *srv_paths_find(paths, id);
    if (path) {
        copy->output = path->output;
        copy->state = path->state;
        copy->done = path->done;
    }
    pthread_mutex_unlock(&paths->mutex);
    if (!path)
        srv_path_missing(paths, id, err);
    return path != NULL;
}

/* Reports a result that is counted but not whole. `what` names it: "frame 7". */
static bool fail_damaged(const char *id, const char *what, const struct sp_error *why,
                         struct sp_error *err) {
    sp_log_with(SP_LOG_ERROR, SP_LOG_FIELDS({ "path", id }),
                "%s of camera path %s is damaged: %s: %s; to render it again, delete the file and "
                "restart the daemon",
                what, id, why->place, why->text);
    return sp_fail(err, SP_ERR_IO, NULL,
                   "%s of camera path '%.64s' is damaged; to render it again, delete the camera "
                   "path and create it again",
                   what, id);
}

/* −1 with *err set. */
static int open_file(struct srv_paths *paths, const char *id, const char *name, const char *what,
                     bool sealed, uint64_t *size, struct sp_error *err) {
    struct sp_error why = { .code = SP_OK };
    struct srv_path path;
    int fd = srv_folder_open_file(&paths->folder, id, name, sealed, size, &why);
    if (fd >= 0)
        return fd;
    if (why.code == SP_ERR_NOT_FOUND && !look_up(paths, id, &path, err))
        return -1;                 /* the path was deleted in between */
    if (why.code == SP_ERR_BUDGET) /* for example too many open files: the client may try again */
        sp_fail(err, why.code, NULL, "%s", why.text);
    else
        fail_damaged(id, what, &why, err);
    return -1;
}

static const char *frame_name(uint32_t frame, char text[32]) {
    snprintf(text, 32, "frame %u", frame);
    return text;
}

bool srv_paths_open_frame(struct srv_paths *paths, const char *id, uint32_t frame,
                          struct srv_path_file *file, struct sp_error *err) {
    struct srv_path path;
    char name[32], what[32];
    if (!look_up(paths, id, &path, err))
        return false;
    if (path.output.is_movie)
        return sp_fail(err, SP_ERR_NOT_FOUND, NULL,
                       "this camera path makes a movie; get its movie instead of a frame");
    if (frame >= path.output.frames)
        return sp_fail(err, SP_ERR_NOT_FOUND, NULL, "this camera path has frames 0 to %u",
                       path.output.frames - 1);
    if (frame >= path.done)
        return sp_fail(err, SP_ERR_NOT_READY, NULL, "frame %u is not rendered yet; %u frames are",
                       frame, path.done);
    srv_path_file_name(&path.output, frame, name);
    file->mime = sp_image_format_info(path.output.format)->mime;
    file->fd = open_file(paths, id, name, frame_name(frame, what), path.output.is_sealed,
                         &file->size, err);
    return file->fd >= 0;
}

static bool check_done(const struct srv_path *path, bool is_movie, struct sp_error *err) {
    if (path->output.is_movie != is_movie)
        return sp_fail(err, SP_ERR_NOT_FOUND, NULL, "this camera path makes %s",
                       is_movie ? "images; get its frames or archive, or use \"format\": \"webm\""
                                : "a movie; get its movie instead of an archive");
    return path->state == SRV_PATH_DONE ||
           sp_fail(err, SP_ERR_NOT_READY, NULL,
                   "this camera path is %s: %u of %u frames are done; try again later",
                   srv_path_state_name(path), path->done, path->output.frames);
}

bool srv_paths_open_movie(struct srv_paths *paths, const char *id, struct srv_path_file *file,
                          struct sp_error *err) {
    struct srv_path path;
    file->mime = "video/webm";
    file->fd = look_up(paths, id, &path, err) && check_done(&path, true, err)
                   ? open_file(paths, id, SRV_PATH_MOVIE_NAME, "the movie", path.output.is_sealed,
                               &file->size, err)
                   : -1;
    return file->fd >= 0;
}

struct srv_archive *srv_paths_open_archive(struct srv_paths *paths, const char *id,
                                           struct sp_error *err) {
    struct srv_path path;
    if (!look_up(paths, id, &path, err) || !check_done(&path, false, err))
        return NULL;
    for (uint32_t i = 0; i < path.done; i++) { /* else the client would get a part of the archive */
        char name[32], what[32];
        uint64_t size;
        srv_path_file_name(&path.output, i, name);
        int fd = open_file(paths, id, name, frame_name(i, what), path.output.is_sealed, &size, err);
        if (fd < 0)
            return NULL;
        close(fd);
    }
    return srv_archive_create(&paths->folder, id,
                              sp_image_format_info(path.output.format)->extension, path.done,
                              path.output.is_sealed, err);
}
