/* SPDX-License-Identifier: Apache-2.0 */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "protocol/json.h"
#include "uploads/uploads_private.h"

enum { INFO_BYTES = 2048 };

static void path_of(const struct srv_uploads *uploads, const char *id, const char *name,
                    char path[SRV_UPLOAD_PATH_BYTES]) {
    snprintf(path, SRV_UPLOAD_PATH_BYTES, "%s/%.32s%s%.32s", uploads->root, id, *name ? "/" : "",
             name);
}

void srv_upload_path(const struct srv_uploads *uploads, const struct srv_upload *upload,
                     char path[SRV_UPLOAD_PATH_BYTES]) {
    bool is_companion = upload->header[0], is_named = is_companion || upload->keeps_name;
    snprintf(path, SRV_UPLOAD_PATH_BYTES, "%s/%.32s/files/%s%s", uploads->root,
             is_companion ? upload->header : upload->id, is_named ? upload->name : "data",
             is_named ? "" : upload->extension);
}

bool srv_upload_disk_error(const char *what, struct sp_error *err) {
    int error = errno;
    if (error == ENOSPC || error == EDQUOT)
        return sp_fail(err, SP_ERR_BUDGET, NULL,
                       "the disk for uploads is full; free space and continue the upload");
    return sp_fail(err, SP_ERR_IO, NULL, "cannot %s the upload: %s", what, strerror(error));
}

uint64_t srv_upload_files_free(const struct srv_uploads *uploads) {
    struct statvfs st;
    return statvfs(uploads->root, &st) == 0 ? (uint64_t)st.f_bavail * st.f_frsize : UINT64_MAX;
}

static char *encode(const struct srv_upload *upload, size_t *size) {
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "name", upload->name);
    proto_json_set_string(&json, "owner", upload->owner);
    proto_json_set_string(&json, "extension", upload->extension);
    if (upload->header[0])
        proto_json_set_string(&json, "header", upload->header);
    if (upload->keeps_name)
        proto_json_set_integer(&json, "keeps_name", 1);
    proto_json_set_integer(&json, "bytes", (int64_t)upload->bytes);
    proto_json_set_integer(&json, "offset", (int64_t)upload->offset);
    if (upload->modified_ms)
        proto_json_set_integer(&json, "modified", upload->modified_ms);
    char *text = proto_json_to_text(json, size);
    proto_json_free(&json);
    return text;
}

