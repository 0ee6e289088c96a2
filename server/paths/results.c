/* SPDX-License-Identifier: Apache-2.0
 *
 * The results of paths: frames, movies and archives.
 */
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "paths/paths_private.h"

/* Copies what a request for results needs. */
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
        srv_path_not_found(id, err);
    return path != NULL;
}

static bool open_file(struct srv_paths *paths, const char *id, const char *name, const char *mime,
                      struct srv_path_file *file, struct sp_error *err) {
    char file_path[SRV_FILE_BYTES];
    srv_folder_path(&paths->folder, id, name, file_path);
    file->mime = mime;
    file->fd = open(file_path, O_RDONLY | O_CLOEXEC);
    off_t size = file->fd >= 0 ? lseek(file->fd, 0, SEEK_END) : -1;
    file->size = size < 0 ? 0 : (uint64_t)size;
    if (size >= 0)
        return true;
    if (errno == ENOENT) /* the path was deleted in between */
        srv_path_not_found(id, err);
    else /* for example too many open files: the client may try again */
        sp_fail(err, SP_ERR_BUDGET, NULL, "cannot read the file: %s", strerror(errno));
    if (file->fd >= 0)
        close(file->fd);
    return false;
}

bool srv_paths_open_frame(struct srv_paths *paths, const char *id, uint32_t frame,
                          struct srv_path_file *file, struct sp_error *err) {
    struct srv_path path;
    char name[32];
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
    return open_file(paths, id, name, sp_image_format_info(path.output.format)->mime, file, err);
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
    return look_up(paths, id, &path, err) && check_done(&path, true, err) &&
           open_file(paths, id, SRV_PATH_MOVIE_NAME, "video/webm", file, err);
}

struct srv_archive *srv_paths_open_archive(struct srv_paths *paths, const char *id,
                                           struct sp_error *err) {
    struct srv_path path;
    if (!look_up(paths, id, &path, err) || !check_done(&path, false, err))
        return NULL;
    return srv_archive_create(&paths->folder, id,
                              sp_image_format_info(path.output.format)->extension, path.done, err);
}
