/* SPDX-License-Identifier: Apache-2.0
 *
 * Ambient occlusion and soft shadow by brute force, in double precision: rays from a point through
 * the interpolated and classified volume. It shares no code with the renderer.
 *
 * The light of a place is taken at a point before it, so that a surface does not darken itself: 1½
 * samples nearer to the eye and, the steeper the values, up to one sample along the normal. Optical
 * depth τ counts from half a slice of samples away from that point. With the extinction σ, for a
 * direction ω:
 *
 *   occlusion      A(ω) = ∫ e^−s/R e^−τ(s) σ(s) ds      R: shading.reach·the volume's diagonal
 *   occlusion n    4·mean of A max(0, n·ω) over the sphere: the cosine hemisphere around a normal.
 *                  Where its cosine to the eye is less than 0.2, the brighter side is mixed in.
 *   without one    mean of A − 2·|mean of A ω|: most light comes from the clearest direction
 *   transmittance  mean of e^−τ(∞) over a disc of 4° radius around the first light
 */
#ifndef TESTS_SUPPORT_LIT_H
#define TESTS_SUPPORT_LIT_H

#include "support/interpolant.h"

enum { TEST_LIT_AROUND = 64, TEST_LIT_DISC = 16, TEST_LIT_VALUES = 4096 };

struct test_lit {
    const struct test_interpolant *field; /* borrowed */
    const struct sp_view *view;
    double step;   /* between samples of a ray, world units */
    double cell;   /* width of two samples, world units */
    double fading; /* R */
    double radius; /* a ray of this length ends outside of the volume */
    double firm;   /* change of the value per sample at a surface */
    double around[TEST_LIT_AROUND][3], disc[TEST_LIT_DISC][3]; /* unit, world space */
    bool is_clipped;
    double low, per_unit;   /* entry of `depth` = (value − low)·per_unit */
    double *depth;          /* owned; extinction per world unit without the gradient */
    unsigned char *visible; /* owned; [count]: a value between the samples at the corners of this
                               cell may be visible */
};

/* `steps` per smallest spacing. The axes must have even spacing. False when out of memory. */
bool test_lit_init(struct test_lit *lit, const struct test_interpolant *field, double steps);
void test_lit_finish(struct test_lit *lit);

/* Sets the shares of ambient and of direct light that arrive at a place, each at the strength of
 * the view. `ahead`: unit vector from the eye to the place. */
void test_lit_shares(const struct test_lit *lit, const double world[3], const double ahead[3],
                     const double gradient[3], double share[2]);

/* 1 − A along a unit vector, from `start` on; fading INFINITY: the transmittance. */
double test_lit_march(const struct test_lit *lit, const double from[3], const double towards[3],
                      double start, double fading);

#endif
