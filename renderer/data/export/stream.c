/* SPDX-License-Identifier: Apache-2.0 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zlib.h>

#include "base/transfer.h"
#include "data/export/job.h"

enum { BLOCK_BYTES = 4 << 20, PACKED_BUFFER = 1 << 18 };

struct stream {
    const struct sp_export_job *job;
    gzFile packed; /* NULL = the file has the bytes as they are */
    uint64_t at;
};

bool sp_export_report(const struct sp_export_job *job, double fraction, struct sp_error *err) {
    return !job->progress || job->progress(job->user, fraction) ||
           sp_fail(err, SP_ERR_CANCELLED, job->title, "cancelled");
}

static bool fail_write(const struct stream *s, struct sp_error *err) {
    return sp_fail(err, SP_ERR_IO, s->job->title, "cannot write: %s",
                   errno ? strerror(errno) : "the data cannot be packed");
}

static bool put(struct stream *s, const void *bytes, size_t size, struct sp_error *err) {
    errno = 0;
    const bool ok = s->packed ? gzwrite(s->packed, bytes, (unsigned)size) == (int)size
                              : sp_write_sparse(s->job->out, bytes, size, s->at);
    s->at += size;
    return ok || fail_write(s, err);
}

static bool open_packed(struct stream *s, struct sp_error *err) {
    const int fd = dup(s->job->out);
    s->packed = fd < 0 ? NULL : gzdopen(fd, "wb1"); /* the fastest level, as nibabel's */
    if (s->packed)
        return gzbuffer(s->packed, PACKED_BUFFER) == 0;
    if (fd >= 0)
        close(fd);
    return sp_fail(err, SP_ERR_MEMORY, s->job->title, "out of memory for gzip");
}

static bool put_samples(struct stream *s, struct sp_error *err) {
    const struct sp_volume_info *info = s->job->info;
    const uint32_t *dims = info->grid.dims;
    const uint64_t size = (uint64_t)dims[0] * dims[1] * dims[2] * sp_type_size(info->type);
    char *block = malloc(BLOCK_BYTES);
    bool ok = block || sp_fail(err, SP_ERR_MEMORY, s->job->title, "out of memory");
    for (uint64_t at = 0; ok && at < size; at += BLOCK_BYTES) {
        const size_t part = size - at < BLOCK_BYTES ? (size_t)(size - at) : BLOCK_BYTES;
        if (!sp_read_sparse(s->job->samples, block, part, at))
            ok = sp_fail(err, SP_ERR_IO, s->job->title, "cannot read the samples: %s",
                         strerror(errno));
        ok = ok && put(s, block, part, err) &&
             sp_export_report(s->job, (double)at / (double)size, err);
    }
    free(block);
    return ok;
}

bool sp_export_stream(const struct sp_export_job *job, const void *header, size_t size,
                      bool is_packed, struct sp_error *err) {
    struct stream s = { .job = job };
    bool ok =
        (!is_packed || open_packed(&s, err)) && put(&s, header, size, err) && put_samples(&s, err);
    errno = 0;
    if (s.packed && gzclose_w(s.packed) != Z_OK && ok)
        ok = fail_write(&s, err);
    if (ok && ((!is_packed && ftruncate(job->out, (off_t)s.at) != 0) || fsync(job->out) != 0))
        ok = fail_write(&s, err); /* the file may end with a hole */
    return ok && sp_export_report(job, 1, err);
}
