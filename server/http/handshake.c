/* SPDX-License-Identifier: Apache-2.0 */
#include "http/handshake.h"

#include <assert.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <gnutls/crypto.h>
#include <gnutls/gnutls.h>

bool srv_header_websocket_accept(const char *key, char accept[SRV_WEBSOCKET_ACCEPT_BYTES]) {
    enum { SHA1_BYTES = 20 };
    char text[128];
    uint8_t digest[SHA1_BYTES];
    assert(strlen(key) <= 64);
    int length = snprintf(text, sizeof text, "%s258EAFA5-E914-47DA-95CA-C5AB0DC85B11", key);
    if (gnutls_hash_fast(GNUTLS_DIG_SHA1, text, (size_t)length, digest) != 0)
        return false;
    gnutls_datum_t from = { digest, sizeof digest }, encoded;
    if (gnutls_base64_encode2(&from, &encoded) != 0)
        return false;
    assert(encoded.size == SRV_WEBSOCKET_ACCEPT_BYTES - 1);
    memcpy(accept, encoded.data, encoded.size);
    accept[encoded.size] = 0;
    gnutls_free(encoded.data);
    return true;
}
