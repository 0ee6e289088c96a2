/* SPDX-License-Identifier: Apache-2.0
 *
 * Random ids and tokens, and a comparison of tokens in constant time. Thread-safe.
 */
#ifndef SRV_SECRET_H
#define SRV_SECRET_H

#include <stdbool.h>
#include <stddef.h>

#include "sp/status.h"

enum { SRV_TOKEN_BYTES = 129, SRV_TOKEN_DIGITS = 32 };

/* Writes `digits` (even, at most 64) random hexadecimal digits and a NUL. The random bytes come
 * from getrandom(2) and are fit for secrets. SP_ERR_IO. */
bool srv_secret_hex(char *out, size_t digits, struct sp_error *err);

/* True if both texts are equal. The time depends only on the length of `given`, so that a client
 * cannot guess a token byte by byte. An empty or NULL text is never equal. The C library has no
 * such function, and GnuTLS's gnutls_memcmp() needs equal lengths. */
bool srv_secret_equal(const char *secret, const char *given);

#endif
