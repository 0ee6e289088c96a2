/* SPDX-License-Identifier: Apache-2.0 */
#include "http/listener.h"

#include <errno.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "common/clock.h"
#include "config/tokens.h"
#include "http/assets.h"
#include "http/connection_limits.h"
#include "http/listener_private.h"
#include "http/tls.h"
#include "http/unix_acceptor.h"
#include "render/frame_memory.h"
#include "sp/log.h"

enum {
    SPARE_FROM_HOST = 32, /* beyond --connections-per-address, to answer 429 */
    HANDSHAKE_RATE = 50   /* --handshake-rate, if it is 0 */
};

/* Connections. */

unsigned srv_http_connections_from(const struct srv_http *http, const struct sockaddr *host) {
    int64_t all = http->connections, few = http->options.config->connections_per_address;
    if (few == 0)
        few = srv_address_is_loopback(host) ? all : (all + 3) / 4;
    return (unsigned)(few < all ? few : all);
}

/* Connections that the daemon accepts from one host, including those that only get a 429. A client
 * that sends no request gets no answer but occupies a connection, so this limit bounds such clients
 * too. */
static unsigned accepted_from(void *user, const struct sockaddr *host) {
    const struct srv_http *http = user;
    return srv_http_connections_from(http, host) + SPARE_FROM_HOST;
}

static enum MHD_Result on_accept(void *user, const struct sockaddr *peer, socklen_t size) {
    (void)size;
    struct srv_http *http = user;
    size_t all, same_host;
    char text[SRV_ADDRESS_TEXT];
    srv_deadlines_count(http->deadlines, peer, &all, &same_host);
    if (same_host < accepted_from(http, peer))
        return MHD_YES;
    srv_address_to_text(peer, text);
    srv_connection_refused(http->options.metrics, SRV_REFUSED_ADDRESS,
                           "%s refused: it has %zu connections (--connections-per-address)", text,
                           same_host);
    return MHD_NO;
}

static void on_connection(void *user, struct MHD_Connection *connection, void **context,
                          enum MHD_ConnectionNotificationCode code) {
    struct srv_http *http = user;
    if (code == MHD_CONNECTION_NOTIFY_CLOSED) {
        if (*context)
            srv_deadlines_close(http->deadlines, *context);
        *context = NULL;
        return;
    }
    const union MHD_ConnectionInfo *fd =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD);
    const union MHD_ConnectionInfo *peer =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CLIENT_ADDRESS);
    *context = srv_deadlines_open(http->deadlines, fd ? fd->connect_fd : -1,
                                  peer ? peer->client_addr : NULL,
                                  srv_clock_ms() + (double)http->options.config->header_time_ms);
}

__attribute__((format(printf, 2, 0))) static void on_log(void *user, const char *format,
                                                         va_list args) {
    char line[512];
    vsnprintf(line, sizeof line, format, args);
    line[strcspn(line, "\n")] = 0;
    if (strstr(line,
               "resource limit")) /* clients wait in the backlog, and nothing else reports it */
        sp_log(SP_LOG_WARN, "no connection can be accepted for now: %s", line);
    else
        sp_log(SP_LOG_DEBUG, "libmicrohttpd: %s", line);
    srv_on_library_log(user);
}

/* Start and stop. */

/* Accepted connections inherit the socket options. */
static int open_socket(const struct srv_address *address, const struct srv_config *config,
                       struct sp_error *err) {
    char text[SRV_ADDRESS_TEXT];
    int on = 1;
    /* Detect dead peers early: a dead client never acknowledges, and the system would wait longer.
     */
    int64_t longest_ms = config->request_time_ms > config->stall_time_ms ? config->request_time_ms
                                                                         : config->stall_time_ms;
    unsigned unread_ms = (unsigned)longest_ms;
    srv_address_to_text((const struct sockaddr *)&address->storage, text);
    int fd = socket(address->storage.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fd >= 0 && setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) == 0 &&
        setsockopt(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, &unread_ms, sizeof unread_ms) == 0 &&
        bind(fd, (const struct sockaddr *)&address->storage, address->size) == 0 &&
        listen(fd, SOMAXCONN) == 0)
        return fd;
    int code = errno;
    if (fd >= 0)
        close(fd);
    if (code == EADDRINUSE)
        sp_fail(err, SP_ERR_IO, text,
                "the port is in use; another splatd may run there; choose one with --listen");
    else
        sp_fail(err, SP_ERR_IO, text, "cannot listen: %s", strerror(code));
    return -1;
}

