/* SPDX-License-Identifier: Apache-2.0
 *
 * The list of uploads: limits, expiry, and what happens to files.
 */
#include "uploads/uploads.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "config/secret.h"
#include "sp/log.h"
#include "uploads/uploads_private.h"

struct srv_upload **srv_uploads_find(struct srv_uploads *uploads, const char *id) {
    struct srv_upload **at = &uploads->first;
    while (*at && strcmp((*at)->id, id) != 0)
        at = &(*at)->next;
    return at;
}

bool srv_upload_not_found(const char *id, struct sp_error *err) {
    return sp_fail(err, SP_ERR_NOT_FOUND, NULL,
                   "there is no upload '%.40s'; it may have expired or been removed", id);
}

void srv_upload_describe(const struct srv_uploads *uploads, const struct srv_upload *upload,
                         double now_ms, struct srv_upload_info *info) {
    *info = (struct srv_upload_info){ .bytes = upload->bytes, .offset = upload->offset };
    memcpy(info->id, upload->id, sizeof info->id);
    memcpy(info->name, upload->name, sizeof info->name);
    memcpy(info->owner, upload->owner, sizeof info->owner);
    double left_ms = upload->used_ms + uploads->options.expiry_ms - now_ms;
    info->expires_ms = upload->is_of_volume ? (double)INFINITY : fmax(left_ms, 0);
}

/* With the mutex held. */
static void append(struct srv_uploads *uploads, struct srv_upload *upload) {
    *uploads->last = upload;
    uploads->last = &upload->next;
    uploads->count++;
    uploads->declared_bytes += upload->bytes;
}

/* With the mutex held. */
static struct srv_upload *take_out(struct srv_uploads *uploads, struct srv_upload **at) {
    struct srv_upload *upload = *at;
    *at = upload->next;
    if (!*at)
        uploads->last = at;
    uploads->count--;
    uploads->declared_bytes -= upload->bytes;
    return upload;
}

/* Start and end. */

static void restore(struct srv_uploads *uploads, const char *id, double now_ms) {
    struct srv_upload *upload = calloc(1, sizeof *upload);
    if (!upload || !srv_upload_files_read(uploads, id, upload)) {
        free(upload);
        srv_folder_remove_id(uploads->root, id);
        sp_log(SP_LOG_WARN, "removed upload %s, which could not be continued", id);
        return;
    }
    upload->used_ms = now_ms;
    append(uploads, upload);
}

static bool restore_all(struct srv_uploads *uploads, double now_ms, struct sp_error *err) {
    DIR *folders = opendir(uploads->root);
    if (!folders)
        return sp_fail(err, SP_ERR_IO, uploads->root, "cannot read this folder: %s",
                       strerror(errno));
    for (struct dirent *entry; (entry = readdir(folders));)
        if (srv_folder_is_id(entry->d_name))
            restore(uploads, entry->d_name, now_ms);
    closedir(folders);
    if (uploads->count > 0)
        sp_log(SP_LOG_INFO, "%u uploads of an earlier run can be continued", uploads->count);
    return true;
}

