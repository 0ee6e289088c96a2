/* SPDX-License-Identifier: Apache-2.0
 *
 * Records of the store that belong to the token which made them: saved views and presets. Their
 * text is a JSON object that begins with {"owner": NAME, …}. Records of earlier versions have no
 * owner.
 */
#ifndef SRV_HTTP_OWNED_H
#define SRV_HTTP_OWNED_H

#include "http/request.h"

enum { SRV_OWNED_BYTES = SRV_TOKEN_NAME_BYTES + 32 };

/* Writes how the records of the request's token begin, with the comma after the owner. */
void srv_owned_beginning(const struct srv_request *request, char text[SRV_OWNED_BYTES]);

/* Stores a record of the request's token, whose quota is `most` records of the kind (0 = none), as
 * srv_store_add(). */
bool srv_owned_add(const struct srv_request *request, enum srv_kind kind, const char *id,
                   const char *text, size_t size, unsigned most, struct sp_error *err);

/* True if the request's token may change the record: an admin may change all. */
bool srv_owned_may_change(const struct srv_request *request, const char *record);

#endif
