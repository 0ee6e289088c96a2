/* SPDX-License-Identifier: Apache-2.0
 *
 * The list of uploads: adding, expiry, and what happens to files.
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
#include "protocol/text.h"
#include "sp/log.h"
#include "uploads/uploads_private.h"

struct srv_upload **srv_uploads_find(struct srv_uploads *uploads, const char *id) {
    struct srv_upload **at = &uploads->first;
    while (*at && strcmp((*at)->id, id) != 0)
        at = &(*at)->next;
    return at;
}

struct srv_upload *srv_uploads_find_by(struct srv_uploads *uploads, const char *id,
                                       const char *by) {
    struct srv_upload *upload = *srv_uploads_find(uploads, id);
    return upload && (!by || strcmp(upload->owner, by) == 0) ? upload : NULL;
}

bool srv_upload_not_found(const char *id, struct sp_error *err) {
    return sp_fail(err, SP_ERR_NOT_FOUND, NULL,
                   "there is no upload '%.40s'; it may have expired or been removed", id);
}

/* When an upload expires; INFINITY = not by itself. With the mutex held. */
static double expires_at(const struct srv_uploads *uploads, const struct srv_upload *upload) {
    const struct srv_uploads_options *o = &uploads->options;
    if (upload->is_of_volume)
        return (double)INFINITY;
    if (!upload->is_begun && upload->offset == 0)
        return upload->used_ms + fmin(o->begin_ms, o->expiry_ms);
    return upload->used_ms + o->expiry_ms;
}

void srv_upload_describe(const struct srv_uploads *uploads, const struct srv_upload *upload,
                         double now_ms, struct srv_upload_info *info) {
    double expires_ms = expires_at(uploads, upload);
    *info = (struct srv_upload_info){ .bytes = upload->bytes,
                                      .offset = upload->offset,
                                      .modified_ms = upload->modified_ms,
                                      .is_private = uploads->is_private };
    memcpy(info->id, upload->id, sizeof info->id);
    memcpy(info->header, upload->header, sizeof info->header);
    memcpy(info->name, upload->name, sizeof info->name);
    memcpy(info->owner, upload->owner, sizeof info->owner);
    info->expires_ms = fmax(expires_ms - now_ms, 0);
}

/* With the mutex held. */
static void append(struct srv_uploads *uploads, struct srv_upload *upload) {
    *uploads->last = upload;
    uploads->last = &upload->next;
    uploads->count++;
    uploads->declared_bytes += upload->bytes;
}

/* With the mutex held. */
static struct srv_upload *unlink_upload(struct srv_uploads *uploads, struct srv_upload **at) {
    struct srv_upload *upload = *at;
    *at = upload->next;
    if (!*at)
        uploads->last = at;
    uploads->count--;
    uploads->declared_bytes -= upload->bytes;
    return upload;
}

/* Removes an upload and its companion files from the table; returns them as a list. The caller
 * holds the mutex. */
static struct srv_upload *unlink_set(struct srv_uploads *uploads, struct srv_upload **at) {
    struct srv_upload *set = unlink_upload(uploads, at);
    set->next = NULL;
    for (at = &uploads->first; *at;) {
        if (strcmp((*at)->header, set->id) != 0) {
            at = &(*at)->next;
            continue;
        }
        struct srv_upload *companion = unlink_upload(uploads, at);
        companion->next = set->next;
        set->next = companion;
    }
    return set;
}

/* Start and end. */

static void remove_now(const struct srv_uploads *uploads, const char *id) {
    srv_folder_remove_id(uploads->root, id);
    sp_log(SP_LOG_WARN, "removed upload %s, which could not be continued", id);
}

static void restore(struct srv_uploads *uploads, const char *id, double now_ms) {
    struct srv_upload *upload = calloc(1, sizeof *upload);
    if (!upload || !srv_upload_files_read(uploads, id, upload)) {
        free(upload);
        remove_now(uploads, id);
        return;
    }
    upload->used_ms = now_ms;
    append(uploads, upload);
}