/* Opens a folder that survives. Its lock keeps another daemon from removing our files. */
static bool open_folder(struct srv_uploads *uploads, const char *folder, struct sp_error *err) {
    int n = snprintf(uploads->root, sizeof uploads->root, "%s", folder);
    if (n < 0 || (size_t)n >= sizeof uploads->root)
        return sp_fail(err, SP_ERR_INVALID, folder, "the path of this folder is too long");
    if (mkdir(folder, 0700) != 0 && errno != EEXIST)
        return sp_fail(err, SP_ERR_IO, folder, "cannot create this folder: %s", strerror(errno));
    uploads->lock = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (uploads->lock < 0)
        return sp_fail(err, SP_ERR_IO, folder, "cannot open this folder: %s", strerror(errno));
    if (flock(uploads->lock, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
        return sp_fail(err, SP_ERR_IO, folder,
                       "another daemon uses this folder for uploads; give it --upload-dir");
    if (access(folder, R_OK | W_OK | X_OK) != 0)
        return sp_fail(err, SP_ERR_IO, folder, "cannot write to this folder: %s", strerror(errno));
    return true;
}

struct srv_uploads *srv_uploads_create(const struct srv_uploads_options *options, double now_ms,
                                       struct sp_error *err) {
    struct srv_uploads *uploads = calloc(1, sizeof *uploads);
    if (!uploads) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the uploads");
        return NULL;
    }
    uploads->options = *options;
    uploads->last = &uploads->first;
    uploads->lock = -1;
    uploads->is_private = !options->folder;
    pthread_mutex_init(&uploads->mutex, NULL);
    bool ok = uploads->is_private
                  ? srv_private_folder_open("splatd-uploads-", uploads->root, &uploads->lock, err)
                  : open_folder(uploads, options->folder, err) && restore_all(uploads, now_ms, err);
    if (!ok)
        srv_uploads_destroy(&uploads);
    return uploads;
}

void srv_uploads_destroy(struct srv_uploads **uploads_pointer) {
    struct srv_uploads *uploads = *uploads_pointer;
    *uploads_pointer = NULL;
    if (!uploads)
        return;
    while (uploads->first) {
        struct srv_upload *upload = take_out(uploads, &uploads->first);
        if (uploads->is_private)
            srv_folder_remove_id(uploads->root, upload->id);
        free(upload);
    }
    if (uploads->is_private && uploads->lock >= 0)
        srv_private_folder_close(uploads->root, uploads->lock);
    else if (uploads->lock >= 0)
        close(uploads->lock);
    pthread_mutex_destroy(&uploads->mutex);
    free(uploads);
}

/* Adding. */

bool srv_upload_name(const char *given, size_t length, char name[SP_NAME_BYTES],
                     struct sp_error *err) {
    size_t start = length, used = 0;
    while (start > 0 && given[start - 1] != '/' && given[start - 1] != '\\')
        start--;
    const char *last = given + start;
    length -= start;
    if (length == 0)
        return sp_fail(err, SP_ERR_INVALID, "/name", "is not the name of a file");
    /* A name that is too long loses its beginning: the end has the extension. */
    if (length > SP_NAME_BYTES - 1) {
        last += length - (SP_NAME_BYTES - 1);
        length = SP_NAME_BYTES - 1;
        for (; length > 0 && ((unsigned char)*last & 0xC0) == 0x80; length--)
            last++;
    }
    for (size_t i = 0; i < length; i++) {
        unsigned char c = (unsigned char)last[i];
        name[used++] = c < 0x20 || c == 0x7f ? ' ' : last[i];
    }
    name[used] = 0;
    return true;
}

/* Declared by one owner, with the mutex held. */
static uint64_t declared_by(const struct srv_uploads *uploads, const char *owner) {
    uint64_t bytes = 0;
    for (const struct srv_upload *u = uploads->first; u; u = u->next)
        if (strcmp(u->owner, owner) == 0)
            bytes += u->bytes;
    return bytes;
}

/* With the mutex held. */
static bool may_add(const struct srv_uploads *uploads, const char *owner, uint64_t quota,
                    uint64_t bytes, struct sp_error *err) {
    const struct srv_uploads_options *o = &uploads->options;
    uint64_t own = declared_by(uploads, owner);
    if (bytes > o->bytes_max)
        return sp_fail(err, SP_ERR_INVALID, "/bytes",
                       "the file has %" PRIu64 " bytes and --upload-bytes allows %" PRIu64, bytes,
                       o->bytes_max);
    if (quota && (bytes > quota || own > quota - bytes))
        return sp_fail(err, SP_ERR_QUOTA, NULL,
                       "the uploads of %s have %" PRIu64 " bytes, this file has %" PRIu64
                       ", and its token allows %" PRIu64 "; close uploaded volumes or cancel "
                       "uploads",
                       owner, own, bytes, quota);
    if (uploads->count >= o->count_max)
        return sp_fail(err, SP_ERR_BUDGET, NULL,
                       "there are %u uploads and --uploads allows %u; cancel some", uploads->count,
                       o->count_max);
    if (uploads->declared_bytes > o->bytes_max - bytes)
        return sp_fail(err, SP_ERR_BUDGET, NULL,
                       "all uploads have %" PRIu64 " bytes, this file has %" PRIu64
                       ", and --upload-bytes allows %" PRIu64 "; close uploaded volumes or cancel "
                       "uploads",
                       uploads->declared_bytes, bytes, o->bytes_max);
    return true;
}

static bool fits_the_disk(const struct srv_uploads *uploads, uint64_t bytes, struct sp_error *err) {
    uint64_t left = srv_upload_files_free(uploads);
    return bytes <= left ||
           sp_fail(err, SP_ERR_BUDGET, NULL,
                   "the file has %" PRIu64 " bytes and the disk for uploads has %" PRIu64 " free",
                   bytes, left);
}

bool srv_uploads_add(struct srv_uploads *uploads, const char *owner, const char *name,
                     const char *extension, uint64_t bytes, double now_ms,
                     struct srv_upload_info *info, struct sp_error *err) {
    struct srv_quota quota = { .sessions = 0 };
    if (uploads->options.tokens)
        srv_tokens_of_name(uploads->options.tokens, owner, NULL, &quota);
    struct srv_upload *upload = calloc(1, sizeof *upload);
    if (!upload)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for an upload");
    snprintf(upload->name, sizeof upload->name, "%s", name);
    snprintf(upload->owner, sizeof upload->owner, "%s", owner);
    snprintf(upload->extension, sizeof upload->extension, "%s", extension);
    upload->bytes = bytes;
    upload->used_ms = now_ms;
    bool ok = srv_secret_hex(upload->id, sizeof upload->id - 1, err);
    pthread_mutex_lock(&uploads->mutex);
    ok = ok && may_add(uploads, owner, quota.upload_bytes, bytes, err) &&
         fits_the_disk(uploads, bytes, err) && srv_upload_files_create(uploads, upload, err);
    if (ok) {
        append(uploads, upload);
        srv_upload_describe(uploads, upload, now_ms, info);
    }
    pthread_mutex_unlock(&uploads->mutex);
    if (ok)
        sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "upload", info->id }),
                    "upload %s of %s began: %s, %" PRIu64 " bytes", info->id, owner, name, bytes);
    else
        free(upload);
    return ok;
}

