/* SPDX-License-Identifier: Apache-2.0 */
#include "config/secret.h"

#include <assert.h>
#include <errno.h>
#include <string.h>
#include <sys/random.h>

bool srv_secret_hex(char *out, size_t digits, struct sp_error *err) {
    unsigned char raw[32];
    assert(digits % 2 == 0 && digits / 2 <= sizeof raw);
    ssize_t got;
    do
        got = getrandom(raw, digits / 2, 0);
    while (got < 0 && errno == EINTR);
    if (got != (ssize_t)(digits / 2))
        return sp_fail(err, SP_ERR_IO, NULL, "cannot get random bytes from the system: %s",
                       strerror(errno));
    for (size_t i = 0; i < digits / 2; i++) {
        out[2 * i] = "0123456789abcdef"[raw[i] >> 4];
        out[2 * i + 1] = "0123456789abcdef"[raw[i] & 15];
    }
    out[digits] = 0;
    return true;
}

bool srv_secret_equal(const char *secret, const char *given) {
    if (!secret || !given || !*secret)
        return false;
    size_t length = strlen(secret), given_length = strlen(given);
    volatile unsigned char difference = length == given_length ? 0 : 1;
    for (size_t i = 0; i < given_length; i++)
        difference |= (unsigned char)(secret[i % length] ^ given[i]);
    return difference == 0;
}
