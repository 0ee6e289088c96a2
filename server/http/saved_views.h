/* SPDX-License-Identifier: Apache-2.0
 *
 * Saved views: the canonical text of a whole view, named by its SHA-256, with the name of the token
 * that saved it first: {"owner": NAME, "view": {…}}. Records of earlier versions are the view
 * alone, without an owner.
 */
#ifndef SRV_HTTP_SAVED_VIEWS_H
#define SRV_HTTP_SAVED_VIEWS_H

#include "protocol/json.h"
#include "store/store.h"

enum { SRV_SAVED_VIEW_ID_BYTES = 33 };

/* Writes the id of a text: the first 128 bits of its SHA-256 in hexadecimal. False when out of
 * memory. */
bool srv_saved_view_id(const char *text, size_t size, char id[SRV_SAVED_VIEW_ID_BYTES]);

/* Returns the view of that id, which the caller frees. NULL: SP_ERR_NOT_FOUND, SP_ERR_MEMORY. */
proto_json *srv_saved_view_get(struct srv_store *store, const char *id, struct sp_error *err);

#endif
