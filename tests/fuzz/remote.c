/* SPDX-License-Identifier: Apache-2.0
 *
 * The store of a remote hierarchy against a splat-fetch that answers anything (remote.h). The input
 * is a list of answers: which of three operations asks for it (1 byte), its struct remote_reply
 * but for the text, and a length and a part of the text. The memory holds the input.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include "data/import/remote.h"
#include "data/import/zarr_remote.h"

enum { ANSWERS_MAX = 16, READ_MAX = 3 << 19, HEAD = offsetof(struct remote_reply, text) };

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check(bool ok) {
    if (!ok)
        abort();
}

/* Sends the answers before they are asked for, and returns how many. */
static int answer(int socket, const uint8_t *data, size_t size, uint8_t operations[ANSWERS_MAX]) {
    int count = 0;
    for (size_t at = 0; count < ANSWERS_MAX && at + 1 + HEAD + 1 <= size; count++) {
        struct remote_reply reply = { .magic = 0 };
        memcpy(&reply, data + at + 1, HEAD);
        if (data[at] & 0x80)
            reply.magic = REMOTE_MAGIC;
        operations[count] = data[at];
        const size_t text = data[at + 1 + HEAD];
        at += 1 + HEAD + 1;
        const size_t part = text < size - at ? text : size - at;
        memset(reply.text, 'x', sizeof reply.text); /* not ended */
        memcpy(reply.text, data + at, part);
        at += part;
        if (send(socket, &reply, operations[count] & 0x40 ? part : sizeof reply, MSG_DONTWAIT) < 0)
            break;
    }
    return count;
}

static void ask(struct zarr_store *store, uint8_t operation, uint8_t *out) {
    struct sp_error err = { .code = SP_OK };
    const char *key = operation & 1 ? "0/0/0/0" : ".zattrs";
    uint64_t bytes = 0;
    size_t got = 0;
    enum zarr_found found;
    if (operation & 2) {
        found = store->size(store->user, key, &bytes, &err);
    } else {
        const uint64_t offset = operation & 4 ? UINT64_C(1) << (operation >> 3 & 7) * 7 : 0;
        found = store->read(store->user, key, offset, out, READ_MAX, &got, &err);
        check(got <= READ_MAX);
    }
    check(found != ZARR_FAILED || err.code != SP_OK);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    uint8_t operations[ANSWERS_MAX] = { 0 };
    int pair[2];
    struct sp_error err;
    const int memory = memfd_create("remote", MFD_CLOEXEC);
    uint8_t *out = malloc(READ_MAX);
    check(out && memory >= 0 && ftruncate(memory, REMOTE_BUFFER) == 0 &&
          socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) == 0);
    check(pwrite(memory, data, size < REMOTE_BUFFER ? size : REMOTE_BUFFER, 0) >= 0);
    const int count = answer(pair[1], data, size, operations);
    shutdown(pair[1], SHUT_WR); /* a call that waits for more than was sent fails */
    struct zarr_store *store = zarr_remote_open(pair[0], memory, "input", &err);
    for (int i = 0; store && i < count; i++)
        ask(store, operations[i], out);
    zarr_remote_close(&store);
    close(pair[0]);
    close(pair[1]);
    close(memory);
    free(out);
    return 0;
}
