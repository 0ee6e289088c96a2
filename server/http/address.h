/* SPDX-License-Identifier: Apache-2.0
 *
 * ADDRESS:PORT, as given to --listen and as shown in logs.
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

/* "127.0.0.1:8080", "[::1]:0", "localhost:8080"; names other than localhost are not looked up. */
bool srv_address_parse(const char *text, struct srv_address *address, struct sp_error *err);
/* True for addresses of this machine, also as IPv4 in IPv6. */
bool srv_address_is_loopback(const struct sockaddr *address);
/* "127.0.0.1:8080", "[::1]:8080". */
void srv_address_to_text(const struct sockaddr *address, char text[SRV_ADDRESS_TEXT]);
/* "@" and the host in hexadecimal; for IPv6 the first 64 bits, as below. */
void srv_address_to_host(const struct sockaddr *address, char text[SRV_ADDRESS_HOST]);
/* True if both have the same host; ports are ignored. For IPv6 the first 64 bits are compared,
 * because one host can use all addresses below them. */
bool srv_address_same_host(const struct sockaddr *a, const struct sockaddr *b);

#endif