/* Reading the list. */

bool srv_uploads_get(struct srv_uploads *uploads, const char *id, double now_ms,
                     struct srv_upload_info *info, struct sp_error *err) {
    pthread_mutex_lock(&uploads->mutex);
    const struct srv_upload *upload = *srv_uploads_find(uploads, id);
    if (upload)
        srv_upload_describe(uploads, upload, now_ms, info);
    pthread_mutex_unlock(&uploads->mutex);
    return upload || srv_upload_not_found(id, err);
}

bool srv_uploads_at(struct srv_uploads *uploads, unsigned i, double now_ms,
                    struct srv_upload_info *info) {
    pthread_mutex_lock(&uploads->mutex);
    const struct srv_upload *upload = uploads->first;
    while (upload && i-- > 0)
        upload = upload->next;
    if (upload)
        srv_upload_describe(uploads, upload, now_ms, info);
    pthread_mutex_unlock(&uploads->mutex);
    return upload != NULL;
}

void srv_uploads_numbers(struct srv_uploads *uploads, struct srv_uploads_numbers *numbers) {
    pthread_mutex_lock(&uploads->mutex);
    *numbers = (struct srv_uploads_numbers){ .count = uploads->count,
                                             .declared_bytes = uploads->declared_bytes,
                                             .bytes_max = uploads->options.bytes_max };
    for (const struct srv_upload *u = uploads->first; u; u = u->next)
        numbers->received_bytes += u->offset;
    pthread_mutex_unlock(&uploads->mutex);
}

/* Removing. */

struct removal {
    struct srv_work work;
    struct srv_uploads *uploads;
    struct srv_upload *upload;
};

static void run_removal(struct srv_work *work) {
    struct removal *removal = (struct removal *)work;
    const char *id = removal->upload->id;
    if (!srv_folder_remove_id(removal->uploads->root, id))
        sp_log(SP_LOG_ERROR,
               "cannot remove the files of upload %s: %s; trying again at the next "
               "start",
               id, strerror(errno));
    free(removal->upload);
    free(removal);
}

