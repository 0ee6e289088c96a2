/* SPDX-License-Identifier: Apache-2.0 */
#include "base/transfer.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

bool sp_read_at(int fd, void *out, size_t size, uint64_t at) {
    for (size_t done = 0; done < size;) {
        ssize_t n = pread(fd, (char *)out + done, size - done, (off_t)(at + done));
        if (n < 0 && errno == EINTR)
            continue;
        if (n <= 0) {
            errno = n == 0 ? ENODATA : errno;
            return false;
        }
        done += (size_t)n;
    }
    return true;
}

bool sp_write_at(int fd, const void *bytes, size_t size, uint64_t at) {
    for (size_t done = 0; done < size;) {
        ssize_t n = pwrite(fd, (const char *)bytes + done, size - done, (off_t)(at + done));
        if (n < 0 && errno == EINTR)
            continue;
        if (n <= 0)
            return false;
        done += (size_t)n;
    }
    return true;
}

void sp_skip_holes(int fd, uint64_t at, uint64_t end, uint64_t *from, uint64_t *to) {
    const off_t data = lseek(fd, (off_t)at, SEEK_DATA);
    *from = data >= 0 ? (uint64_t)data : errno == ENXIO ? end : at;
    *from = *from < end ? *from : end;
    const off_t hole = *from < end ? lseek(fd, (off_t)*from, SEEK_HOLE) : -1;
    *to = hole >= 0 && (uint64_t)hole < end ? (uint64_t)hole : end;
}

static bool is_within(int fd, uint64_t end) {
    struct stat st;
    return fstat(fd, &st) == 0 && (uint64_t)st.st_size >= end;
}

bool sp_read_sparse(int fd, void *out, size_t size, uint64_t at) {
    const uint64_t end = at + size;
    char *to = out;
    uint64_t from, next;
    if (!is_within(fd, end)) {
        errno = ENODATA;
        return false;
    }
    for (uint64_t done = at; done < end; done = next) {
        sp_skip_holes(fd, done, end, &from, &next);
        memset(to + (done - at), 0, (size_t)(from - done));
        if (!sp_read_at(fd, to + (from - at), (size_t)(next - from), from))
            return false;
    }
    return true;
}

bool sp_is_zero(const char *bytes, size_t size) {
    return bytes[0] == 0 && memcmp(bytes, bytes + 1, size - 1) == 0;
}

bool sp_write_sparse(int fd, const char *bytes, size_t size, uint64_t at) {
    const size_t block = 4096; /* of the holes of common file systems */
    for (size_t done = 0, next; done < size; done = next) {
        size_t end = done; /* of the blocks that are not 0 */
        for (next = done; next < size && end == next;) {
            const size_t left = size - next < block ? size - next : block;
            end += sp_is_zero(bytes + next, left) ? 0 : left;
            next += left;
        }
        if (end > done && !sp_write_at(fd, bytes + done, end - done, at + done))
            return false;
    }
    return true;
}

int sp_temporary_file(const char *folder, struct sp_error *err) {
    int fd = open(folder, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (fd < 0)
        sp_fail(err, SP_ERR_IO, folder, "cannot create a temporary file: %s", strerror(errno));
    return fd;
}

bool sp_is_hole(int fd, size_t size, uint64_t at) {
    uint64_t from, to;
    sp_skip_holes(fd, at, at + size, &from, &to);
    return from == at + size && is_within(fd, at + size);
}
