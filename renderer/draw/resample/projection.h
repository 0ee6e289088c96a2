/* SPDX-License-Identifier: Apache-2.0
 *
 * Projections: reduce the values along a ray to one number, and convert the number to a colour.
 *
 *   mode               number of the ray
 *   maximum, minimum   the largest of sign · code             ─┐
 *   mean               ∫ max(code − zero, 0) / length          ├─► · gain + offset ─► colour
 *   sum                ∫ max(code − zero, 0)                   │   (0 … 1)
 *   sum, absorption    1 − 2^(−absorption · the same)         ─┘
 *
 * Samples that cannot change the image are skipped like invisible samples: the function of
 * sp_reduction_transfer() is transparent for values that do not count.
 */
#ifndef SP_RESAMPLE_PROJECTION_H
#define SP_RESAMPLE_PROJECTION_H

#include "draw/resample/curve.h"
#include "sp/view.h"
#include "sp/volume.h"

enum { REDUCTION_COLORS = 1024 /* intervals of the table of colours */ };

struct sp_reduction {
    bool is_on;      /* false: the view is no projection */
    bool is_extreme; /* maximum or minimum */
    bool is_mean;
    bool leaves_out;  /* some samples are not finite */
    float sign;       /* 1; minimum: −1 */
    float start;      /* number at the begin of a ray [sign·code] */
    float full;       /* larger numbers have the same colour [sign·code] */
    float zero;       /* code */
    float absorption; /* per code · reference length, base 2; 0 = none */
    float gain;       /* the number → [0, 1], from the first to the last colour */
    float offset;
    double ends[2]; /* numbers with the first and the last colour, in the number's unit */
};

/* Fills the transfer function by which a projection of the volume skips samples. */
void sp_reduction_transfer(const struct sp_view *view, const struct sp_volume_info *info,
                           struct sp_transfer_function *tf);

/* Fills *reduction; length_unit: world units per unit of the rays' lengths. */
void sp_reduction_init(struct sp_reduction *reduction, const struct sp_view *view,
                       const struct sp_volume_info *info, const struct sp_curve *curve,
                       double length_unit);

/* Writes REDUCTION_COLORS + 1 colours and alphas, evenly spaced from the first to the last one. */
void sp_reduction_colors(const struct sp_view *view, const struct sp_volume_info *info,
                         float (*colors)[4]);

#endif
