/* SPDX-License-Identifier: Apache-2.0 */
#include "http/unix_passing.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "config/tokens.h"
#include "http/reply.h"
#include "sp/log.h"
#include "sp/shared_memory.h"

enum { DESCRIPTORS = 4, DISCARDED = 4096 };

void srv_passing_init(struct srv_passing *passing) {
    *passing = (struct srv_passing){ .fd = -1 };
}

void srv_passing_finish(struct srv_passing *passing) {
    if (passing->fd >= 0)
        close(passing->fd);
    passing->fd = -1;
}

/* Keeps the first descriptor of a message and closes others. */
static void read_descriptors(struct srv_passing *passing, struct msghdr *message) {
    if (message->msg_flags & MSG_CTRUNC)
        passing->has_too_many = true;
    for (struct cmsghdr *c = CMSG_FIRSTHDR(message); c; c = CMSG_NXTHDR(message, c)) {
        if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SCM_RIGHTS)
            continue;
        const size_t count = (c->cmsg_len - CMSG_LEN(0)) / sizeof(int);
        for (size_t i = 0; i < count; i++) {
            int fd;
            memcpy(&fd, CMSG_DATA(c) + i * sizeof fd, sizeof fd);
            if (passing->fd < 0) {
                passing->fd = fd;
                continue;
            }
            passing->has_too_many = true;
            close(fd);
        }
    }
}

/* Returns the result of recvmsg(): the bytes that came, 0 at the end, or −1 with errno. */
static ssize_t receive(struct srv_passing *passing, int socket) {
    union {
        struct cmsghdr align;
        char bytes[CMSG_SPACE(DESCRIPTORS * sizeof(int))];
    } control;
    struct iovec part = { passing->bytes + passing->size, sizeof passing->bytes - passing->size };
    struct msghdr message = {
        .msg_iov = &part, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control
    };
    const ssize_t came = recvmsg(socket, &message, MSG_DONTWAIT | MSG_CMSG_CLOEXEC);
    if (came >= 0)
        read_descriptors(passing, &message);
    if (came > 0)
        passing->size += (size_t)came;
    return came;
}

/* Sends the answer. The socket is fresh, so its buffer takes the whole of it. What the client has
 * sent beyond the message is read first, because closing the socket with unread bytes would show
 * the client an error in place of the end. */
static void answer(int socket, proto_json *json) {
    char discarded[DISCARDED];
    size_t size;
    char *text = proto_json_to_text(json, &size);
    const ssize_t ignored = recv(socket, discarded, sizeof discarded, MSG_DONTWAIT);
    (void)ignored;
    if (!text || send(socket, text, size, MSG_DONTWAIT | MSG_NOSIGNAL) != (ssize_t)size)
        sp_log(SP_LOG_DEBUG, "a client that passed an array did not get its answer");
    free(text);
    proto_json_free(&json);
}

static void refuse(int socket, unsigned peer, unsigned status, const char *detail) {
    proto_json *json = proto_json_object();
    proto_json_set_integer(&json, "status", status);
    proto_json_set_string(&json, "detail", detail);
    sp_log(SP_LOG_WARN, "array of user %u refused: %u, %s", peer, status, detail);
    answer(socket, json);
}

/* Adds the array for the owner of the token. */
static bool add(struct srv_passing *passing, const struct proto_array_hello *hello,
                struct srv_arrays *arrays, struct srv_tokens *tokens, double now_ms,
                char id[SRV_ARRAY_ID_BYTES], unsigned *status, struct sp_error *err) {
    struct srv_grant grant;
    srv_tokens_acquire(tokens, hello->token, &grant);
    *status = 0;
    bool ok = grant.rights & SRV_RIGHT_CONTROL;
    if (!ok) {
        *status = grant.rights ? 403 : 401;
        sp_fail(err, SP_ERR_DENIED, NULL,
                grant.rights ? "the role of this token does not include opening volumes"
                             : "the daemon does not know this token");
    } else if (passing->fd < 0 || passing->has_too_many) {
        ok = sp_fail(err, SP_ERR_INVALID, NULL,
                     "%s descriptor came with the message; send exactly one with SCM_RIGHTS",
                     passing->has_too_many ? "more than one" : "no");
    } else {
        ok = sp_shared_memory_check(passing->fd, hello->bytes, err) &&
             srv_arrays_add(arrays, passing->fd, hello->bytes, grant.name, now_ms, id, err);
    }
    srv_tokens_release(tokens, &grant);
    return ok;
}

bool srv_passing_receive(struct srv_passing *passing, int socket, unsigned peer,
                         struct srv_arrays *arrays, struct srv_tokens *tokens, double now_ms) {
    struct proto_array_hello hello;
    struct sp_error err;
    unsigned status = 0;
    char id[SRV_ARRAY_ID_BYTES];
    const ssize_t came = receive(passing, socket);
    if (came < 0)
        return errno != EAGAIN && errno != EINTR;
    size_t size = passing->size;
    if (peer != geteuid()) {
        refuse(socket, peer, 403,
               "the daemon runs as another user; arrays pass between programs of one user only");
        return true;
    }
    if (!proto_array_hello_decode(passing->bytes, &size, &hello, &err)) {
        if (err.code == SP_ERR_NOT_READY && came > 0)
            return false;
        refuse(socket, peer, 400, err.text);
    } else if (!add(passing, &hello, arrays, tokens, now_ms, id, &status, &err)) {
        refuse(socket, peer, status ? status : srv_status_from(err.code), err.text);
    } else {
        passing->fd = -1; /* owned by the list */
        proto_json *json = proto_json_object();
        proto_json_set_string(&json, "memory", id);
        answer(socket, json);
    }
    return true;
}
