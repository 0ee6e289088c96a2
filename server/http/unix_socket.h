/* SPDX-License-Identifier: Apache-2.0
 *
 * The listening Unix socket of --listen unix:PATH, and its file.
 */
#ifndef SRV_HTTP_UNIX_SOCKET_H
#define SRV_HTTP_UNIX_SOCKET_H

#include <stdbool.h>
#include <sys/types.h>

#include "http/address.h"

struct srv_unix_socket {
    int fd; /* non-blocking; −1 = closed */
    char path[SRV_UNIX_PATH_BYTES];
    dev_t device; /* of the socket's file, so that only this file is removed at the end */
    ino_t inode;
};

/* Listens. The file has mode 0600 from the beginning. It replaces the file of a daemon that ended
 * without removing it; two daemons that start at the same time do not replace each other's.
 * SP_ERR_IO with the path as place: a program listens there, the path is another file, or the
 * system refuses. */
bool srv_unix_socket_open(const char *path, struct srv_unix_socket *s, struct sp_error *err);
/* Closes the socket and removes its file. */
void srv_unix_socket_close(struct srv_unix_socket *s);

#endif
