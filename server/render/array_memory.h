/* SPDX-License-Identifier: Apache-2.0
 *
 * The shared memory of a client, from the request to open it as a volume until it is mapped. The
 * volume keeps the mapping; the descriptor is closed.
 */
#ifndef SRV_RENDER_ARRAY_MEMORY_H
#define SRV_RENDER_ARRAY_MEMORY_H

#include "render/fingerprint.h"
#include "sp/volume.h"

struct srv_array_memory {
    int fd;                     /* owned */
    struct sp_volume_info info; /* grid, type, meaning and units */
};

/* Makes the memory from a descriptor, which it owns on success. NULL = out of memory. */
struct srv_array_memory *srv_array_memory_create(int fd, const struct sp_volume_info *info);
void srv_array_memory_destroy(struct srv_array_memory **memory); /* accepts NULL */

/* Maps the memory as a volume called `name`. reserve() and its `user` are those of struct
 * sp_load_options. NULL with *err set. */
struct sp_volume *srv_array_memory_map(const struct srv_array_memory *memory, const char *name,
                                       bool (*reserve)(void *user, uint64_t bytes,
                                                       struct sp_error *err),
                                       void *user, struct sp_error *err);

/* The fingerprint of such a volume is random, because hashing its samples would take longer than
 * mapping and measuring them. */
bool srv_array_memory_fingerprint(struct srv_fingerprint *fingerprint, struct sp_error *err);

#endif
