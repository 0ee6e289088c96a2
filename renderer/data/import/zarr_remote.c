/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/zarr_remote.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>

#include "data/import/remote.h"

struct remote {
    struct zarr_store store;
    int socket;
    const char *memory;       /* mapped */
    char key[ZARR_KEY_BYTES]; /* of what the memory holds; "" = nothing */
    uint64_t offset, got, total;
    unsigned missing_status;
};

static bool talk(struct remote *r, const struct remote_request *request,
                 struct remote_reply *reply) {
    ssize_t n;
    do
        n = send(r->socket, request, sizeof *request, MSG_NOSIGNAL);
    while (n < 0 && errno == EINTR);
    if (n != (ssize_t)sizeof *request)
        return false;
    do
        n = recv(r->socket, reply, sizeof *reply, 0);
    while (n < 0 && errno == EINTR);
    reply->text[sizeof reply->text - 1] = 0;
    return n == (ssize_t)sizeof *reply && reply->magic == REMOTE_MAGIC;
}

/* Fetches bytes of an object into the memory. */
static enum zarr_found fetch(struct remote *r, const char *key, uint64_t offset, size_t size,
                             struct sp_error *err) {
    struct remote_request request = { .magic = REMOTE_MAGIC, .offset = offset };
    struct remote_reply reply;
    request.size = size < REMOTE_BUFFER ? (uint32_t)size : REMOTE_BUFFER;
    r->key[0] = 0;
    if (snprintf(request.key, sizeof request.key, "%s", key) >= (int)sizeof request.key)
        return ZARR_MISSING;
    if (!talk(r, &request, &reply)) {
        zarr_fail(&r->store, err, SP_ERR_IO, key, "", "the process that fetches it has ended");
        return ZARR_FAILED;
    }
    if (reply.found == REMOTE_MISSING) {
        r->missing_status = reply.status;
        return ZARR_MISSING;
    }
    if (reply.found != REMOTE_FOUND || reply.got > REMOTE_BUFFER) {
        const enum sp_code code = reply.code == SP_ERR_DENIED ? SP_ERR_DENIED : SP_ERR_IO;
        zarr_fail(&r->store, err, code, key, "", "%s", reply.text);
        return ZARR_FAILED;
    }
    snprintf(r->key, sizeof r->key, "%s", key);
    r->offset = offset;
    r->got = reply.got;
    r->total = reply.total;
    return ZARR_FOUND;
}

static enum zarr_found size_of(void *user, const char *key, uint64_t *size, struct sp_error *err) {
    struct remote *r = user;
    if (strcmp(r->key, key) != 0) {
        const enum zarr_found found = fetch(r, key, 0, REMOTE_BUFFER, err);
        if (found != ZARR_FOUND)
            return found;
    }
    *size = r->total;
    return ZARR_FOUND;
}

static enum zarr_found read_from(void *user, const char *key, uint64_t offset, void *out,
                                 size_t size, size_t *got, struct sp_error *err) {
    struct remote *r = user;
    *got = 0;
    while (*got < size) {
        const uint64_t at = offset + *got;
        const bool is_known = strcmp(r->key, key) == 0;
        if (is_known && at >= r->total)
            break;
        if (!is_known || at < r->offset || at - r->offset >= r->got) {
            const enum zarr_found found = fetch(r, key, at, size - *got, err);
            if (found != ZARR_FOUND)
                return found;
            if (r->got == 0)
                break;
        }
        const uint64_t left = r->got - (at - r->offset);
        const size_t part = left < size - *got ? (size_t)left : size - *got;
        memcpy((char *)out + *got, r->memory + (at - r->offset), part);
        *got += part;
    }
    return ZARR_FOUND;
}

struct zarr_store *zarr_remote_open(int socket, int memory, const char *title,
                                    struct sp_error *err) {
    struct remote *r = calloc(1, sizeof *r);
    void *mapped = r ? mmap(NULL, REMOTE_BUFFER, PROT_READ, MAP_SHARED, memory, 0) : MAP_FAILED;
    if (mapped == MAP_FAILED) {
        free(r);
        sp_fail(err, SP_ERR_MEMORY, title, "out of memory for what is fetched");
        return NULL;
    }
    r->memory = mapped;
    r->socket = socket;
    r->store = (struct zarr_store){ .user = r, .title = title, .size = size_of, .read = read_from };
    return &r->store;
}

void zarr_remote_close(struct zarr_store **store) {
    if (!*store)
        return;
    struct remote *r = (*store)->user;
    munmap((void *)(uintptr_t)r->memory, REMOTE_BUFFER);
    free(r);
    *store = NULL;
}

unsigned zarr_remote_status(const struct zarr_store *store) {
    const struct remote *r = store->user;
    return r->missing_status;
}
