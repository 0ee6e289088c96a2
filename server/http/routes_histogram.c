/* SPDX-License-Identifier: Apache-2.0
 *
 * Histograms for editors of transfer functions: of a volume, and of the volume that a session
 * shows, for clients that have nothing but a join token.
 */
#include <string.h>

#include "common/clock.h"
#include "http/routes.h"
#include "protocol/volume.h"

/* Reads ?axis=. False: the reply is a problem document. */
static bool read_axes(const struct srv_request *request, bool *is_joint, struct srv_reply *reply) {
    const char *axes = srv_request_query(request, "axis");
    *is_joint = axes && strcmp(axes, "value,gradient") == 0;
    if (!axes || *is_joint || strcmp(axes, "value") == 0)
        return true;
    srv_reply_problem(reply, 400, NULL, "?axis=%.40s: must be value or value,gradient", axes);
    return false;
}

static proto_json *encode(struct srv_catalog *catalog, struct srv_volume *volume, const char *id,
                          bool is_joint, struct sp_error *err) {
    const struct sp_joint_histogram *joint =
        is_joint ? srv_catalog_joint_histogram(catalog, volume, err) : NULL;
    if (is_joint && !joint)
        return NULL;
    const struct sp_volume_info *info = sp_volume_info(srv_volume_voxels(volume));
    proto_json *json = proto_histogram_encode(info, id, joint);
    if (!json)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the histogram");
    return json;
}

static void reply_histogram(struct srv_request *request, const char *id, const proto_json *view,
                            struct srv_reply *reply) {
    struct sp_error err;
    bool is_joint;
    if (!read_axes(request, &is_joint, reply))
        return;
    struct srv_volume *volume = srv_acquire_step(request, id, view, reply);
    if (!volume)
        return;
    proto_json *json = encode(request->app->catalog, volume, id, is_joint, &err);
    srv_catalog_release(request->app->catalog, volume);
    srv_reply_result(reply, json, &err);
}

void srv_get_histogram(struct srv_request *request, struct srv_reply *reply) {
    srv_reply_for_volume(request, reply_histogram, reply);
}
