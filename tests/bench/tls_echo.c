/* SPDX-License-Identifier: Apache-2.0
 *
 * The TLS acceptor with an echo server behind it, for measurements by tls_echo.mjs. Prints its port
 * and runs until its standard input ends.
 *
 *   splat-tls-echo CERTIFICATE KEY
 */
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <unistd.h>

#include "http/tls.h"

enum { CHUNK_BYTES = 256 * 1024 };

/* Echoes until the peer ends: writes everything that was read before it reads more. */
static void *echo_main(void *user) {
    int *socket = user;
    char *bytes = malloc(CHUNK_BYTES);
    struct pollfd look = { .fd = *socket };
    ssize_t got = bytes ? 1 : 0;
    while (got > 0) {
        look.events = POLLIN;
        poll(&look, 1, -1);
        got = recv(*socket, bytes, CHUNK_BYTES, 0);
        for (ssize_t at = 0; at < got;) {
            look.events = POLLOUT;
            poll(&look, 1, -1);
            ssize_t sent = send(*socket, bytes + at, (size_t)(got - at), MSG_NOSIGNAL);
            at = sent < 0 ? got : at + sent;
        }
    }
    close(*socket);
    free(socket);
    free(bytes);
    return NULL;
}

static bool give(void *user, int socket, const struct sockaddr *peer, socklen_t size) {
    (void)user, (void)peer, (void)size;
    pthread_t thread;
    int *own = malloc(sizeof *own);
    if (own)
        *own = socket;
    if (!own || pthread_create(&thread, NULL, echo_main, own) != 0) {
        close(socket);
        free(own);
        return false;
    }
    pthread_detach(thread);
    return true;
}

int main(int argc, char **argv) {
    struct sp_error err = { .code = SP_OK };
    struct sockaddr_in address = { .sin_family = AF_INET,
                                   .sin_addr.s_addr = htonl(INADDR_LOOPBACK) };
    socklen_t size = sizeof address;
    if (argc != 3) {
        fprintf(stderr, "usage: splat-tls-echo CERTIFICATE KEY\n");
        return 2;
    }
    signal(SIGPIPE, SIG_IGN);
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (fd < 0 || bind(fd, (const struct sockaddr *)&address, size) != 0 || listen(fd, 16) != 0 ||
        getsockname(fd, (struct sockaddr *)&address, &size) != 0) {
        perror("splat-tls-echo: cannot listen");
        return 1;
    }
    struct srv_tls_options options = { .keys = srv_tls_keys_create(argv[1], argv[2], &err),
                                       .socket = fd,
                                       .handshake_ms = 10000,
                                       .linger_ms = 10000,
                                       .handshakes_max = 16,
                                       .connections_max = 64,
                                       .give = give };
    struct srv_tls *tls = options.keys ? srv_tls_create(&options, &err) : NULL;
    if (!tls) {
        fprintf(stderr, "splat-tls-echo: %s: %s\n", err.place, err.text);
        return 1;
    }
    printf("%u\n", ntohs(address.sin_port));
    fflush(stdout);
    while (getchar() != EOF)
        ;
    srv_tls_destroy(&tls);
    return 0;
}
