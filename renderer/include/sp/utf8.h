/* SPDX-License-Identifier: Apache-2.0
 *
 * UTF-8 (RFC 3629) in texts from files and users. The C library checks it only in a UTF-8 locale.
 */
#ifndef SP_UTF8_H
#define SP_UTF8_H

#include <stddef.h>

#include "sp/api.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Returns the number of bytes of the character at `text`, [1, 4]; 0 if the character is invalid or
 * cut off. `text` is NUL-terminated; the result for the NUL is 1. Thread-safe. */
SP_API size_t sp_utf8_length(const char *text);
/* Replaces each byte that belongs to no character by '?', in place. Thread-safe. */
SP_API void sp_utf8_mend(char *text);

#ifdef __cplusplus
}
#endif

#endif
