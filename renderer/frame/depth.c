/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "frame/depth.h"

/* SP_WIDE pixels. */
static inline void resolve(const sp_wide plane[3], const sp_wide place[2], sp_wide *depth,
                           sp_wide *spread) {
    const sp_wide least = sp_wide_all(SP_DEPTH_ALPHA_MIN), none = sp_wide_all(INFINITY);
    sp_wide opacity = 1 - plane[0], inverse = 1 / sp_wide_max(opacity, least);
    sp_wide mean = plane[1] * inverse;
    sp_wide variance = sp_wide_max(plane[2] * inverse - mean * mean, sp_wide_all(0));
    sp_wide_mask shows = sp_wide_le(least, opacity);
    *depth = sp_wide_select(shows, place[0] + place[1] * mean, none);
    *spread = sp_wide_keep(shows, sp_wide_abs(place[1]) * sp_wide_sqrt(variance));
}

void sp_depth_resolve(const float *const planes[3], const float *const place[2], uint32_t count,
                      float *depth, float *spread) {
    sp_wide plane[3], at[2], to[2];
    uint32_t i = 0;
    for (; i + SP_WIDE <= count; i += SP_WIDE) {
        for (int k = 0; k < 3; k++)
            plane[k] = sp_wide_load(planes[k] + i);
        for (int k = 0; k < 2; k++)
            at[k] = sp_wide_load(place[k] + i);
        resolve(plane, at, &to[0], &to[1]);
        sp_wide_store(depth + i, to[0]);
        sp_wide_store(spread + i, to[1]);
    }
    const size_t bytes = (count - i) * sizeof(float);
    if (!bytes)
        return;
    for (int k = 0; k < 3; k++) {
        plane[k] = sp_wide_all(0);
        memcpy(&plane[k], planes[k] + i, bytes);
    }
    for (int k = 0; k < 2; k++) {
        at[k] = sp_wide_all(0);
        memcpy(&at[k], place[k] + i, bytes);
    }
    resolve(plane, at, &to[0], &to[1]);
    memcpy(depth + i, &to[0], bytes);
    memcpy(spread + i, &to[1], bytes);
}
