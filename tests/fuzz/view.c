/* SPDX-License-Identifier: Apache-2.0
 *
 * Bytes → JSON → view. An accepted view must be valid and round-trip through JSON.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/view.h"
#include "tests/protocol/fixture.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void require(bool ok) {
    if (!ok)
        abort();
}

static void check_accepted(const struct sp_view *view, const struct sp_view *defaults) {
    struct sp_error err;
    struct sp_view again = *defaults;
    require(sp_view_validate(view, &err));
    proto_json *json = proto_view_encode(view);
    size_t size;
    char *text = proto_json_to_canonical(json, &size);
    proto_json_free(&json);
    json = proto_json_parse(text, size, &err);
    require(json != NULL);
    require(proto_view_apply(json, defaults, &again, &err));
    require(sp_view_equal(&again, view));
    proto_json_free(&json);
    free(text);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static struct sp_view defaults; /* created once: computing its histogram takes longest */
    if (!defaults.size[0])
        defaults = fixture_view();
    struct sp_view view;
    memcpy(&view, &defaults, sizeof view);
    struct sp_error err = { 0 };
    proto_json *patch = proto_json_parse((const char *)data, size, &err);
    if (!patch) {
        require(err.code == SP_ERR_FORMAT);
        require(err.text[0]);
    } else if (proto_view_apply(patch, &defaults, &view, &err)) {
        check_accepted(&view, &defaults);
    } else {
        require(err.code == SP_ERR_INVALID);
        require(err.text[0]);
        require(sp_view_equal(&view, &defaults));
    }
    proto_json_free(&patch);
    return 0;
}