/* Syncs a file or a folder. */
static bool sync_path(const char *path) {
    int fd = open(path, O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
    bool ok = fd >= 0 && fsync(fd) == 0;
    if (fd >= 0)
        close(fd);
    return ok;
}

static bool sync_name(const struct srv_uploads *uploads, const char *id, const char *name) {
    char path[SRV_UPLOAD_PATH_BYTES];
    path_of(uploads, id, name, path);
    return sync_path(path);
}

bool srv_uploads_sync(struct srv_uploads *uploads, const struct srv_upload_info *info) {
    const char *data = info->header[0] ? info->header : info->id;
    return !uploads->is_private && sync_name(uploads, info->id, "info") &&
           sync_name(uploads, data, "files") && sync_name(uploads, info->id, "") &&
           sync_path(uploads->root);
}

bool srv_uploads_sync_removal(struct srv_uploads *uploads, const char *id) {
    char path[SRV_UPLOAD_PATH_BYTES];
    path_of(uploads, id, "", path);
    return !uploads->is_private && access(path, F_OK) != 0 && errno == ENOENT &&
           sync_path(uploads->root);
}

bool srv_upload_files_save(const struct srv_uploads *uploads, const struct srv_upload *upload,
                           bool syncs, struct sp_error *err) {
    char part[SRV_UPLOAD_PATH_BYTES], path[SRV_UPLOAD_PATH_BYTES];
    size_t size;
    char *text = encode(upload, &size);
    if (!text)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for an upload");
    path_of(uploads, upload->id, "info.part", part);
    path_of(uploads, upload->id, "info", path);
    int fd = open(part, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    ssize_t written = fd >= 0 ? pwrite(fd, text, size, 0) : -1;
    free(text);
    bool ok = written == (ssize_t)size;
    if (written >= 0 && !ok)
        errno = ENOSPC;
    ok = ok && (!syncs || fsync(fd) == 0);
    ok = (fd < 0 || close(fd) == 0) && ok;
    return (ok && rename(part, path) == 0 && (!syncs || sync_name(uploads, upload->id, ""))) ||
           srv_upload_disk_error("record", err);
}

bool srv_upload_files_create(const struct srv_uploads *uploads, const struct srv_upload *upload,
                             struct sp_error *err) {
    char path[SRV_UPLOAD_PATH_BYTES], files[SRV_UPLOAD_PATH_BYTES];
    path_of(uploads, upload->id, "", path);
    path_of(uploads, upload->id, "files", files);
    bool ok = mkdir(path, 0700) == 0 && (upload->header[0] || mkdir(files, 0700) == 0);
    srv_upload_path(uploads, upload, path);
    /* Beside a header may lie a file of this name that an earlier run left. */
    int fd = ok ? open(path, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0600) : -1;
    ok = fd >= 0 || srv_upload_disk_error("create", err);
    if (fd >= 0)
        close(fd);
    ok = ok && srv_upload_files_save(uploads, upload, false, err);
    if (!ok) {
        srv_upload_files_forget(uploads, upload);
        srv_folder_remove_id(uploads->root, upload->id);
    }
    return ok;
}

static bool is_file_name(const char *text) {
    char name[SRV_UPLOAD_NAME_BYTES];
    return srv_upload_name(text, strlen(text), name, NULL) && strcmp(text, name) == 0;
}

/* The name of a companion is the name of a file. */
static bool is_sound(const struct srv_upload *upload) {
    return !strchr(upload->extension, '/') && (!upload->keeps_name || is_file_name(upload->name)) &&
           (!upload->header[0] || (srv_folder_is_id(upload->header) && !upload->extension[0] &&
                                   is_file_name(upload->name)));
}

static bool read_text(const proto_json *json, const char *key, char *out, size_t size) {
    const char *text = proto_json_string(proto_json_get(json, key));
    if (!text || strlen(text) >= size)
        return false;
    strcpy(out, text);
    return true;
}

bool srv_upload_files_read(const struct srv_uploads *uploads, const char *id,
                           struct srv_upload *upload) {
    char path[SRV_UPLOAD_PATH_BYTES], text[INFO_BYTES];
    struct sp_error err;
    struct stat st;
    int64_t bytes = 0, offset = 0, keeps_name = 0;
    path_of(uploads, id, "info", path);
    int fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    ssize_t size = fd >= 0 ? read(fd, text, sizeof text) : -1;
    if (fd >= 0)
        close(fd);
    proto_json *json = size > 0 ? proto_json_parse(text, (size_t)size, &err) : NULL;
    proto_json_integer(proto_json_get(json, "keeps_name"), &keeps_name);
    *upload = (struct srv_upload){ .keeps_name = keeps_name == 1 };
    bool ok = read_text(json, "name", upload->name, sizeof upload->name) &&
              read_text(json, "owner", upload->owner, sizeof upload->owner) &&
              read_text(json, "extension", upload->extension, sizeof upload->extension) &&
              (!proto_json_get(json, "header") ||
               read_text(json, "header", upload->header, sizeof upload->header)) &&
              is_sound(upload) && proto_json_integer(proto_json_get(json, "bytes"), &bytes) &&
              bytes > 0 && proto_json_integer(proto_json_get(json, "offset"), &offset) &&
              offset >= 0 && offset <= bytes;
    proto_json_integer(proto_json_get(json, "modified"), &upload->modified_ms);
    proto_json_free(&json);
    snprintf(upload->id, sizeof upload->id, "%.32s", id);
    upload->bytes = (uint64_t)bytes;
    upload->offset = (uint64_t)offset;
    srv_upload_path(uploads, upload, path);
    if (!ok || lstat(path, &st) != 0 || !S_ISREG(st.st_mode))
        return false;
    /* After a crash of the machine the file may be shorter. */
    if ((uint64_t)st.st_size < upload->offset)
        upload->offset = (uint64_t)st.st_size;
    return true;
}

void srv_upload_files_forget(const struct srv_uploads *uploads, const struct srv_upload *upload) {
    char path[SRV_UPLOAD_PATH_BYTES], gone[SRV_UPLOAD_PATH_BYTES];
    path_of(uploads, upload->id, "info", path);
    unlink(path);
    if (!upload->header[0])
        return;
    srv_upload_path(uploads, upload, path);
    path_of(uploads, upload->id, "data", gone);
    rename(path, gone);
}
