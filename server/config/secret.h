/* SPDX-License-Identifier: Apache-2.0
 *
 * Random names and tokens, and the comparison that does not tell by its time how much was right.
 */
#ifndef SRV_SECRET_H
#define SRV_SECRET_H

#include <stdbool.h>
#include <stddef.h>

#include "sp/status.h"

enum { SRV_TOKEN_BYTES = 129, SRV_TOKEN_DIGITS = 32 };

/* Writes `digits` (even, at most 64) random hexadecimal digits and a NUL. */
bool srv_secret_hex(char *out, size_t digits, struct sp_error *err);

/* Equal? Takes a time that depends on the length of `given` alone. NULL is never equal. */
bool srv_secret_equal(const char *secret, const char *given);

#endif
