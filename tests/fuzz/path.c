/* SPDX-License-Identifier: Apache-2.0
 *
 * Bytes → JSON → camera path → frames. Every key of what is accepted is a valid view that is met to
 * the bit; every frame is a valid view or refused with its place.
 */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "paths/path.h"
#include "tests/protocol/fixture.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void require(bool ok) {
    if (!ok)
        abort();
}

static void check_path(const struct srv_path *path) {
    struct sp_error err;
    struct sp_view view;
    uint32_t frames = srv_path_output(path)->frames;
    require(frames >= 1 && srv_path_format(srv_path_output(path)) != NULL);
    for (unsigned i = 0; srv_path_key(path, i); i++)
        require(sp_view_validate(srv_path_key(path, i), &err));
    for (uint32_t n = 0; n <= 16; n++) {
        err.place[0] = 0;
        uint32_t frame = (uint32_t)((uint64_t)(frames - 1) * n / 16);
        if (srv_path_view(path, frame, &view, &err))
            require(sp_view_validate(&view, &err));
        else
            require(err.code == SP_ERR_INVALID && err.place[0] == '/' && err.text[0]);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static struct sp_view defaults; /* made once: its histogram takes longer than all the rest */
    if (!defaults.size[0])
        defaults = fixture_view();
    struct sp_error err = { 0 };
    proto_json *json = proto_json_parse((const char *)data, size, &err);
    struct srv_path *path = json ? srv_path_read(json, &defaults, &defaults, 100000, &err) : NULL;
    if (path)
        check_path(path);
    else if (json)
        require(err.code == SP_ERR_INVALID && err.place[0] == '/' && err.text[0]);
    srv_path_free(&path);
    proto_json_free(&json);
    return 0;
}
