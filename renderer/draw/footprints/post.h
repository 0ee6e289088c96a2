/* SPDX-License-Identifier: Apache-2.0
 *
 * Post-classification: the pixel of a slab is classified, not the voxel. Splats add
 *
 *   W = Σ ρ_k·share [length over the reference length],  S = Σ f_k ρ_k·share,  N = Σ ∇f_k ρ_k·share
 *
 * S/W is then the scalar field and N/W its gradient, both averaged along the ray through the slab:
 *
 *   T = −ln(1 − opacity(S/W)·scale(|N/W|))·W        E = shaded colour(S/W)·T
 *
 * W is the length of the ray inside slab and volume. It falls off smoothly at the volume's border,
 * as the extinction of classified voxels does.
 */
#ifndef SP_FOOTPRINTS_POST_H
#define SP_FOOTPRINTS_POST_H

#include "base/isa.h"
#include "classify/transfer.h"
#include "splat/shade.h"

enum { SP_POST_BINS = 1024, SP_POST_NODES = 4096 };

/* The transfer function for pixels, with values relative to the transfer's base. first[b] is the
 * last point at or before bin b of the values. */
struct sp_post_curve {
    uint32_t count;
    float value[SP_TF_POINTS_MAX], inverse[SP_TF_POINTS_MAX]; /* 1/(distance to the next) */
    float color[SP_TF_POINTS_MAX][3], opacity[SP_TF_POINTS_MAX];
    float bins_per_unit;
    uint8_t first[SP_POST_BINS + 1];
    /* The integrals of red, green and blue times depth, and of depth, from the first node to each
     * of the evenly spaced nodes. The nodes span the part of the points where the volume has
     * values. Borrowed; NULL = this part is empty. */
    const double (*integral)[4];
    double first_node, nodes_per_unit;
    double ends[2][4]; /* the integrand at both end nodes; constant beyond */
    uint32_t gradient_count;
    float magnitude[SP_GRADIENT_POINTS_MAX], scale[SP_GRADIENT_POINTS_MAX]; /* over gradient_unit */
};

struct sp_post {
    struct sp_post_curve curve;
    const struct sp_shade *shade; /* NULL = none */
    float to_camera[3][3];        /* W */
    float half; /* converts a gradient to half an interval of values: half of a slab's thickness
                   times the gradient's unit */
    bool perspective;
    float focal, centre[2]; /* the camera's scale and centre, px */
};

/* Prepares the transfer function relative to `base`, for values in `range`. gradient_unit: unit of
 * N [data unit per world unit]. `integral`: memory for SP_POST_NODES + 1 nodes, which must live as
 * long as the curve. */
void sp_post_curve_init(struct sp_post_curve *curve, const struct sp_transfer_function *tf,
                        const double range[2], double base, double gradient_unit,
                        double (*integral)[4]);

/* Returns the mean class of the values in [value − half, value + half], relative to the base.
 * magnitude: of the gradient [gradient_unit]. */
struct sp_class sp_post_class(const struct sp_post_curve *curve, float value, float half,
                              float magnitude);

/* Converts columns [begin, end) of a row of sums from (W, N, S) to (T, E). The planes of `sums` are
 * SP_TILE floats apart. The function may also convert neighbouring columns. (x, y) is the pixel of
 * the image at column 0. */
void sp_post_classify(const struct sp_post *post, int x, int y, float *sums, int begin, int end);

#endif
