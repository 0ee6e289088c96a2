/* SPDX-License-Identifier: Apache-2.0
 *
 * The light of faces that clip planes, the clip box and the near plane cut into the volume. The
 * gradient of the data inside knows nothing of such a face, so the face has a gradient of its own:
 *
 *   eye ──ray──►│▓▓▓▓▓▓▓▓▓▓▓▓▓▓     along the normal of the plane;
 *               │╲                  as long as the opacity that the material at the entry has over
 *           cut │ ╲_____            one slice, and a quarter as long after each slice behind it
 *               └────────► s
 *
 * An interval has the light of the face by the share f²/(f² + g²) of the lengths of the face's
 * gradient and of its own. So opaque material looks like a flat face, a surface a few slices behind
 * it keeps its own normal, and where the material at the entry is transparent there is no face. f
 * depends on the place where the interval is seen and not on the sheets, and two lights are mixed,
 * not two normals: both avoid bands. (Ours.)
 *
 * The opacity at the entry comes from the value there. A gradient axis of the transfer function
 * does not change it.
 */
#ifndef SP_RESAMPLE_CUT_FACE_H
#define SP_RESAMPLE_CUT_FACE_H

#include "draw/resample/kernels.h"
#include "splat/exp2.h"

/* Notes the opacity of rays that enter through a cut between s = start and start + width.
 * `opacity`: of one slice of the material there. */
static inline void sp_cut_face_enter(struct sp_resample_block *block, int i, float start,
                                     float width, sp_wide opacity) {
    float *own = block->face_opacity + i;
    sp_wide begin = sp_wide_load(block->begin + i);
    sp_wide_mask enters =
        ~sp_wide_lt(begin, sp_wide_all(start)) & sp_wide_lt(begin, sp_wide_all(start + width));
    sp_wide_store(own, sp_wide_select(enters, opacity, sp_wide_load(own)));
}

/* Computes the face's unit normal for an interval that is seen at s, and the square of the length
 * of its gradient. Both are 0 where there is no face; then the function returns false for all rays.
 */
static inline bool sp_cut_face_find(const struct sp_resample *r,
                                    const struct sp_resample_block *block, int i, sp_wide s,
                                    sp_wide normal[3], sp_wide *square) {
    const float least = 1e-6f;
    const sp_wide zero = sp_wide_all(0);
    sp_wide behind = sp_wide_max(s - sp_wide_load(block->begin + i), zero);
    sp_wide length = sp_wide_load(block->face_opacity + i) * sp_wide_exp2(-2 * behind);
    if (!sp_wide_any(sp_wide_lt(sp_wide_all(least), length)))
        return false;
    normal[0] = normal[1] = normal[2] = zero;
    for (int k = 0; k < SP_WIDE; k++) {
        const int half = (int)block->face[i + k];
        for (int c = 0; c < 3 && half >= 0; c++)
            normal[c][k] = r->halves[half].face[c];
        length[k] *= half >= 0 ? RESAMPLE_FACE : 0;
    }
    *square = length * length;
    return true;
}

#endif