/* Removes companions without a header. */
static void remove_orphans(struct srv_uploads *uploads) {
    for (struct srv_upload **at = &uploads->first; *at;) {
        if (!(*at)->header[0] || *srv_uploads_find(uploads, (*at)->header)) {
            at = &(*at)->next;
            continue;
        }
        struct srv_upload *orphan = unlink_upload(uploads, at);
        remove_now(uploads, orphan->id);
        free(orphan);
    }
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
    remove_orphans(uploads);
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
        struct srv_upload *upload = unlink_upload(uploads, &uploads->first);
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

bool srv_upload_name(const char *given, size_t length, char name[SRV_UPLOAD_NAME_BYTES],
                     struct sp_error *err) {
    size_t start = length;
    while (start > 0 && given[start - 1] != '/' && given[start - 1] != '\\')
        start--;
    const char *last = given + start;
    length -= start;
    /* A name that is too long loses its beginning: the end has the extension. */
    if (length > SRV_UPLOAD_NAME_BYTES - 1) {
        last += length - (SRV_UPLOAD_NAME_BYTES - 1);
        length = SRV_UPLOAD_NAME_BYTES - 1;
        for (; length > 0 && ((unsigned char)*last & 0xC0) == 0x80; length--)
            last++;
    }
    memcpy(name, last, length);
    name[length] = 0;
    proto_text_clean(name);
    return (name[strspn(name, " ")] && strcmp(name, ".") != 0 && strcmp(name, "..") != 0) ||
           sp_fail(err, SP_ERR_INVALID, "/name", "is not the name of a file");
}

static bool is_one_of(const char *extension, const char *const *known) {
    for (; *known; known++)
        if (strcmp(extension, *known) == 0)
            return true;
    return false;
}

/* Formats whose files find each other by their names: headers and samples of NIfTI, and slices. */
static const char *const named[] = { ".hdr", ".png", ".jpg", ".jpeg", ".tif", ".tiff", NULL };

/* Formats whose volumes may be in several files: headers, series of DICOM, and slices. */
static bool may_have_companions(const char *extension) {
    static const char *const known[] = { ".nhdr", ".nrrd", ".json", ".mhd",
                                         ".vgi",  ".dcm",  ".ima",  NULL };
    return is_one_of(extension, known) || is_one_of(extension, named);
}

/* With the mutex held. A header takes companions until it belongs to a volume. */
static bool may_join(struct srv_uploads *uploads, const struct srv_upload_request *request,
                     struct sp_error *err) {
    const char *by = request->is_admin ? NULL : request->owner;
    const struct srv_upload *header = srv_uploads_find_by(uploads, request->header, by);
    char data[SRV_UPLOAD_NAME_BYTES];
    if (!header)
        return sp_fail(err, SP_ERR_NOT_FOUND, "/header", "there is no upload '%.40s'",
                       request->header);
    if (header->keeps_name)
        snprintf(data, sizeof data, "%s", header->name);
    else
        snprintf(data, sizeof data, "data%s", header->extension);
    if (!may_have_companions(header->extension))
        return sp_fail(err, SP_ERR_INVALID, "/header",
                       "'%.100s' is no header with samples in other files", header->name);
    if (header->is_of_volume)
        return sp_fail(err, SP_ERR_NOT_READY, "/header",
                       "the header belongs to a volume already; close the volume and begin again");
    for (const struct srv_upload *u = uploads->first; u; u = u->next)
        if (strcmp(u->header, header->id) == 0 && strcmp(u->name, request->name) == 0)
            return sp_fail(err, SP_ERR_INVALID, "/name",
                           "the header has a file '%.100s' already; continue or delete that upload",
                           request->name);
    return strcmp(request->name, data) != 0 ||
           sp_fail(err, SP_ERR_INVALID, "/name", "is reserved; rename the file");
}

bool srv_uploads_add(struct srv_uploads *uploads, const struct srv_upload_request *request,
                     double now_ms, struct srv_upload_info *info, struct sp_error *err) {
    const struct srv_quota quota = srv_uploads_quota_of(uploads, request->owner);
    struct srv_upload *upload = calloc(1, sizeof *upload);
    if (!upload)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for an upload");
    snprintf(upload->name, sizeof upload->name, "%s", request->name);
    snprintf(upload->owner, sizeof upload->owner, "%s", request->owner);
    if (request->header)
        snprintf(upload->header, sizeof upload->header, "%s", request->header);
    else
        snprintf(upload->extension, sizeof upload->extension, "%s", request->extension);
    upload->keeps_name = is_one_of(upload->extension, named);
    upload->bytes = request->bytes;
    upload->modified_ms = request->modified_ms;
    upload->used_ms = now_ms;
    bool ok = srv_secret_hex(upload->id, sizeof upload->id - 1, err);
    pthread_mutex_lock(&uploads->mutex);
    ok = ok && (!request->header || may_join(uploads, request, err)) &&
         srv_uploads_may_add(uploads, request->owner, &quota, request->bytes, err) &&
         srv_upload_files_create(uploads, upload, err);
    if (ok) {
        append(uploads, upload);
        srv_upload_describe(uploads, upload, now_ms, info);
    }
    pthread_mutex_unlock(&uploads->mutex);
    if (ok)
        sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "upload", info->id }),
                    "upload %s of %s began: %s, %" PRIu64 " bytes", info->id, request->owner,
                    request->name, info->bytes);
    else
        free(upload);
    return ok;
}

