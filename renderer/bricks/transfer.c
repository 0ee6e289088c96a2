/* SPDX-License-Identifier: Apache-2.0 */
#include "bricks/transfer.h"

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

bool sp_write_sparse(int fd, const char *bytes, size_t size, uint64_t at) {
    const size_t block = (size_t)1 << 16;
    for (size_t done = 0; done < size; done += block) {
        const size_t left = size - done < block ? size - done : block;
        const bool is_zero =
            bytes[done] == 0 && memcmp(bytes + done, bytes + done + 1, left - 1) == 0;
        if (!is_zero && !sp_write_at(fd, bytes + done, left, at + done))
            return false;
    }
    return true;
}

int sp_bricks_temporary(const char *folder, struct sp_error *err) {
    int fd = open(folder, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (fd < 0)
        sp_fail(err, SP_ERR_IO, folder, "cannot create a temporary file: %s", strerror(errno));
    return fd;
}

bool sp_is_hole(int fd, size_t size, uint64_t at) {
    struct stat st;
    if (fstat(fd, &st) != 0 || (uint64_t)st.st_size < at + size)
        return false;
    const off_t data = lseek(fd, (off_t)at, SEEK_DATA);
    return data < 0 ? errno == ENXIO : (uint64_t)data >= at + size;
}
