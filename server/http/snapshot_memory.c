/* SPDX-License-Identifier: Apache-2.0 */
#include "http/snapshot_memory.h"

#include <inttypes.h>
#include <pthread.h>
#include <stdlib.h>

struct srv_snapshot_memory {
    pthread_mutex_t mutex;
    uint64_t bytes, bytes_max;
};

struct srv_snapshot_memory *srv_snapshot_memory_create(uint64_t bytes_max, struct sp_error *err) {
    struct srv_snapshot_memory *memory = calloc(1, sizeof *memory);
    if (!memory) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while accounting for snapshots");
        return NULL;
    }
    pthread_mutex_init(&memory->mutex, NULL);
    memory->bytes_max = bytes_max;
    return memory;
}

void srv_snapshot_memory_destroy(struct srv_snapshot_memory **memory) {
    if (*memory)
        pthread_mutex_destroy(&(*memory)->mutex);
    free(*memory);
    *memory = NULL;
}

uint64_t srv_snapshot_memory_of(const struct sp_view *view, enum sp_image_format format) {
    unsigned px_bytes = sp_image_format_info(format)->wants_float ? 16 : 4;
    if (sp_view_draws_slices(view))
        px_bytes += 2 * 16;
    return (uint64_t)view->size[0] * view->size[1] * px_bytes;
}

bool srv_snapshot_memory_reserve(struct srv_snapshot_memory *memory, uint64_t bytes,
                                 struct sp_error *err) {
    pthread_mutex_lock(&memory->mutex);
    uint64_t others = memory->bytes;
    bool ok = others == 0 || others + bytes <= memory->bytes_max;
    if (ok)
        memory->bytes += bytes;
    pthread_mutex_unlock(&memory->mutex);
    return ok || sp_fail(err, SP_ERR_BUDGET, NULL,
                         "snapshots in progress have %" PRIu64 " bytes, this one needs %" PRIu64
                         ", and --render-bytes allows %" PRIu64 "; try again later",
                         others, bytes, memory->bytes_max);
}

void srv_snapshot_memory_change(struct srv_snapshot_memory *memory, uint64_t *bytes, uint64_t now) {
    pthread_mutex_lock(&memory->mutex);
    memory->bytes += now - *bytes;
    pthread_mutex_unlock(&memory->mutex);
    *bytes = now;
}
