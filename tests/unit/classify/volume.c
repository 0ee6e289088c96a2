/* SPDX-License-Identifier: Apache-2.0 */
#include "unit/classify/volume.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

struct sp_volume *classify_make_volume(const uint32_t dims[3], enum sp_type type,
                                       const void *voxels) {
    struct sp_grid grid = { .dims = { dims[0], dims[1], dims[2] },
                            .spacing = { 1, 1, 1 },
                            .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    struct sp_error err;
    struct sp_volume *volume = sp_volume_create(&grid, type, voxels, "test", &err);
    assert_non_null(volume);
    return volume;
}
