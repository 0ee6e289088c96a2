/* SPDX-License-Identifier: Apache-2.0
 *
 * The method pick: what the image shows at a point. It takes up to some milliseconds, and more
 * for millions of points, so the picking thread computes it.
 */
#include <math.h>
#include <string.h>

#include "session/rpc_private.h"

enum { PICKS_MAX = 64 }; /* that wait */

/* Per second and participant; as many may come at once. */
#define PICKS_PER_SECOND 20
/* Elements that are tested for picks also count; each takes some nanoseconds. */
#define PICKED_ELEMENTS_PER_SECOND 25e6

/* Reads the size of the image that the point belongs to. The stream may still have the size that
 * the client's window had before. */
static bool read_image_size(struct srv_call *call, uint32_t size[2]) {
    const proto_json *value = proto_json_get(call->params, "size");
    int64_t side;
    srv_hub_size(call->participant->session, call->participant, size);
    for (size_t i = 0; value && i < 2; i++) {
        if (proto_json_size(value) != 2 || !proto_json_integer(proto_json_at(value, i), &side) ||
            side < 1 || side > SP_SIZE_MAX)
            return srv_call_refuse(call, PROTO_RPC_PARAMS, "/size",
                                   "must be [width, height], each in [1, 8192] px");
        size[i] = (uint32_t)side;
    }
    return true;
}

static bool read_point(struct srv_call *call, const uint32_t size[2], double at[2]) {
    const proto_json *point = proto_json_get(call->params, "at");
    for (size_t i = 0; i < 2; i++)
        if (proto_json_size(point) != 2 || !proto_json_number(proto_json_at(point, i), &at[i]) ||
            at[i] < 0 || at[i] > size[i])
            return srv_call_refuse(call, PROTO_RPC_PARAMS, "/at",
                                   "must be [x, y] in px, inside the image");
    return true;
}

static proto_json *encode_pick(const struct sp_pick *pick) {
    proto_json *json = proto_json_object();
    proto_json_set(&json, "position",
                   pick->is_hit ? proto_json_numbers(pick->position, 3) : proto_json_new_null());
    proto_json_set(&json, "value",
                   pick->is_hit && !isnan(pick->value) ? proto_json_new_number(pick->value)
                                                       : proto_json_new_null());
    proto_json_set_number(&json, "opacity", pick->opacity);
    return json;
}

struct late_pick {
    struct srv_late_call call; /* first: it is this struct */
    struct srv_volume *volume; /* a use */
    struct sp_view view;
    uint32_t size[2];
    double at[2];
};

static char *pick(struct srv_late_call *call, size_t *text_size) {
    struct late_pick *late = (struct late_pick *)call;
    const struct srv_volume_source *source = &call->hub->options.volumes;
    struct sp_pick found;
    struct sp_error err;
    /* Without the mutex, so that others need not wait. */
    pthread_mutex_unlock(&call->hub->mutex);
    const bool ok =
        source->pick(source->user, late->volume, &late->view, late->size, late->at, &found, &err);
    pthread_mutex_lock(&call->hub->mutex);
    source->release(source->user, late->volume);
    struct srv_participant *p = srv_late_participant(call);
    if (p)
        p->picked_ms += 1000 * (double)found.elements / PICKED_ELEMENTS_PER_SECOND;
    return ok ? proto_rpc_result(call->message.id, encode_pick(&found), text_size)
              : proto_rpc_error(call->message.id, PROTO_RPC_INTERNAL, &err, text_size);
}

bool srv_call_pick(struct srv_call *call) {
    static const char *const known[] = { "at", "size", NULL };
    struct srv_participant *p = call->participant;
    const struct srv_volume_source *source = &call->hub->options.volumes;
    uint32_t size[2];
    double at[2];
    if (!srv_call_knows(call, known) || !read_image_size(call, size) || !read_point(call, size, at))
        return false;
    double next_ms = fmax(p->picked_ms, call->now_ms - 1000) + 1000.0 / PICKS_PER_SECOND;
    if (next_ms > call->now_ms)
        return srv_call_refuse(call, PROTO_RPC_LIMIT, NULL,
                               "at most 20 picks and 25 million elements per second");
    struct late_pick *late = srv_call_later(call, sizeof *late, call->hub->options.picking,
                                            PICKS_MAX, "many picks wait; try again later");
    if (!late)
        return false;
    p->picked_ms = next_ms;
    late->call.answer = pick;
    late->volume = source->ref(source->user, p->session->shared.displayed);
    late->view = p->session->shared.view;
    memcpy(late->size, size, sizeof size);
    memcpy(late->at, at, sizeof at);
    return true;
}
