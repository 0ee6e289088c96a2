/* SPDX-License-Identifier: Apache-2.0
 *
 * The part of a volume that a session's view leaves visible. The HTTP thread finds it, in some
 * milliseconds.
 */
#include <string.h>

#include "common/clock.h"
#include "http/routes.h"
#include "protocol/view.h"
#include "protocol/volume.h"

static proto_json *find_part(struct srv_catalog *catalog, void *volume, const char *id,
                             const proto_json *session_view, struct sp_error *err) {
    struct sp_view defaults, view;
    struct sp_visible_part part;
    srv_catalog_default_view(catalog, volume, &defaults);
    memcpy(&view, &defaults, sizeof view);
    if (!proto_view_apply(session_view, &defaults, &view, err) ||
        !sp_view_find_visible_part(&view, srv_volume_voxels(volume), &part, err))
        return NULL;
    proto_json *json = proto_visible_part_encode(&part, id);
    if (!json)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the visible part");
    return json;
}

static void reply_part(struct srv_request *request, const char *id, const proto_json *view,
                       struct srv_reply *reply) {
    struct sp_error err;
    struct srv_catalog *catalog = request->app->catalog;
    void *volume = srv_catalog_acquire(catalog, id, &err);
    proto_json *json = volume ? find_part(catalog, volume, id, view, &err) : NULL;
    if (volume)
        srv_catalog_release(catalog, volume);
    if (json) {
        srv_reply_json(reply, 200, json);
    } else {
        srv_name_volumes(request, &err);
        err.place[0] = 0; /* the session is the resource, not a member of a body */
        srv_reply_error(reply, &err);
    }
}

void srv_get_session_visible(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    proto_json *session =
        srv_hub_session_get(request->app->hub, request->param, false, srv_clock_ms(), &err);
    const proto_json *view = proto_json_get(session, "view");
    const char *id = proto_json_string(proto_json_get(view, "volume"));
    if (!session)
        srv_reply_error(reply, &err);
    else if (!id)
        srv_reply_problem(reply, 409, NULL, "the session has no volume");
    else
        reply_part(request, id, view, reply);
    proto_json_free(&session);
}