static unsigned connections_max(const struct srv_http *http) {
    return (unsigned)(http->connections +
                      SRV_SPARE_CONNECTIONS * http->options.config->http_threads);
}

/* `fd` is a listening socket; MHD_INVALID_SOCKET = connections arrive through MHD_add_connection().
 */
static bool start(struct srv_http *http, int fd, struct sp_error *err) {
    const struct srv_config *config = http->options.config;
    struct MHD_OptionItem listening[] = {
        { fd < 0 ? MHD_OPTION_END : MHD_OPTION_LISTEN_SOCKET, fd, NULL },
        { MHD_OPTION_END, 0, NULL },
    };
    http->daemon = MHD_start_daemon(
        MHD_USE_EPOLL_INTERNAL_THREAD | MHD_ALLOW_UPGRADE | MHD_ALLOW_SUSPEND_RESUME |
            MHD_USE_ERROR_LOG | (fd < 0 ? MHD_USE_NO_LISTEN_SOCKET : 0),
        0, on_accept, http, srv_on_request, http, MHD_OPTION_EXTERNAL_LOGGER, on_log, http,
        MHD_OPTION_ARRAY, listening, MHD_OPTION_THREAD_POOL_SIZE, (unsigned)config->http_threads,
        MHD_OPTION_CONNECTION_LIMIT, connections_max(http), MHD_OPTION_CONNECTION_MEMORY_LIMIT,
        (size_t)config->header_size, MHD_OPTION_URI_LOG_CALLBACK, srv_on_target, http,
        MHD_OPTION_NOTIFY_COMPLETED, srv_on_completed, http, MHD_OPTION_NOTIFY_CONNECTION,
        on_connection, http, MHD_OPTION_END);
    return http->daemon || sp_fail(err, SP_ERR_IO, http->address, "cannot start the HTTP threads");
}

static bool on_tls_connection(void *user, int socket, const struct sockaddr *peer, socklen_t size) {
    struct srv_http *http = user;
    return MHD_add_connection(http->daemon, socket, peer, size) == MHD_YES;
}

static bool start_tls(struct srv_http *http, int fd, struct sp_error *err) {
    const struct srv_config *config = http->options.config;
    struct srv_tls_keys *keys = srv_tls_keys_create(config->tls_cert, config->tls_key, err);
    if (!keys || !start(http, MHD_INVALID_SOCKET, err)) {
        srv_tls_keys_unref(&keys);
        close(fd);
        return false;
    }
    struct srv_tls_options options = {
        .keys = keys,
        .socket = fd,
        .handshake_ms = (double)config->header_time_ms,
        .linger_ms = (double)config->request_time_ms,
        .handshakes_max = (unsigned)config->handshakes,
        .handshakes_per_s =
            config->handshake_rate ? (double)config->handshake_rate : HANDSHAKE_RATE,
        .spares_loopback = config->handshake_rate == 0,
        .connections_max = connections_max(http) + (unsigned)config->handshakes,
        .metrics = http->options.metrics,
        .user = http,
        .accepted_from = accepted_from,
        .give = on_tls_connection,
    };
    http->tls = srv_tls_create(&options, err);
    if (!http->tls) {
        srv_tls_keys_unref(&keys);
        close(fd);
    }
    return http->tls != NULL;
}

static void on_unix_connection(void *user, int socket, const struct sockaddr *peer,
                               socklen_t size) {
    struct srv_http *http = user;
    MHD_add_connection(http->daemon, socket, peer, size);
}

static bool start_unix(struct srv_http *http, const char *path, struct sp_error *err) {
    const struct srv_unix_options options = {
        .path = path,
        .wait_ms = (double)http->options.config->header_time_ms,
        .arrays = http->arrays = srv_arrays_create(err),
        .tokens = http->options.tokens,
        .metrics = http->options.metrics,
        .user = http,
        .give = on_unix_connection,
    };
    snprintf(http->unix_path, sizeof http->unix_path, "%s", path);
    http->unix_acceptor = http->arrays ? srv_unix_acceptor_create(&options, err) : NULL;
    return http->unix_acceptor != NULL;
}

