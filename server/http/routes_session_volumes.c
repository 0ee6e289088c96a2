/* SPDX-License-Identifier: Apache-2.0
 *
 * The volumes that the view of a session names: the volume that it shows, and the volumes of its
 * layers. So a client that has nothing but a join token knows what the host knows of them, and
 * nothing of other volumes.
 */
#include <stdio.h>
#include <string.h>

#include "common/clock.h"
#include "http/routes.h"
#include "protocol/view.h"
#include "sp/view.h"

enum { PLACES = 1 + 2 * SP_LAYERS_MAX }; /* of a view that can name a volume */

/* Returns the id at one of the places of a view; NULL = it names none there. */
static const char *id_at(const proto_json *view, int place) {
    if (place == 0)
        return proto_json_string(proto_json_get(view, "volume"));
    const proto_json *layer =
        proto_json_at(proto_json_get(view, "layers"), (size_t)(place - 1) / 2);
    const char *id = proto_json_string(proto_json_get(layer, place % 2 ? "id" : "color_by"));
    return id && *id && strcmp(id, SP_COLOR_BY_LENGTH) != 0 ? id : NULL;
}

/* True if the view names the volume at one of the first `places`. */
static bool names(const proto_json *view, const char *id, int places) {
    for (int i = 0; i < places; i++) {
        const char *named = id_at(view, i);
        if (named && strcmp(named, id) == 0)
            return true;
    }
    return false;
}

static void reply_volumes(struct srv_request *request, const char *id, const proto_json *view,
                          struct srv_reply *reply) {
    struct srv_volume_status status;
    proto_json *json = proto_json_object(), *list = proto_json_array();
    (void)id;
    for (int i = 0; i < PLACES; i++) {
        const char *named = id_at(view, i);
        if (!named || names(view, named, i) ||
            !srv_catalog_find(request->app->catalog, named, &status))
            continue;
        proto_json_append(&list, srv_encode_volume(request, &status, false));
        sp_volume_unref(&status.volume);
    }
    proto_json_set(&json, "volumes", list);
    srv_reply_json(reply, 200, json);
}

void srv_get_session_volumes(struct srv_request *request, struct srv_reply *reply) {
    srv_reply_for_session(request, reply_volumes, reply);
}

/* Copies the id of the volume, the second parameter of the path. False: the session's view does not
 * name it, and the reply is a problem document, the same whether or not the daemon has the volume.
 */
static bool copy_id(const struct srv_request *request, const proto_json *view,
                    char id[SP_NAME_BYTES], struct srv_reply *reply) {
    const char *wanted = strchr(request->param, '/') + 1;
    snprintf(id, SP_NAME_BYTES, "%s", wanted);
    if (strcmp(id, wanted) == 0 && names(view, id, PLACES))
        return true;
    srv_reply_problem(reply, 404, NULL,
                      "the session's view names no volume '%.64s'; a join token reads the volumes "
                      "that its session shows",
                      wanted);
    return false;
}

static void reply_volume(struct srv_request *request, const char *volume, const proto_json *view,
                         struct srv_reply *reply) {
    struct srv_volume_status status;
    char id[SP_NAME_BYTES];
    (void)volume;
    if (!copy_id(request, view, id, reply) || !srv_find_volume(request, id, &status, reply))
        return;
    srv_reply_json(reply, 200, srv_encode_volume(request, &status, true));
    sp_volume_unref(&status.volume);
}

void srv_get_session_volume(struct srv_request *request, struct srv_reply *reply) {
    srv_reply_for_session(request, reply_volume, reply);
}

static void reply_view(struct srv_request *request, const char *volume, const proto_json *view,
                       struct srv_reply *reply) {
    char id[SP_NAME_BYTES];
    (void)volume;
    if (copy_id(request, view, id, reply))
        srv_reply_default_view(request, id, reply);
}

void srv_get_session_volume_view(struct srv_request *request, struct srv_reply *reply) {
    srv_reply_for_session(request, reply_view, reply);
}
