/* SPDX-License-Identifier: Apache-2.0
 *
 * Bytes → JSON → keyframes → frames. Every accepted keyframe is a valid view and is reproduced bit
 * for bit. Every frame is a valid view, or is refused with a JSON pointer.
 */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "paths/keyframes.h"
#include "tests/protocol/fixture.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void require(bool ok) {
    if (!ok)
        abort();
}

static void check_path(const struct srv_keyframes *keyframes) {
    struct sp_error err;
    struct sp_view view;
    uint32_t frames = srv_keyframes_output(keyframes)->frames;
    require(frames >= 1 && srv_path_format_name(srv_keyframes_output(keyframes)) != NULL);
    for (unsigned i = 0; srv_keyframes_key(keyframes, i); i++)
        require(sp_view_validate(srv_keyframes_key(keyframes, i), &err));
    for (uint32_t n = 0; n <= 16; n++) {
        err.place[0] = 0;
        uint32_t frame = (uint32_t)((uint64_t)(frames - 1) * n / 16);
        if (srv_keyframes_view(keyframes, frame, &view, &err))
            require(sp_view_validate(&view, &err));
        else
            require(err.code == SP_ERR_INVALID && err.place[0] == '/' && err.text[0]);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static struct sp_view defaults; /* created once: computing its histogram takes longest */
    if (!defaults.size[0])
        defaults = fixture_view();
    struct sp_error err = { 0 };
    proto_json *json = proto_json_parse((const char *)data, size, &err);
    struct srv_keyframes *keyframes =
        json ? srv_keyframes_read(json, &defaults, &defaults, 100000, &err) : NULL;
    if (keyframes)
        check_path(keyframes);
    else if (json)
        require(err.code == SP_ERR_INVALID && err.place[0] == '/' && err.text[0]);
    srv_keyframes_free(&keyframes);
    proto_json_free(&json);
    return 0;
}
