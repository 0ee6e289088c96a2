/* SPDX-License-Identifier: Apache-2.0
 *
 * Ambient occlusion and shadow where an interval is seen.
 */
#ifndef SP_RESAMPLE_SHARES_H
#define SP_RESAMPLE_SHARES_H

#include "draw/light/read.h"
#include "draw/resample/sheet_sample.h"

/* The shares of ambient light and of the first light that arrive where an interval is seen, at s.
 * They are read about a cell before it, on the eye's side of its surface. A gradient as small as
 * noise is no surface. */
static inline void sp_compute_shares(const struct sp_resample_open_tile *t,
                                     const struct sp_rays *rays, sp_wide s, const sp_wide normal[3],
                                     sp_wide square, const sp_wide to_eye[3], sp_wide share[2]) {
    const struct sp_resample *r = t->r;
    const struct sp_light_field *light = r->light;
    const float to_front = 0.75f, off_surface = 0.5f; /* cells */
    const sp_wide zero = sp_wide_all(0);
    sp_wide at[3], move[3], cosine = zero, side;
    struct sp_light_there there;
    sp_wide firm = square * (r->light_firmness * r->light_firmness);
    firm = sp_wide_min(firm, sp_wide_all(1));
    sp_place_on_rays(t, rays, s, at);
    for (int c = 0; c < 3; c++)
        cosine += to_eye[c] * normal[c];
    side = off_surface * sp_wide_select(sp_wide_lt(cosine, zero), -firm, firm);
    for (int c = 0; c < 3; c++)
        move[c] = side * normal[c] + to_eye[c] * to_front;
    for (int a = 0; a < 3; a++) {
        const float *o = light->offset[a];
        at[a] = at[a] * r->light_scale + r->light_first + o[0] * move[0] + o[1] * move[1] +
                o[2] * move[2];
    }
    sp_light_read(light, at, &there);
    share[0] = share[1] = sp_wide_all(1);
    if (light->occlusion > 0)
        share[0] -= light->occlusion * sp_light_occlusion(&there, normal, cosine, firm);
    share[1] -= light->shadow * (1 - there.arrives);
}

#endif
