/* SPDX-License-Identifier: Apache-2.0
 *
 * The part of a volume that a session's view leaves visible. The measuring thread finds it: in some
 * milliseconds, or, where edits cut the volume first, in seconds.
 */
#include <string.h>

#include "http/routes.h"
#include "protocol/view.h"
#include "protocol/volume.h"
#include "sp/edit.h"

static proto_json *encode_visible(struct srv_catalog *catalog, struct srv_volume *volume,
                                  const char *id, const proto_json *session_view,
                                  struct sp_error *err) {
    struct sp_view defaults, view;
    struct sp_visible_part part;
    struct sp_volume *edited;
    srv_catalog_default_view(catalog, volume, &defaults);
    memcpy(&view, &defaults, sizeof view);
    if (!proto_view_apply(session_view, &defaults, &view, err))
        return NULL;
    edited = sp_edit_volume(srv_volume_voxels(volume), &view, err);
    bool ok = edited && sp_view_compute_visible_part(&view, edited, &part, err);
    sp_volume_unref(&edited);
    if (!ok)
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
    struct srv_volume *volume = srv_acquire_step(request, id, view, reply);
    if (!volume)
        return;
    proto_json *json = encode_visible(catalog, volume, id, view, &err);
    srv_catalog_release(catalog, volume);
    if (!json)
        err.place[0] = 0; /* the session is the resource, not a member of a body */
    srv_reply_result(reply, json, &err);
}

static void reply_visible(struct srv_request *request, struct srv_reply *reply) {
    srv_reply_for_session(request, reply_part, reply);
}

void srv_get_session_visible(struct srv_request *request, struct srv_reply *reply) {
    (void)reply;
    srv_request_handle_later(request, request->app->measuring, SRV_MEASURING_MAX,
                             "measurements of parts", reply_visible);
}
