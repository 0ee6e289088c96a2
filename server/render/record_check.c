/* SPDX-License-Identifier: Apache-2.0 */
#include "render/record_check.h"

#include "protocol/json.h"
#include "session/view_check.h"

bool srv_record_check(enum srv_kind kind, const char *text, size_t size, struct sp_error *err) {
    struct sp_view view;
    proto_json *record = proto_json_parse(text, size, err);
    const proto_json *inner = proto_json_get(record, kind == SRV_KIND_VIEW ? "view" : "preset");
    const proto_json *owner = proto_json_get(record, "owner");
    bool ok = record != NULL;
    if (ok && owner && !proto_json_string(owner))
        ok = sp_fail(err, SP_ERR_FORMAT, "/owner", "is not the name of a token");
    /* Records of the first versions are the view or the patch alone. */
    ok = ok && srv_view_check(inner ? inner : record, &view, err);
    if (ok && kind == SRV_KIND_VIEW && !proto_view_volume(inner ? inner : record))
        ok = sp_fail(err, SP_ERR_FORMAT, "/view/volume", "is missing");
    proto_json_free(&record);
    return ok;
}
