/* SPDX-License-Identifier: Apache-2.0
 *
 * The owner of a session: the token of the daemon that created it, its quota, and the roles of
 * other tokens in the session. Saved with the session, and inherited by its forks.
 */
#ifndef SRV_SESSION_OWNER_H
#define SRV_SESSION_OWNER_H

#include <stdbool.h>
#include <stdint.h>

#include "config/token_file.h"
#include "protocol/json.h"
#include "sp/status.h"

struct srv_owner {
    char name[SRV_TOKEN_NAME_BYTES]; /* of the token; "" = no owner */
    struct srv_quota quota;          /* without snapshots and paths */
};

enum srv_role { SRV_ROLE_VIEW, SRV_ROLE_CONTROL };

/* Gets the role of a token of the daemon in the owner's session: control for its creator and for
 * admins, view for other tokens. `rights` is of enum srv_right. False: the token has no access. */
bool srv_owner_role(const struct srv_owner *owner, const char *name, unsigned rights,
                    enum srv_role *role);

/* True if the size is within the owner's limit. Otherwise SP_ERR_INVALID at "/size". */
bool srv_owner_allows_size(const struct srv_owner *owner, const uint32_t size[2],
                           struct sp_error *err);
/* Reduces the size to at most most_px pixels and keeps the aspect ratio; most_px 0 = no limit. */
void srv_fit_size(uint64_t most_px, uint32_t size[2]);
/* Returns the granted frames per second of a participant that asks for `wanted`. */
int srv_owner_fps(const struct srv_owner *owner, int wanted);

/* {"name", "sessions", "fps", "frame_px"}, 0 = no limit. NULL when out of memory. */
proto_json *srv_owner_encode(const struct srv_owner *owner);
/* Reads a saved owner; NULL, or anything else, gives no owner. */
void srv_owner_decode(const proto_json *json, struct srv_owner *owner);

#endif
