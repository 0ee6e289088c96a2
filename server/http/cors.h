/* SPDX-License-Identifier: Apache-2.0
 *
 * Pages of other origins that may use this daemon (--allow-origin): none but those that are listed,
 * each by its whole name, "https://example.org:8443". What they may do their token says.
 */
#ifndef SRV_HTTP_CORS_H
#define SRV_HTTP_CORS_H

#include <stdbool.h>

#include "sp/status.h"

/* Checks a list, separated by commas; NULL = empty. SP_ERR_INVALID. */
bool srv_cors_check_origins(const char *list, struct sp_error *err);

/* Is this the value of an Origin header that the list has? NULL never is. */
bool srv_cors_allows(const char *list, const char *origin);

#endif
