/* SPDX-License-Identifier: Apache-2.0
 *
 * Network addresses: the ADDRESS:PORT of --listen and of log lines, and the comparison of hosts.
 */
#ifndef SRV_HTTP_ADDRESS_H
#define SRV_HTTP_ADDRESS_H

#include <stdbool.h>
#include <sys/socket.h>

#include "sp/status.h"

enum { SRV_ADDRESS_TEXT = 64, SRV_ADDRESS_HOST = 34 };

struct srv_address {
    struct sockaddr_storage storage;
    socklen_t size;
};

/* Parses "127.0.0.1:8080", "[::1]:0" or "localhost:8080". Does not resolve other names:
 * SP_ERR_INVALID. */
bool srv_address_parse(const char *text, struct srv_address *address, struct sp_error *err);
/* True for loopback addresses, including IPv4 addresses mapped to IPv6. */
bool srv_address_is_loopback(const struct sockaddr *address);
/* Writes "127.0.0.1:8080" or "[::1]:8080"; "unknown" for NULL and other families. */
void srv_address_to_text(const struct sockaddr *address, char text[SRV_ADDRESS_TEXT]);
/* Writes "@" and the host in hexadecimal; for IPv6 the first 64 bits, as in
 * srv_address_same_host(). */
void srv_address_to_host(const struct sockaddr *address, char text[SRV_ADDRESS_HOST]);
/* True if both have the same host; ports are ignored. For IPv6 the first 64 bits are compared,
 * because one host can use all addresses below them. */
bool srv_address_same_host(const struct sockaddr *a, const struct sockaddr *b);

#endif
