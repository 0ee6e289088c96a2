/* SPDX-License-Identifier: Apache-2.0
 *
 * How long a moving frame may take.
 */
#include <math.h>

#include "schedule/error_model.h"
#include "schedule/quality.h"

double srv_quality_interval_ms(int max_fps, bool warps) {
    return fmax(1000.0 / max_fps, warps ? SRV_WARP_INTERVAL_MS : SRV_QUALITY_BUDGET_MS);
}

struct srv_quality_budget srv_quality_budget(int max_fps, bool warps, double part) {
    const double interval_ms = srv_quality_interval_ms(max_fps, warps);
    const double round_ms = fmax(interval_ms, SRV_QUALITY_ROUND_MS);
    return (struct srv_quality_budget){ .ms = interval_ms * part,
                                        .most_ms = fmin(interval_ms, round_ms * part),
                                        .warps = warps,
                                        .part = part,
                                        .least_ms = 1000.0 / max_fps };
}

void srv_quality_budget_moves(struct srv_quality_budget *budget, const struct srv_speed *speed,
                              uint32_t height, double voxel_px) {
    const double alone = fmin(fmax(2 * budget->part - 1, 0), 1); /* others: as with a rate */
    const double round_ms = fmax(budget->ms, SRV_QUALITY_ROUND_MS * budget->part);
    budget->moves = true;
    budget->longest_ms = budget->ms + (round_ms - budget->ms) * alone;
    budget->error_per_ms = srv_error_per_ms(speed, budget->warps, height);
    budget->voxel_px = voxel_px;
}
