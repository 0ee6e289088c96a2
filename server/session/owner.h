/* SPDX-License-Identifier: Apache-2.0
 *
 * Who made a session, and what its token allows in it: kept with the session, and taken over by its
 * forks.
 */
#ifndef SRV_SESSION_OWNER_H
#define SRV_SESSION_OWNER_H

#include <stdbool.h>
#include <stdint.h>

#include "protocol/json.h"
#include "sp/status.h"
#include "token_file.h"

struct srv_owner {
    char name[SRV_TOKEN_NAME_BYTES]; /* of the token; empty = nobody's */
    struct srv_quota quota;          /* stills and paths are of no use here */
};

/* No picture is larger than it allows? SP_ERR_INVALID at "/size". */
bool srv_owner_allows_size(const struct srv_owner *owner, const uint32_t size[2],
                           struct sp_error *err);
/* Frames a second that a participant gets who wants so many. */
int srv_owner_fps(const struct srv_owner *owner, int wanted);

/* {"name", "sessions", "fps", "frame_px"}, 0 = no limit. NULL when out of memory. */
proto_json *srv_owner_encode(const struct srv_owner *owner);
/* Of what was saved; NULL, or what is no owner, is nobody. */
void srv_owner_decode(const proto_json *json, struct srv_owner *owner);

#endif
