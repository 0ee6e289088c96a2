/* SPDX-License-Identifier: Apache-2.0
 *
 * What the two halves of HTTP share: listener.c, which has sockets and threads, and request.c,
 * which has requests.
 */
#ifndef SRV_HTTP_LISTENER_PRIVATE_H
#define SRV_HTTP_LISTENER_PRIVATE_H

#include <pthread.h>

#include "http/listener.h"
#include "http/refusals.h"

struct srv_packed_asset;
struct srv_tls;

struct srv_http {
    struct srv_http_options options;
    struct MHD_Daemon *daemon;
    struct srv_tls *tls; /* NULL = the daemon listens itself */
    struct srv_deadlines *deadlines;
    struct srv_packed_asset *packed; /* the page and the contract */
    char address[SRV_ADDRESS_TEXT];
    int64_t connections; /* --connections, or what there are descriptors for */
    pthread_mutex_t mutex;
    pthread_cond_t idle;
    unsigned active; /* requests between headers and the end of the answer */
    bool draining;
};

/* How many connections may one host have? Somewhat more are accepted, to be told so. */
unsigned srv_http_connections_from(const struct srv_http *http, const struct sockaddr *host);

/* The library's callbacks for requests; user: the srv_http. */
void *srv_on_target(void *user, const char *target, struct MHD_Connection *connection);
enum MHD_Result srv_on_request(void *user, struct MHD_Connection *connection, const char *path,
                               const char *method, const char *version, const char *bytes,
                               size_t *size, void **state);
void srv_on_completed(void *user, struct MHD_Connection *connection, void **state,
                      enum MHD_RequestTerminationCode code);

#endif
