/* SPDX-License-Identifier: Apache-2.0 */
#include "http/head_errors.h"

#include <stdio.h>
#include <sys/socket.h>

#include "http/listener_private.h"
#include "http/request_checks.h"

void srv_head_begin(struct srv_request *request) {
    struct srv_http *http = request->http;
    pthread_mutex_lock(&http->mutex);
    request->head_thread = pthread_self();
    request->next_head = http->heads;
    http->heads = request;
    pthread_mutex_unlock(&http->mutex);
}

void srv_head_end(struct srv_request *request) {
    struct srv_http *http = request->http;
    pthread_mutex_lock(&http->mutex);
    struct srv_request **at = &http->heads;
    while (*at && *at != request)
        at = &(*at)->next_head;
    if (*at)
        *at = request->next_head;
    pthread_mutex_unlock(&http->mutex);
}

/* The library has no size of a head that it is still reading. */
static bool is_complete(const struct srv_request *request) {
    return MHD_get_connection_info(request->mhd, MHD_CONNECTION_INFO_REQUEST_HEADER_SIZE) != NULL;
}

static struct srv_request *find_request(struct srv_http *http) {
    pthread_mutex_lock(&http->mutex);
    struct srv_request *request = http->heads;
    while (request &&
           !(pthread_equal(request->head_thread, pthread_self()) && is_complete(request)))
        request = request->next_head;
    pthread_mutex_unlock(&http->mutex);
    return request;
}

static void answer(struct srv_request *request) {
    const union MHD_ConnectionInfo *fd =
        MHD_get_connection_info(request->mhd, MHD_CONNECTION_INFO_CONNECTION_FD);
    const struct srv_reply *reply = &request->reply;
    char head[512];
    const int size =
        snprintf(head, sizeof head,
                 "HTTP/1.1 %u %s\r\nConnection: close\r\nContent-Type: %s\r\n"
                 "X-Content-Type-Options: nosniff\r\nContent-Length: %zu\r\n\r\n",
                 reply->status, MHD_get_reason_phrase_for(reply->status), reply->mime, reply->size);
    struct iovec parts[] = { { head, (size_t)size },
                             { (void *)(uintptr_t)reply->body, reply->size } };
    const struct msghdr message = { .msg_iov = parts, .msg_iovlen = 2 };
    if (fd && sendmsg(fd->connect_fd, &message, MSG_NOSIGNAL | MSG_DONTWAIT) > 0)
        shutdown(fd->connect_fd, SHUT_WR);
}

void srv_on_library_log(struct srv_http *http) {
    struct srv_request *request = find_request(http);
    if (!request || !srv_request_has_bad_head(request))
        return;
    srv_head_end(request);
    answer(request);
}
