/* SPDX-License-Identifier: Apache-2.0 */
#include "session/owner.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

bool srv_owner_role(const struct srv_owner *owner, const char *name, unsigned rights,
                    enum srv_role *role) {
    bool made_it = owner->name[0] && strcmp(owner->name, name) == 0;
    bool controls = rights & SRV_RIGHT_ADMIN || (rights & SRV_RIGHT_CONTROL && made_it);
    *role = controls ? SRV_ROLE_CONTROL : SRV_ROLE_VIEW;
    return rights & SRV_RIGHT_VIEW;
}

bool srv_owner_allows_size(const struct srv_owner *owner, const uint32_t size[2],
                           struct sp_error *err) {
    uint64_t px = (uint64_t)size[0] * size[1], most = owner->quota.frame_px;
    return !most || px <= most ||
           sp_fail(err, SP_ERR_INVALID, "/size",
                   "%u x %u are %" PRIu64 " px and the token of %s allows %" PRIu64, size[0],
                   size[1], px, owner->name, most);
}

void srv_fit_size(uint64_t most_px, uint32_t size[2]) {
    double px = (double)size[0] * size[1], most = (double)most_px;
    if (most == 0 || px <= most)
        return;
    for (int i = 0; i < 2; i++)
        size[i] = (uint32_t)fmax(1, floor(size[i] * sqrt(most / px)));
}

int srv_owner_fps(const struct srv_owner *owner, int wanted) {
    int most = (int)owner->quota.fps;
    return most && most < wanted ? most : wanted;
}

proto_json *srv_owner_encode(const struct srv_owner *owner) {
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "name", owner->name);
    proto_json_set_integer(&json, "sessions", owner->quota.sessions);
    proto_json_set_integer(&json, "fps", owner->quota.fps);
    proto_json_set_integer(&json, "frame_px", (int64_t)owner->quota.frame_px);
    return json;
}

static uint64_t read(const proto_json *json, const char *key, uint64_t max) {
    int64_t number;
    bool ok = proto_json_integer(proto_json_get(json, key), &number) && number > 0 &&
              (uint64_t)number <= max;
    return ok ? (uint64_t)number : 0;
}

void srv_owner_decode(const proto_json *json, struct srv_owner *owner) {
    const char *name = proto_json_string(proto_json_get(json, "name"));
    *owner = (struct srv_owner){ .name = "" };
    if (!name || strlen(name) >= sizeof owner->name)
        return;
    snprintf(owner->name, sizeof owner->name, "%s", name);
    owner->quota = (struct srv_quota){ .sessions = (unsigned)read(json, "sessions", UINT32_MAX),
                                       .fps = (unsigned)read(json, "fps", 120),
                                       .frame_px = read(json, "frame_px", INT64_MAX) };
}
