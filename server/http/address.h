/* SPDX-License-Identifier: Apache-2.0
 *
 * Addresses: those of --listen, those of log lines, and the comparison of hosts. The "host" of a
 * peer on a Unix socket is its user.
 */
#ifndef SRV_HTTP_ADDRESS_H
#define SRV_HTTP_ADDRESS_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/socket.h>
#include <sys/un.h>

#include "sp/status.h"

enum { SRV_ADDRESS_TEXT = 64, SRV_ADDRESS_HOST = 34 };
#define SRV_UNIX_PATH_BYTES sizeof(((struct sockaddr_un *)0)->sun_path) /* with its NUL: 108 */

struct srv_address {
    struct sockaddr_storage storage;
    socklen_t size;
};

/* Parses "127.0.0.1:8080", "[::1]:0" or "localhost:8080". Does not resolve other names:
 * SP_ERR_INVALID. */
bool srv_address_parse(const char *text, struct srv_address *address, struct sp_error *err);
/* What --listen names: at least one of the two. */
struct srv_listen {
    bool has_tcp;
    struct srv_address tcp;
    char path[SRV_UNIX_PATH_BYTES]; /* of the Unix socket; "" = none */
};
/* Parses "ADDRESS:PORT", "unix:PATH", or both with a comma between them. SP_ERR_INVALID. */
bool srv_listen_parse(const char *text, struct srv_listen *listen, struct sp_error *err);

/* Writes the address of a peer on a Unix socket, which has no name of its own: its user. Returns
 * the size. */
socklen_t srv_address_of_user(unsigned user, struct sockaddr_un *address);

/* True for loopback addresses, including IPv4 addresses mapped to IPv6, and for Unix sockets. */
bool srv_address_is_loopback(const struct sockaddr *address);
/* Writes "127.0.0.1:8080", "[::1]:8080" or, for a Unix socket, "user 1000"; "unknown" for NULL and
 * other families. */
void srv_address_to_text(const struct sockaddr *address, char text[SRV_ADDRESS_TEXT]);
/* Writes "@" and the host in hexadecimal; for IPv6 the first 64 bits, as in
 * srv_address_same_host(); for a Unix socket "@user 1000". */
void srv_address_to_host(const struct sockaddr *address, char text[SRV_ADDRESS_HOST]);
/* Returns the size of an address of one of these families; 0 for others. */
size_t srv_address_size(const struct sockaddr *address);
/* True if both have the same host; ports are ignored. For IPv6 the first 64 bits are compared,
 * because one host can use all addresses below them. */
bool srv_address_same_host(const struct sockaddr *a, const struct sockaddr *b);

#endif