/* Opens the TCP socket, if there is one, and starts the HTTP threads. */
static bool start_tcp(struct srv_http *http, struct srv_listen *listen, struct sp_error *err) {
    const struct srv_config *config = http->options.config;
    struct srv_address *address = &listen->tcp;
    if (!listen->has_tcp)
        return start(http, MHD_INVALID_SOCKET, err);
    int fd = open_socket(address, config, err);
    if (fd < 0)
        return false;
    getsockname(fd, (struct sockaddr *)&address->storage, &address->size);
    srv_address_to_text((const struct sockaddr *)&address->storage, http->address);
    if (config->tls_cert)
        return start_tls(http, fd, err);
    const bool ok = start(http, fd, err);
    if (!ok)
        close(fd);
    return ok;
}

static bool reload_tokens(struct srv_http *http, struct sp_error *err) {
    const char *file = http->options.config->token_file;
    struct srv_token *list;
    size_t count;
    return !file || (srv_token_file_read(file, &list, &count, err) &&
                     srv_tokens_set(http->options.tokens, list, count, err));
}

static bool reload_keys(struct srv_http *http, struct sp_error *err) {
    const struct srv_config *config = http->options.config;
    if (!http->tls)
        return true;
    struct srv_tls_keys *keys = srv_tls_keys_create(config->tls_cert, config->tls_key, err);
    if (keys)
        srv_tls_set_keys(http->tls, keys);
    return keys != NULL;
}

bool srv_http_reload(struct srv_http *http, struct sp_error *err) {
    bool tokens = reload_tokens(http, err);
    return reload_keys(http, err) && tokens;
}

struct srv_http *srv_http_create(const struct srv_http_options *options, struct sp_error *err) {
    struct srv_listen listen;
    if (!srv_listen_parse(options->config->listen, &listen, err))
        return NULL;
    struct srv_http *http = calloc(1, sizeof *http);
    if (!http) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for HTTP");
        return NULL;
    }
    http->options = *options;
    http->connections = srv_descriptors_fit(options->config);
    pthread_mutex_init(&http->mutex, NULL);
    srv_clock_cond_init(&http->idle);
    http->deadlines = srv_deadlines_create(err);
    http->answers =
        http->deadlines ? srv_answers_create(options->frame_memory->snapshots, err) : NULL;
    http->packed = http->answers ? srv_assets_pack(err) : NULL;
    const bool ok = http->packed && start_tcp(http, &listen, err) &&
                    (!listen.path[0] || start_unix(http, listen.path, err));
    if (!ok)
        srv_http_destroy(&http);
    return http;
}

const char *srv_http_address(const struct srv_http *http) {
    return http->address;
}

const char *srv_http_unix_path(const struct srv_http *http) {
    return http->unix_path;
}

size_t srv_http_connections(struct srv_http *http) {
    return srv_deadlines_connections(http->deadlines);
}

void srv_http_tick(void *user, double now_ms) {
    struct srv_http *http = user;
    srv_deadlines_sweep(http->deadlines, now_ms);
}

/* Does not call MHD_quiesce_daemon(), because it does not work with a thread pool: the threads add
 * and remove the listening socket in their own epoll sets, and the library aborts if it is removed
 * twice. */
void srv_http_close(struct srv_http *http) {
    pthread_mutex_lock(&http->mutex);
    http->draining = true;
    pthread_mutex_unlock(&http->mutex);
}

void srv_http_drain(struct srv_http *http, double limit_ms) {
    struct timespec until = srv_clock_at(srv_clock_ms() + limit_ms);
    pthread_mutex_lock(&http->mutex);
    while (http->active > 0)
        if (pthread_cond_timedwait(&http->idle, &http->mutex, &until) == ETIMEDOUT)
            break;
    if (http->active > 0)
        sp_log(SP_LOG_WARN, "%u requests were not answered within --drain-time", http->active);
    pthread_mutex_unlock(&http->mutex);
}

void srv_http_destroy(struct srv_http **http_pointer) {
    struct srv_http *http = *http_pointer;
    *http_pointer = NULL;
    if (!http)
        return;
    srv_unix_acceptor_destroy(&http->unix_acceptor);
    if (http->tls)
        srv_tls_close(http->tls); /* no connection may be added to a daemon that stops */
    if (http->daemon)
        MHD_stop_daemon(http->daemon);
    srv_tls_destroy(&http->tls);
    srv_deadlines_destroy(&http->deadlines);
    srv_answers_destroy(&http->answers);
    srv_arrays_destroy(&http->arrays);
    srv_assets_release(&http->packed);
    pthread_cond_destroy(&http->idle);
    pthread_mutex_destroy(&http->mutex);
    free(http);
}