/* Reading the list. */

bool srv_uploads_get(struct srv_uploads *uploads, const char *id, const char *by, double now_ms,
                     struct srv_upload_info *info, struct sp_error *err) {
    pthread_mutex_lock(&uploads->mutex);
    const struct srv_upload *upload = srv_uploads_find_by(uploads, id, by);
    if (upload)
        srv_upload_describe(uploads, upload, now_ms, info);
    pthread_mutex_unlock(&uploads->mutex);
    return upload || srv_upload_not_found(id, err);
}

bool srv_uploads_at(struct srv_uploads *uploads, unsigned i, const char *by, double now_ms,
                    struct srv_upload_info *info) {
    pthread_mutex_lock(&uploads->mutex);
    const struct srv_upload *upload = uploads->first;
    while (upload && ((by && strcmp(upload->owner, by) != 0) || i-- > 0))
        upload = upload->next;
    if (upload)
        srv_upload_describe(uploads, upload, now_ms, info);
    pthread_mutex_unlock(&uploads->mutex);
    return upload != NULL;
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
static void remove_files_of(struct srv_uploads *uploads, struct srv_upload *upload) {
    struct removal *removal = malloc(sizeof *removal);
    srv_upload_files_forget(uploads, upload);
    if (removal) {
        *removal = (struct removal){ { .run = run_removal }, uploads, upload };
        srv_work_queue_add(uploads->options.disk, &removal->work);
        return;
    }
    srv_folder_remove_id(uploads->root, upload->id);
    free(upload);
}

/* The same for a list. */
static void remove_files(struct srv_uploads *uploads, struct srv_upload *set) {
    while (set) {
        struct srv_upload *upload = set;
        set = set->next;
        remove_files_of(uploads, upload);
    }
}

bool srv_uploads_remove(struct srv_uploads *uploads, const char *id, const char *by,
                        struct sp_error *err) {
    pthread_mutex_lock(&uploads->mutex);
    struct srv_upload *found = srv_uploads_find_by(uploads, id, by), *removed = NULL;
    bool ok = found || srv_upload_not_found(id, err);
    if (ok && found->is_of_volume)
        ok = sp_fail(err, SP_ERR_NOT_READY, NULL,
                     "the upload belongs to a volume; close the volume instead");
    if (ok)
        removed = unlink_set(uploads, srv_uploads_find(uploads, id));
    pthread_mutex_unlock(&uploads->mutex);
    if (!ok)
        return false;
    sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "upload", id }), "upload %s was removed", id);
    srv_metrics_add(uploads->options.metrics, SRV_COUNT_UPLOAD_REMOVED, 1);
    remove_files(uploads, removed);
    return true;
}

