/* SPDX-License-Identifier: Apache-2.0 */
#include "session/view_check.h"

#include "sp/volume.h"

bool srv_view_check(const proto_json *patch, struct sp_view *view, struct sp_error *err) {
    struct sp_volume_info cube = { .type = SP_UINT8, .components = 1, .range = { 0, 255 } };
    for (int i = 0; i < 3; i++) {
        cube.grid.dims[i] = 64;
        cube.grid.spacing[i] = 1;
        cube.grid.direction[i][i] = 1;
    }
    sp_view_init(view, &cube, "cube");
    const struct sp_view defaults = *view;
    return proto_view_apply(patch, &defaults, view, err);
}
