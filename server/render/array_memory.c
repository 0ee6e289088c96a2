/* SPDX-License-Identifier: Apache-2.0 */
#include "render/array_memory.h"

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "config/secret.h"
#include "render/source.h"
#include "sp/shared_memory.h"

struct srv_array_memory *srv_array_memory_create(int fd, const struct sp_volume_info *info) {
    struct srv_array_memory *memory = malloc(sizeof *memory);
    if (memory) {
        memory->fd = fd;
        memory->info = *info;
    }
    return memory;
}

void srv_array_memory_destroy(struct srv_array_memory **memory) {
    if (*memory)
        close((*memory)->fd);
    free(*memory);
    *memory = NULL;
}

struct sp_volume *srv_array_memory_map(const struct srv_array_memory *memory, const char *name,
                                       bool (*reserve)(void *user, uint64_t bytes,
                                                       struct sp_error *err),
                                       void *user, struct sp_error *err) {
    struct sp_volume_info info = memory->info;
    const uint32_t *dims = info.grid.dims;
    const uint64_t bytes = (uint64_t)dims[0] * dims[1] * dims[2] * sp_type_size(info.type);
    snprintf(info.name, sizeof info.name, "%s", name);
    snprintf(info.source, sizeof info.source, SRV_SOURCE_MEMORY "%s", name);
    return reserve(user, bytes, err) ? sp_volume_map(&info, memory->fd, err) : NULL;
}

bool srv_array_memory_fingerprint(struct srv_fingerprint *fingerprint, struct sp_error *err) {
    char text[SRV_FINGERPRINT_TEXT];
    return srv_secret_hex(text, sizeof text - 1, err) && srv_fingerprint_decode(text, fingerprint);
}
