/* SPDX-License-Identifier: Apache-2.0
 *
 * Post-classification: the pixel of a slab is classified, not the voxel. Splats add
 *
 *   W = Σ ρ_k·share [length over the reference length],  S = Σ f_k ρ_k·share,  N = Σ ∇f_k ρ_k·share
 *
 * so that S/W is the scalar field and N/W its gradient, both averaged along the ray through the
 * slab:
 *
 *   T = −ln(1 − opacity(S/W)·scale(|N/W|))·W        E = shaded colour(S/W)·T
 *
 * W is the length of the slab inside the volume and falls off softly at its border, as the
 * extinction of classified voxels does.
 */
#ifndef SP_TILE_POST_H
#define SP_TILE_POST_H

#include "classify/transfer.h"
#include "splat/shade.h"

struct sp_post {
    const struct sp_transfer *transfer;
    const struct sp_shade *shade; /* NULL = none */
    double gradient_unit;         /* of N: data unit a world unit */
    bool perspective;
    float scale, centre[2]; /* the camera's, px */
};

/* Turns n pixels of a row of sums from (x, y) on, planes SP_TILE · SP_TILE_ROW floats apart, from
 * (W, N, S) into (T, E). */
void sp_post_classify(const struct sp_post *post, int x, int y, float *sums, int n);

#endif
