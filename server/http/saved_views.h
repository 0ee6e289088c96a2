/* SPDX-License-Identifier: Apache-2.0
 *
 * Saved views: the canonical text of a whole view with the name of the token that saved it,
 * {"owner": NAME, "view": {…}}. The id is a hash of this text, so that each token has its own views
 * and gets the same id for an equal view. Earlier versions hashed the view alone, and before that
 * their records were the view alone, without an owner.
 */
#ifndef SRV_HTTP_SAVED_VIEWS_H
#define SRV_HTTP_SAVED_VIEWS_H

#include "protocol/json.h"
#include "store/store.h"

enum { SRV_SAVED_VIEW_ID_BYTES = 33 };

/* Returns the view of that id, which the caller frees. NULL: SP_ERR_NOT_FOUND, SP_ERR_MEMORY. */
proto_json *srv_saved_view_get(struct srv_store *store, const char *id, struct sp_error *err);

#endif
