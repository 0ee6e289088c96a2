/* SPDX-License-Identifier: Apache-2.0
 *
 * Volumes whose samples are shared memory of another process (memfd_create(2)). All functions are
 * thread-safe.
 */
#ifndef SP_SHARED_MEMORY_H
#define SP_SHARED_MEMORY_H

#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Checks shared memory of another process, whose file descriptor is `fd`, before it is mapped:
 * memory of memfd_create(), without MFD_HUGETLB, with F_SEAL_SHRINK and F_SEAL_WRITE, and with
 * `bytes` bytes at least. Other files could lose pages while this process reads them, which would
 * end it, or change. SP_ERR_INVALID, SP_ERR_UNSUPPORTED. */
SP_API bool sp_shared_memory_check(int fd, uint64_t bytes, struct sp_error *err);

/* Checks the description of an array of `bytes` bytes, as JSON of a client gives it: SP_ERR_INVALID
 * with a place such as "/spacing". */
SP_API bool sp_volume_map_check(const struct sp_volume_info *info, uint64_t bytes,
                                struct sp_error *err);

/* Makes a volume whose samples are shared memory, without copying them. `info` gives grid, type,
 * meaning, units, names and source, as in sp_volume_create(); everything else is computed. The
 * samples begin at byte 0 of the memory, which is checked by sp_shared_memory_check(). `fd` stays
 * the caller's and may be closed. Returns one reference, or NULL: SP_ERR_FORMAT (grid),
 * SP_ERR_INVALID, SP_ERR_UNSUPPORTED, SP_ERR_MEMORY. */
SP_API struct sp_volume *sp_volume_map(const struct sp_volume_info *info, int fd,
                                       struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
