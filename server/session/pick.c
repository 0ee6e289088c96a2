/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "session/rpc_private.h"

/* A pick takes up to some ms of the stream thread: so many a second are granted to a participant,
 * and as many at once. */
#define PICKS_PER_SECOND 20

static bool read_point(struct srv_call *call, const uint32_t size[2], double at[2]) {
    const proto_json *point = proto_json_get(call->params, "at");
    for (size_t i = 0; i < 2; i++)
        if (proto_json_size(point) != 2 || !proto_json_number(proto_json_at(point, i), &at[i]) ||
            at[i] < 0 || at[i] > size[i])
            return srv_call_refuse(call, PROTO_RPC_PARAMS, "/at",
                                   "must be [x, y] in px, inside the picture");
    return true;
}

static proto_json *encode(const struct sp_pick *pick) {
    proto_json *json = proto_json_object(), *position = pick->is_hit ? proto_json_array() : NULL;
    bool ok = true;
    for (int i = 0; pick->is_hit && i < 3; i++)
        ok = proto_json_append_number(position, pick->position[i]) && ok;
    ok = (pick->is_hit ? proto_json_set(json, "position", position)
                       : proto_json_set_null(json, "position")) &&
         ok;
    ok = (pick->is_hit ? proto_json_set_number(json, "value", pick->value)
                       : proto_json_set_null(json, "value")) &&
         ok;
    ok = proto_json_set_number(json, "opacity", pick->opacity) && ok;
    if (!ok)
        proto_json_free(&json);
    return json;
}

bool srv_call_pick(struct srv_call *call) {
    static const char *const known[] = { "at", NULL };
    struct srv_participant *p = call->participant;
    const struct srv_volume_source *source = &call->hub->options.volumes;
    uint32_t size[2];
    double at[2];
    srv_hub_size(p->session, p, size);
    if (!srv_call_knows(call, known) || !read_point(call, size, at))
        return false;
    double next_ms = fmax(p->picked_ms, call->now_ms - 1000) + 1000.0 / PICKS_PER_SECOND;
    if (next_ms > call->now_ms)
        return srv_call_refuse(call, PROTO_RPC_LIMIT, NULL, "at most 20 picks a second");
    p->picked_ms = next_ms;
    struct sp_view view = p->session->view;
    void *volume = source->ref(source->user, p->session->volume);
    struct sp_pick pick;
    /* Nobody else waits for it; the session may end meanwhile, the participant cannot. */
    pthread_mutex_unlock(&call->hub->mutex);
    source->pick(source->user, volume, &view, size, at, &pick);
    pthread_mutex_lock(&call->hub->mutex);
    source->release(source->user, volume);
    call->result = encode(&pick);
    return true;
}
