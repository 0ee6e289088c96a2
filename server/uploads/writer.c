/* SPDX-License-Identifier: Apache-2.0
 *
 * Writers: bytes from a request to the disk.
 */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <string.h>
#include <unistd.h>

#include "sp/log.h"
#include "uploads/uploads_private.h"

#define SAVE_BYTES (UINT64_C(64) << 20) /* received between two records of the offset */

bool srv_upload_begin(struct srv_uploads *uploads, const char *id, const char *by, uint64_t offset,
                      uint64_t size, bool is_atomic, struct srv_upload_writer *writer, uint64_t *at,
                      struct sp_error *err) {
    bool ok = true;
    pthread_mutex_lock(&uploads->mutex);
    struct srv_upload *upload = srv_uploads_find_by(uploads, id, by);
    if (!upload) {
        ok = srv_upload_not_found(id, err);
    } else if (upload->offset != offset) {
        *at = upload->offset;
        ok = sp_fail(err, SP_ERR_INVALID, NULL,
                     "the upload has %" PRIu64 " bytes; continue there instead of at %" PRIu64,
                     upload->offset, offset);
    } else if (size > upload->bytes - offset) {
        ok = sp_fail(err, SP_ERR_TOO_LARGE, NULL,
                     "%" PRIu64 " bytes are missing and the request has %" PRIu64
                     "; the upload was declared with %" PRIu64,
                     upload->bytes - offset, size, upload->bytes);
    } else {
        *writer = (struct srv_upload_writer){ .uploads = uploads,
                                              .number = ++uploads->next_writer,
                                              .start = offset,
                                              .position = offset,
                                              .is_atomic = is_atomic,
                                              .fd = -1 };
        memcpy(writer->id, upload->id, sizeof writer->id);
        upload->writer = writer->number;
    }
    pthread_mutex_unlock(&uploads->mutex);
    return ok;
}

/* Returns the upload if the writer may still write to it. With the mutex held. */
static struct srv_upload *upload_of(const struct srv_upload_writer *writer, struct sp_error *err) {
    struct srv_upload *upload = *srv_uploads_find(writer->uploads, writer->id);
    if (!upload) {
        srv_upload_not_found(writer->id, err);
    } else if (upload->writer != writer->number) {
        sp_fail(err, SP_ERR_CANCELLED, NULL, "another request continues this upload");
        upload = NULL;
    }
    return upload;
}

/* Writes all bytes at the writer's position. A file that the writer does not own is never touched:
 * the caller has checked that, and only the disk thread writes. */
static bool write_all(struct srv_upload_writer *writer, const char *bytes, size_t size,
                      struct sp_error *err) {
    for (uint64_t at = writer->position; size > 0;) {
        ssize_t n = pwrite(writer->fd, bytes, size, (off_t)at);
        if (n < 0 && errno == EINTR)
            continue;
        if (n == 0)
            errno = ENOSPC;
        if (n <= 0)
            return srv_upload_disk_error("write", err);
        bytes += n;
        size -= (size_t)n;
        at += (uint64_t)n;
    }
    return true;
}

/* Copies the upload, as far as the files need it. False: the writer may not write. */
static bool look_up(const struct srv_upload_writer *writer, struct srv_upload *copy,
                    struct sp_error *err) {
    pthread_mutex_lock(&writer->uploads->mutex);
    const struct srv_upload *upload = upload_of(writer, err);
    if (upload)
        *copy = *upload;
    pthread_mutex_unlock(&writer->uploads->mutex);
    return upload != NULL;
}

/* Notes that bytes came, whether they count or not: the upload expires later. With the mutex held.
 */
static void note_use(const struct srv_upload_writer *writer, struct srv_upload *upload,
                     double now_ms) {
    struct srv_upload *header =
        upload->header[0] ? *srv_uploads_find(writer->uploads, upload->header) : NULL;
    upload->is_begun = true;
    upload->used_ms = now_ms;
    if (header)
        header->used_ms = now_ms;
}

/* Counts the bytes up to the writer's position, unless their checksum is not known yet. */
static bool note_bytes(const struct srv_upload_writer *writer, double now_ms,
                       struct srv_upload *copy, struct sp_error *err) {
    pthread_mutex_lock(&writer->uploads->mutex);
    struct srv_upload *upload = upload_of(writer, err);
    if (upload) {
        note_use(writer, upload, now_ms);
        if (!writer->is_atomic)
            upload->offset = writer->position;
        *copy = *upload;
    }
    pthread_mutex_unlock(&writer->uploads->mutex);
    return upload != NULL;
}

