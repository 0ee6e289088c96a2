/* SPDX-License-Identifier: Apache-2.0
 *
 * Volumes whose samples are the shared memory of another process.
 */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <linux/magic.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include "data/volume/volume.h"
#include "sp/shared_memory.h"

/* Samples of the histogram: counting all of 2^30 would take longer than copying them. */
#define COUNTED_MAX (UINT64_C(1) << 24)

/* A file whose pages can go away would end this process (SIGBUS) when it reads them: a file that
 * shrinks, one on a full file system, huge pages whose pool is empty. Samples that change would
 * break what a volume promises, and code that counts samples before it stores them. Only files of
 * memfd_create() without MFD_HUGETLB have both this file system and the seals. */
bool sp_shared_memory_check(int fd, uint64_t bytes, struct sp_error *err) {
    struct stat st;
    struct statfs system;
    if (fstat(fd, &st) != 0 || !S_ISREG(st.st_mode))
        return sp_fail(err, SP_ERR_INVALID, NULL,
                       "the descriptor is not shared memory; pass one of memfd_create()");
    if (fstatfs(fd, &system) != 0 || system.f_type != TMPFS_MAGIC)
        return sp_fail(err, SP_ERR_UNSUPPORTED, NULL,
                       "the descriptor is a file on a disk, or memory of huge pages; pass one of "
                       "memfd_create() without MFD_HUGETLB");
    const int seals = fcntl(fd, F_GET_SEALS), needed = F_SEAL_SHRINK | F_SEAL_WRITE;
    if (seals < 0 || (seals & needed) != needed)
        return sp_fail(err, SP_ERR_INVALID, NULL,
                       "the memory may still %s; create it with MFD_ALLOW_SEALING, and add "
                       "F_SEAL_SHRINK and F_SEAL_WRITE before you pass it",
                       seals > 0 && seals & F_SEAL_SHRINK ? "change" : "shrink");
    if (bytes == 0 || st.st_size < 0 || (uint64_t)st.st_size < bytes)
        return sp_fail(err, SP_ERR_INVALID, NULL,
                       "the memory has %" PRIu64 " bytes and the array is said to have %" PRIu64
                       "; an array has at least one byte and begins at the start of the memory",
                       (uint64_t)st.st_size, bytes);
    return true;
}

bool sp_volume_map_check(const struct sp_volume_info *info, uint64_t bytes, struct sp_error *err) {
    static const char *const members[] = {
        [SP_GRID_GOOD] = "/dims",       [SP_GRID_DIMS] = "/dims",
        [SP_GRID_SPACING] = "/spacing", [SP_GRID_COORDINATES] = "/coordinates",
        [SP_GRID_ORIGIN] = "/origin",   [SP_GRID_DIRECTION] = "/direction"
    };
    const char *place = members[sp_grid_invalid_field(&info->grid)];
    uint64_t needed;
    struct sp_error why;
    if (!sp_grid_check(&info->grid, info->type, place, &needed, &why))
        return sp_fail(err, SP_ERR_INVALID, place, "%s", why.text);
    return needed == bytes || sp_fail(err, SP_ERR_INVALID, place,
                                      "dims and type give %" PRIu64 " bytes, and the array has "
                                      "%" PRIu64,
                                      needed, bytes);
}

static void release_mapping(void *voxels, size_t bytes) {
    munmap(voxels, bytes);
}

struct sp_volume *sp_volume_map(const struct sp_volume_info *info, int fd, struct sp_error *err) {
    uint64_t bytes;
    if (!sp_grid_check(&info->grid, info->type, info->source, &bytes, err) ||
        !sp_shared_memory_check(fd, bytes, err))
        return NULL;
    void *voxels = mmap(NULL, bytes, PROT_READ, MAP_SHARED, fd, 0);
    if (voxels == MAP_FAILED) {
        sp_fail(err, SP_ERR_MEMORY, info->source, "cannot map %" PRIu64 " bytes of samples: %s",
                bytes, strerror(errno));
        return NULL;
    }
    return sp_volume_adopt_quickly(info, voxels, bytes, COUNTED_MAX, release_mapping, err);
}