/* A companion with bytes expires with its header, which lives as long as its companions get bytes.
 */
static bool is_expired(const struct srv_uploads *uploads, const struct srv_upload *upload,
                       double now_ms) {
    bool is_sound = upload->header[0] && (upload->is_begun || upload->offset > 0);
    return !is_sound && now_ms >= expires_at(uploads, upload);
}

/* Takes an expired upload and its companions out of the list; NULL = there is none. */
static struct srv_upload *unlink_expired(struct srv_uploads *uploads, double now_ms) {
    struct srv_upload *expired = NULL;
    pthread_mutex_lock(&uploads->mutex);
    struct srv_upload **at = &uploads->first;
    while (*at && !is_expired(uploads, *at, now_ms))
        at = &(*at)->next;
    if (*at)
        expired = unlink_set(uploads, at);
    pthread_mutex_unlock(&uploads->mutex);
    return expired;
}

void srv_uploads_tick(struct srv_uploads *uploads, double now_ms) {
    for (struct srv_upload *set; (set = unlink_expired(uploads, now_ms));) {
        for (const struct srv_upload *u = set; u; u = u->next) {
            sp_log_with(SP_LOG_WARN, SP_LOG_FIELDS({ "upload", u->id }),
                        "upload %s of %s expired: %s, %" PRIu64 " of %" PRIu64
                        " bytes, none for %.0f s (%s)",
                        u->id, u->owner, u->name, u->offset, u->bytes,
                        fmax(now_ms - u->used_ms, 0) / 1000,
                        u->offset > 0 ? "--upload-time" : "--upload-begin-time");
            srv_metrics_add(uploads->options.metrics, SRV_COUNT_UPLOAD_EXPIRED, 1);
        }
        remove_files(uploads, set);
    }
}

/* The catalog. */

/* False if bytes of the upload are missing. */
static bool is_complete(const struct srv_upload *upload, struct sp_error *err) {
    return upload->offset == upload->bytes || sp_fail(err, SP_ERR_NOT_READY, NULL,
                                                      "the upload of '%.100s' has %" PRIu64
                                                      " of %" PRIu64 " bytes; send the rest first",
                                                      upload->name, upload->offset, upload->bytes);
}

/* True if `upload` is the header or one of its companions. */
static bool is_in_set(const struct srv_upload *upload, const char *header) {
    return strcmp(upload->id, header) == 0 || strcmp(upload->header, header) == 0;
}

bool srv_upload_open(void *user, const char *id, char path[PATH_MAX],
                     char name[SRV_UPLOAD_NAME_BYTES], struct sp_error *err) {
    struct srv_uploads *uploads = user;
    char file[SRV_UPLOAD_PATH_BYTES];
    pthread_mutex_lock(&uploads->mutex);
    const struct srv_upload *upload = *srv_uploads_find(uploads, id);
    bool ok = upload || srv_upload_not_found(id, err);
    if (ok && upload->header[0])
        ok = sp_fail(err, SP_ERR_INVALID, NULL,
                     "'%.100s' has the samples of a header; open the upload of the header",
                     upload->name);
    for (const struct srv_upload *u = uploads->first; ok && u; u = u->next)
        ok = !is_in_set(u, id) || is_complete(u, err);
    for (struct srv_upload *u = uploads->first; ok && u; u = u->next)
        if (is_in_set(u, id)) {
            u->is_of_volume = true;
            u->writer = 0; /* a writer that is late changes nothing */
        }
    if (ok) {
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
    if (*at && end == SRV_UPLOAD_RETURNED) {
        for (struct srv_upload *u = uploads->first; u; u = u->next)
            if (is_in_set(u, id))
                u->is_of_volume = false;
    } else if (*at && (end == SRV_UPLOAD_UNUSED || !uploads->options.keeps_loaded)) {
        gone = unlink_set(uploads, at);
    }
    pthread_mutex_unlock(&uploads->mutex);
    remove_files(uploads, gone);
}