/* Counts the bytes up to the writer's position. A request without bytes keeps no upload alive. */
static bool advance(const struct srv_upload_writer *writer, struct srv_upload *copy,
                    struct sp_error *err) {
    pthread_mutex_lock(&writer->uploads->mutex);
    struct srv_upload *upload = upload_of(writer, err);
    if (upload) {
        upload->offset = writer->position;
        *copy = *upload;
    }
    pthread_mutex_unlock(&writer->uploads->mutex);
    return upload != NULL;
}

static bool open_data(struct srv_upload_writer *writer, const struct srv_upload *upload,
                      struct sp_error *err) {
    char path[SRV_UPLOAD_PATH_BYTES];
    if (writer->fd >= 0)
        return true;
    srv_upload_path(writer->uploads, upload, path);
    writer->fd = open(path, O_WRONLY | O_NOFOLLOW | O_CLOEXEC);
    return writer->fd >= 0 || srv_upload_disk_error("open", err);
}

/* Records the offset. The bytes before it are on the disk first: also after a crash of the machine,
 * no byte counts that is not there. */
static bool save(const struct srv_upload_writer *writer, const struct srv_upload *upload,
                 struct sp_error *err) {
    if (writer->fd >= 0 && !writer->uploads->is_private && fdatasync(writer->fd) != 0)
        return srv_upload_disk_error("write", err);
    return srv_upload_files_save(writer->uploads, upload, !writer->uploads->is_private, err);
}

bool srv_upload_write(struct srv_upload_writer *writer, const void *bytes, size_t size,
                      double now_ms, struct sp_error *err) {
    struct srv_upload upload;
    if (!look_up(writer, &upload, err))
        return false;
    if (size > upload.bytes - writer->position)
        return sp_fail(err, SP_ERR_TOO_LARGE, NULL,
                       "the request has more bytes than the %" PRIu64
                       " with which the upload was declared",
                       upload.bytes);
    if (!open_data(writer, &upload, err) || !write_all(writer, bytes, size, err))
        return false;
    srv_metrics_add(writer->uploads->options.metrics, SRV_COUNT_UPLOAD_BYTES, size);
    uint64_t before = writer->position;
    writer->position += size;
    if (!note_bytes(writer, now_ms, &upload, err))
        return false;
    bool is_due = before / SAVE_BYTES != writer->position / SAVE_BYTES && !writer->is_atomic;
    if (is_due && !writer->uploads->is_private)
        save(writer, &upload, NULL); /* only limits what a crash costs */
    return true;
}

static void log_complete(const struct srv_upload_writer *writer, const struct srv_upload *upload) {
    if (writer->start == upload->bytes)
        return; /* an empty request after the end */
    sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "upload", upload->id }),
                "upload %s of %s is complete: %s, %" PRIu64 " bytes", upload->id, upload->owner,
                upload->name, upload->bytes);
    srv_metrics_add(writer->uploads->options.metrics, SRV_COUNT_UPLOAD_COMPLETE, 1);
}

static bool finish(struct srv_upload_writer *writer, bool keeps, double now_ms,
                   struct srv_upload_info *info, struct sp_error *err) {
    struct srv_upload upload;
    if (!look_up(writer, &upload, err))
        return false;
    if (!keeps && writer->is_atomic) {
        if (writer->fd >= 0 && ftruncate(writer->fd, (off_t)writer->start) != 0)
            sp_log(SP_LOG_WARN, "cannot give back the space of refused bytes of upload %s",
                   writer->id);
        writer->position = writer->start;
    }
    if (!advance(writer, &upload, err) || !save(writer, &upload, err))
        return false;
    if (upload.offset == upload.bytes)
        log_complete(writer, &upload);
    srv_upload_describe(writer->uploads, &upload, now_ms, info);
    return true;
}

bool srv_upload_end(struct srv_upload_writer *writer, bool keeps, double now_ms,
                    struct srv_upload_info *info, struct sp_error *err) {
    bool ok = finish(writer, keeps, now_ms, info, err);
    if (writer->fd >= 0)
        close(writer->fd);
    writer->fd = -1;
    return ok;
}
