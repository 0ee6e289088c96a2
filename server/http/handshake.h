/* SPDX-License-Identifier: Apache-2.0
 *
 * The answer to a WebSocket handshake (RFC 6455, 4.2.2).
 */
#ifndef SRV_HTTP_HANDSHAKE_H
#define SRV_HTTP_HANDSHAKE_H

#include <stdbool.h>

enum { SRV_WEBSOCKET_ACCEPT_BYTES = 29 };

/* Computes Sec-WebSocket-Accept from a Sec-WebSocket-Key of at most 64 bytes. False if GnuTLS does
 * not provide SHA-1 or when out of memory. Thread-safe. */
bool srv_header_websocket_accept(const char *key, char accept[SRV_WEBSOCKET_ACCEPT_BYTES]);

#endif
