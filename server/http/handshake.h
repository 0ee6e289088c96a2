/* SPDX-License-Identifier: Apache-2.0
 *
 * The answer to a WebSocket handshake (RFC 6455, 4.2.2); its hash comes from GnuTLS.
 */
#ifndef SRV_HTTP_HANDSHAKE_H
#define SRV_HTTP_HANDSHAKE_H

#include <stdbool.h>

enum { SRV_WEBSOCKET_ACCEPT_BYTES = 29 };

/* Sec-WebSocket-Accept for a Sec-WebSocket-Key of at most 64 bytes. False when GnuTLS gives no
 * SHA-1 or memory runs out. Thread-safe. */
bool srv_header_websocket_accept(const char *key, char accept[SRV_WEBSOCKET_ACCEPT_BYTES]);

#endif
