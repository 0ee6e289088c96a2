/* SPDX-License-Identifier: Apache-2.0
 *
 * Who made a session, what its token allows in it, and what other tokens of the daemon are in it:
 * kept with the session, and taken over by its forks.
 */
#ifndef SRV_SESSION_OWNER_H
#define SRV_SESSION_OWNER_H

#include <stdbool.h>
#include <stdint.h>

#include "config/token_file.h"
#include "protocol/json.h"
#include "sp/status.h"

struct srv_owner {
    char name[SRV_TOKEN_NAME_BYTES]; /* of the token; empty = nobody's */
    struct srv_quota quota;          /* stills and paths are of no use here */
};

enum srv_role { SRV_ROLE_VIEW, SRV_ROLE_CONTROL };

/* What the daemon's token of this name with these rights (enum srv_right) is in a session of the
 * owner: control of those that it made, an admin of all, else a watcher. False: nothing. */
bool srv_owner_role(const struct srv_owner *owner, const char *name, unsigned rights,
                    enum srv_role *role);

/* No picture is larger than it allows? SP_ERR_INVALID at "/size". */
bool srv_owner_allows_size(const struct srv_owner *owner, const uint32_t size[2],
                           struct sp_error *err);
/* `size`, made smaller in both directions as far as it must be. */
void srv_owner_fit_size(const struct srv_owner *owner, uint32_t size[2]);
/* Frames a second that a participant gets who wants so many. */
int srv_owner_fps(const struct srv_owner *owner, int wanted);

/* {"name", "sessions", "fps", "frame_px"}, 0 = no limit. NULL when out of memory. */
proto_json *srv_owner_encode(const struct srv_owner *owner);
/* Of what was saved; NULL, or what is no owner, is nobody. */
void srv_owner_decode(const proto_json *json, struct srv_owner *owner);

#endif
