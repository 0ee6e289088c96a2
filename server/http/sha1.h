/* SPDX-License-Identifier: Apache-2.0
 *
 * SHA-1 (RFC 3174) and base64, for the WebSocket handshake alone (RFC 6455, 4.2.2). Not for
 * secrets.
 */
#ifndef SRV_HTTP_SHA1_H
#define SRV_HTTP_SHA1_H

#include <stddef.h>
#include <stdint.h>

enum { SRV_SHA1_BYTES = 20, SRV_ACCEPT_BYTES = 29 };

void srv_sha1(const void *bytes, size_t size, uint8_t digest[SRV_SHA1_BYTES]);

/* Sec-WebSocket-Accept for a Sec-WebSocket-Key of at most 64 bytes. */
void srv_websocket_accept(const char *key, char accept[SRV_ACCEPT_BYTES]);

#endif
