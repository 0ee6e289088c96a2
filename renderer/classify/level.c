/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/level.h"
#include "sp/inflight.h"

#include <stdlib.h>

void sp_level_drop_list(struct sp_level *level) {
    sp_visible_finish(&level->visible);
    level->list_made = 0;
    free(level->listed);
    level->listed = NULL;
    free(level->cells);
    level->cells = NULL;
    sp_level_drop_depths(level);
}

void sp_level_drop_depths(struct sp_level *level) {
    for (int axis = 0; axis < 3; axis++) {
        free(level->depths[axis]);
        level->depths[axis] = NULL;
    }
}

void sp_level_finish(struct sp_level *level) {
    sp_level_drop_list(level);
    sp_transfer_finish(&level->transfer);
    for (int axis = 0; axis < 3; axis++)
        free(level->coordinates[axis]);
    free(level->ranges);
    *level = (struct sp_level){ 0 };
}

bool sp_classify_cancelled(const struct sp_classify_job *job, struct sp_error *err) {
    if (job->pause && atomic_load_explicit(&job->pause->requested, memory_order_relaxed))
        job->pause->wait(job->pause->user);
    if (!job->cancel || !atomic_load_explicit(job->cancel, memory_order_relaxed))
        return false;
    sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    return true;
}