/* Removes the files of an upload that left the list; takes it over. */
static void remove_files(struct srv_uploads *uploads, struct srv_upload *upload) {
    struct removal *removal = malloc(sizeof *removal);
    srv_upload_files_forget(uploads, upload->id);
    if (removal) {
        *removal = (struct removal){ { .run = run_removal }, uploads, upload };
        srv_work_queue_add(uploads->options.disk, &removal->work);
        return;
    }
    srv_folder_remove_id(uploads->root, upload->id);
    free(upload);
}

bool srv_uploads_remove(struct srv_uploads *uploads, const char *id, struct sp_error *err) {
    pthread_mutex_lock(&uploads->mutex);
    struct srv_upload **at = srv_uploads_find(uploads, id), *removed = NULL;
    bool ok = *at || srv_upload_not_found(id, err);
    if (ok && (*at)->is_of_volume)
        ok = sp_fail(err, SP_ERR_NOT_READY, NULL,
                     "the upload belongs to a volume; close the volume instead");
    if (ok)
        removed = take_out(uploads, at);
    pthread_mutex_unlock(&uploads->mutex);
    if (!ok)
        return false;
    sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "upload", id }), "upload %s was removed", id);
    srv_metrics_add(uploads->options.metrics, SRV_COUNT_UPLOAD_REMOVED, 1);
    remove_files(uploads, removed);
    return true;
}

/* Takes an expired upload out of the list; NULL = there is none. */
static struct srv_upload *take_expired(struct srv_uploads *uploads, double now_ms) {
    struct srv_upload *expired = NULL;
    pthread_mutex_lock(&uploads->mutex);
    struct srv_upload **at = &uploads->first;
    while (*at && ((*at)->is_of_volume || now_ms - (*at)->used_ms < uploads->options.expiry_ms))
        at = &(*at)->next;
    if (*at)
        expired = take_out(uploads, at);
    pthread_mutex_unlock(&uploads->mutex);
    return expired;
}

void srv_uploads_tick(struct srv_uploads *uploads, double now_ms) {
    for (struct srv_upload *u; (u = take_expired(uploads, now_ms));) {
        sp_log_with(SP_LOG_WARN, SP_LOG_FIELDS({ "upload", u->id }),
                    "upload %s of %s expired: %s, %" PRIu64 " of %" PRIu64
                    " bytes, none for %.0f s (--upload-time)",
                    u->id, u->owner, u->name, u->offset, u->bytes,
                    uploads->options.expiry_ms / 1000);
        srv_metrics_add(uploads->options.metrics, SRV_COUNT_UPLOAD_EXPIRED, 1);
        remove_files(uploads, u);
    }
}

/* The catalog. */

bool srv_upload_open(void *user, const char *id, char path[PATH_MAX], char name[SP_NAME_BYTES],
                     struct sp_error *err) {
    struct srv_uploads *uploads = user;
    char file[SRV_FILE_BYTES];
    pthread_mutex_lock(&uploads->mutex);
    struct srv_upload *upload = *srv_uploads_find(uploads, id);
    bool ok = upload || srv_upload_not_found(id, err);
    if (ok && upload->offset < upload->bytes)
        ok = sp_fail(err, SP_ERR_NOT_READY, NULL,
                     "the upload has %" PRIu64 " of %" PRIu64 " bytes; send the rest first",
                     upload->offset, upload->bytes);
    if (ok) {
        upload->is_of_volume = true;
        upload->writer = 0; /* a writer that is late changes nothing */
        srv_upload_path(uploads, upload, file);
        snprintf(path, PATH_MAX, "%s", file);
        memcpy(name, upload->name, sizeof upload->name);
    }
    pthread_mutex_unlock(&uploads->mutex);
    return ok;
}

void srv_upload_close(void *user, const char *id, enum srv_upload_end end) {
    struct srv_uploads *uploads = user;
    struct srv_upload *gone = NULL;
    pthread_mutex_lock(&uploads->mutex);
    struct srv_upload **at = srv_uploads_find(uploads, id);
    if (*at && end == SRV_UPLOAD_RETURNED)
        (*at)->is_of_volume = false;
    else if (*at && (end == SRV_UPLOAD_UNUSED || !uploads->options.keeps_loaded))
        gone = take_out(uploads, at);
    pthread_mutex_unlock(&uploads->mutex);
    if (gone)
        remove_files(uploads, gone);
}
