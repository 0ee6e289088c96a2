/* SPDX-License-Identifier: Apache-2.0
 *
 * The volume and default view of the protocol tests.
 */
#ifndef PROTOCOL_FIXTURE_H
#define PROTOCOL_FIXTURE_H

#include "sp/view.h"

static inline struct sp_volume_info fixture_info(void) {
    struct sp_volume_info info = {
        .type = SP_UINT8, .components = 1, .unit = "mm", .name = "fixture"
    };
    info.grid = (struct sp_grid){ .dims = { 64, 64, 32 },
                                  .spacing = { 1, 1, 2.5 },
                                  .origin = { -10, 0, 0.125 },
                                  .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    info.range[1] = info.data[1] = 255;
    for (int b = 0; b < SP_HISTOGRAM_BINS; b++)
        info.histogram[b] = b < 40 ? 2000 : b > 100 && b < 160 ? 700 : b > 220 ? 90 : 10;
    info.voxel_bytes = 64 * 64 * 32;
    return info;
}

static inline struct sp_view fixture_view(void) {
    struct sp_volume_info info = fixture_info();
    struct sp_view view;
    sp_view_init(&view, &info, "fixture");
    return view;
}

#endif
