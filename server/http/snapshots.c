/* SPDX-License-Identifier: Apache-2.0 */
#include "http/snapshots.h"

#include <inttypes.h>
#include <pthread.h>
#include <stdlib.h>

struct srv_stills {
    pthread_mutex_t mutex;
    uint64_t bytes, bytes_max;
};

struct srv_stills *srv_stills_create(uint64_t bytes_max, struct sp_error *err) {
    struct srv_stills *stills = calloc(1, sizeof *stills);
    if (!stills) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for the account of pictures");
        return NULL;
    }
    pthread_mutex_init(&stills->mutex, NULL);
    stills->bytes_max = bytes_max;
    return stills;
}

void srv_stills_destroy(struct srv_stills **stills) {
    if (*stills)
        pthread_mutex_destroy(&(*stills)->mutex);
    free(*stills);
    *stills = NULL;
}

uint64_t srv_stills_bytes(const uint32_t size[2], enum sp_image_format format) {
    unsigned px_bytes = sp_image_format_info(format)->wants_float ? 16 : 4;
    return (uint64_t)size[0] * size[1] * px_bytes;
}

bool srv_stills_take(struct srv_stills *stills, uint64_t bytes, struct sp_error *err) {
    pthread_mutex_lock(&stills->mutex);
    uint64_t others = stills->bytes;
    bool ok = others == 0 || others + bytes <= stills->bytes_max;
    if (ok)
        stills->bytes += bytes;
    pthread_mutex_unlock(&stills->mutex);
    return ok || sp_fail(err, SP_ERR_BUDGET, NULL,
                         "pictures under way have %" PRIu64 " bytes, this one takes %" PRIu64
                         ", and --render-bytes allows %" PRIu64 "; try again later",
                         others, bytes, stills->bytes_max);
}

void srv_stills_change(struct srv_stills *stills, uint64_t *bytes, uint64_t now) {
    pthread_mutex_lock(&stills->mutex);
    stills->bytes += now - *bytes;
    pthread_mutex_unlock(&stills->mutex);
    *bytes = now;
}
