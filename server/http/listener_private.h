/* SPDX-License-Identifier: Apache-2.0
 *
 * State that the listener (sockets and threads) and the requests share.
 */
#ifndef SRV_HTTP_LISTENER_PRIVATE_H
#define SRV_HTTP_LISTENER_PRIVATE_H

#include <microhttpd.h>
#include <pthread.h>

#include "http/answers.h"
#include "http/connection_limits.h"
#include "http/deadlines.h"
#include "http/listener.h"

struct srv_packed_asset;
struct srv_request;
struct srv_tls;
struct srv_arrays;
struct srv_unix_acceptor;

struct srv_http {
    struct srv_http_options options;
    struct MHD_Daemon *daemon;
    struct srv_tls *tls;                     /* NULL = the daemon listens itself */
    struct srv_unix_acceptor *unix_acceptor; /* NULL = there is no Unix socket */
    struct srv_arrays *arrays;               /* NULL = there is no Unix socket */
    struct srv_deadlines *deadlines;
    struct srv_answers *answers;
    struct srv_packed_asset *packed;     /* the page and the contract */
    char address[SRV_ADDRESS_TEXT];      /* of TCP, with the real port; "" = none */
    char unix_path[SRV_UNIX_PATH_BYTES]; /* "" = none */
    int64_t connections; /* --connections, or as many as there are file descriptors for */
    pthread_mutex_t mutex;
    pthread_cond_t idle;
    struct srv_request *heads; /* that the library reads (head_errors.h) */
    unsigned active;           /* requests between headers and the end of the answer */
    bool draining;
};

/* Returns how many connections one host may have. A few more are accepted, to answer them with 429.
 */
unsigned srv_http_connections_from(const struct srv_http *http, const struct sockaddr *host);

/* Callbacks of libmicrohttpd for requests; `user` is the srv_http. */
void *srv_on_target(void *user, const char *target, struct MHD_Connection *connection);
enum MHD_Result srv_on_request(void *user, struct MHD_Connection *connection, const char *path,
                               const char *method, const char *version, const char *bytes,
                               size_t *size, void **state);
void srv_on_library_log(struct srv_http *http); /* head_errors.h */
void srv_on_completed(void *user, struct MHD_Connection *connection, void **state,
                      enum MHD_RequestTerminationCode code);

#endif
