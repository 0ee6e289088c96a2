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

#include "base/isa.h"
#include "classify/transfer.h"
#include "splat/shade.h"

enum { SP_POST_BINS = 1024, SP_POST_NODES = 4096 };

/* The transfer function for pixels: values relative to the transfer's base, and for each of equal
 * bins of the value the last point that lies at or before it. */
struct sp_post_curve {
    uint32_t count;
    float value[SP_TF_POINTS_MAX], inverse[SP_TF_POINTS_MAX]; /* 1/(distance to the next) */
    float color[SP_TF_POINTS_MAX][3], opacity[SP_TF_POINTS_MAX];
    float bins_per_unit;
    uint8_t first[SP_POST_BINS + 1];
    /* From the first to each of evenly spaced nodes: ∫ of depth, and of red, green and blue times
     * depth. They span the points as far as there are such values. Borrowed; NULL = no span. */
    const double (*integral)[4];
    double first_node, nodes_per_unit;
    double ends[2][4]; /* the integrand at the first and last node, which holds beyond */
    uint32_t gradient_count;
    float magnitude[SP_GRADIENT_POINTS_MAX], scale[SP_GRADIENT_POINTS_MAX]; /* over gradient_unit */
};

struct sp_post {
    struct sp_post_curve curve;
    const struct sp_shade *shade; /* NULL = none */
    float to_camera[3][3];        /* W */
    float half; /* of a slab's thickness times the gradient's unit: gradient → half an interval */
    bool perspective;
    float focal, centre[2]; /* the camera's scale and centre, px */
};

/* The transfer function relative to `base`, for values in `range`; gradient_unit: of N, data unit a
 * world unit. `integral` is memory for SP_POST_NODES + 1 nodes that lives as long as the curve. */
void sp_post_curve_init(struct sp_post_curve *curve, const struct sp_transfer_function *tf,
                        const double range[2], double base, double gradient_unit,
                        double (*integral)[4]);

/* Class of values within `half` of one, relative to the base, at a gradient's magnitude over
 * gradient_unit. */
struct sp_class sp_post_class(const struct sp_post_curve *curve, float value, float half,
                              float magnitude);

/* Turns columns [begin, end) of a tile's row of sums, planes SP_TILE floats apart, from (W, N, S)
 * into (T, E), and may do so with those beside them. (x, y) is the picture's pixel at column 0. */
void sp_post_classify(const struct sp_post *post, int x, int y, float *sums, int begin, int end);

#endif
