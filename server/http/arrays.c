/* SPDX-License-Identifier: Apache-2.0 */
#include "http/arrays.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "sp/log.h"

struct array {
    char id[SRV_ARRAY_ID_BYTES]; /* "" = this place is free */
    char owner[SRV_TOKEN_NAME_BYTES];
    int fd;
    uint64_t bytes;
    double expires_ms;
};

struct srv_arrays {
    pthread_mutex_t mutex; /* guards what follows */
    struct array list[SRV_ARRAYS_MAX];
};

struct srv_arrays *srv_arrays_create(struct sp_error *err) {
    struct srv_arrays *arrays = calloc(1, sizeof *arrays);
    if (!arrays)
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the list of arrays");
    else
        pthread_mutex_init(&arrays->mutex, NULL);
    return arrays;
}

static void release(struct array *array) {
    close(array->fd);
    array->id[0] = 0;
}

void srv_arrays_destroy(struct srv_arrays **arrays) {
    if (!*arrays)
        return;
    for (int i = 0; i < SRV_ARRAYS_MAX; i++)
        if ((*arrays)->list[i].id[0])
            release(&(*arrays)->list[i]);
    pthread_mutex_destroy(&(*arrays)->mutex);
    free(*arrays);
    *arrays = NULL;
}

/* Returns the array with this id, NULL = there is none. With the mutex held. The time of the
 * comparison tells nothing: an id is of use only with the token that passed the array. */
static struct array *find(struct srv_arrays *arrays, const char *id) {
    for (int i = 0; i < SRV_ARRAYS_MAX; i++)
        if (arrays->list[i].id[0] && strcmp(arrays->list[i].id, id) == 0)
            return &arrays->list[i];
    return NULL;
}

bool srv_arrays_add(struct srv_arrays *arrays, int fd, uint64_t bytes, const char *owner,
                    double now_ms, char id[SRV_ARRAY_ID_BYTES], struct sp_error *err) {
    struct array *place = NULL;
    unsigned own = 0;
    if (!srv_secret_hex(id, SRV_ARRAY_ID_BYTES - 1, err))
        return false;
    pthread_mutex_lock(&arrays->mutex);
    for (int i = 0; i < SRV_ARRAYS_MAX; i++) {
        struct array *array = &arrays->list[i];
        if (!array->id[0])
            place = place ? place : array;
        else
            own += strcmp(array->owner, owner) == 0;
    }
    const bool fits = place && own < SRV_ARRAYS_OWNER_MAX;
    if (fits) {
        *place =
            (struct array){ .fd = fd, .bytes = bytes, .expires_ms = now_ms + SRV_ARRAY_WAIT_MS };
        snprintf(place->id, sizeof place->id, "%s", id);
        snprintf(place->owner, sizeof place->owner, "%s", owner);
    }
    pthread_mutex_unlock(&arrays->mutex);
    return fits || sp_fail(err, SP_ERR_QUOTA, NULL,
                           "%u arrays of %s wait to be opened as volumes, of %d that may wait, %d "
                           "per token; open them, or wait a minute, when they expire",
                           own, owner, SRV_ARRAYS_MAX, SRV_ARRAYS_OWNER_MAX);
}

int srv_arrays_open(struct srv_arrays *arrays, const char *id, const char *owner, uint64_t *bytes,
                    struct sp_error *err) {
    pthread_mutex_lock(&arrays->mutex);
    const struct array *array = find(arrays, id);
    int fd = -1;
    if (!array || strcmp(array->owner, owner) != 0) {
        sp_fail(err, SP_ERR_NOT_FOUND, "/memory",
                "there is no such array of this token: an id can be used once, within a minute");
    } else {
        fd = fcntl(array->fd, F_DUPFD_CLOEXEC, 0);
        *bytes = array->bytes;
        if (fd < 0)
            sp_fail(err, SP_ERR_IO, NULL, "cannot use the descriptor of the array: %s",
                    strerror(errno));
    }
    pthread_mutex_unlock(&arrays->mutex);
    return fd;
}

void srv_arrays_remove(struct srv_arrays *arrays, const char *id) {
    pthread_mutex_lock(&arrays->mutex);
    struct array *array = find(arrays, id);
    if (array)
        release(array);
    pthread_mutex_unlock(&arrays->mutex);
}

void srv_arrays_tick(struct srv_arrays *arrays, double now_ms) {
    pthread_mutex_lock(&arrays->mutex);
    for (int i = 0; i < SRV_ARRAYS_MAX; i++) {
        struct array *array = &arrays->list[i];
        if (!array->id[0] || array->expires_ms > now_ms)
            continue;
        sp_log(SP_LOG_INFO, "an array of %s expired: no request opened it", array->owner);
        release(array);
    }
    pthread_mutex_unlock(&arrays->mutex);
}
