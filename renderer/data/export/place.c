/* SPDX-License-Identifier: Apache-2.0 */
#include <string.h>

#include "data/export/job.h"
#include "data/volume/anatomy.h"

void sp_export_place(const struct sp_volume_info *info, const char to[4], double direction[3][3],
                     double origin[3]) {
    const struct sp_grid *grid = &info->grid;
    memcpy(direction, grid->direction, sizeof grid->direction);
    memcpy(origin, grid->origin, sizeof grid->origin);
    if (!info->anatomy[0] || strcmp(info->anatomy, to) == 0)
        return;
    for (int row = 0; row < 3; row++) {
        double toward[3]; /* the new axis, along the old ones */
        sp_anatomy_find(info->anatomy, to[row], toward);
        origin[row] = 0;
        for (int axis = 0; axis < 3; axis++)
            direction[row][axis] = 0;
        for (int old = 0; old < 3; old++) {
            origin[row] += toward[old] * grid->origin[old];
            for (int axis = 0; axis < 3; axis++)
                direction[row][axis] += toward[old] * grid->direction[old][axis];
        }
    }
}
