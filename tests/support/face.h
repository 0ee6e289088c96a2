/* SPDX-License-Identifier: Apache-2.0
 *
 * The face by which a ray enters a volume whose material the end of the data cuts, as
 * draw/resample/cut_face.h defines it: a gradient along the normal of the face, which is as long as
 *
 *   4 · range of the values that matter · opacity of one slice of the material at the face
 *
 * there, and a quarter as long after each slice behind it. For references that march rays.
 */
#ifndef TESTS_SUPPORT_FACE_H
#define TESTS_SUPPORT_FACE_H

#include "support/interpolant.h"

struct test_face {
    double normal[3];    /* unit, world; the sign does not matter */
    double begin, slice; /* where the ray enters, and from slice to slice [world units] */
    double length;       /* of the gradient there [data unit per world unit]; 0 = no face */
};

/* Returns the range of the values that matter: those of the data that are near the visible ones. */
double test_face_range(const struct test_interpolant *field, const struct sp_transfer_function *tf);

/* Finds where the ray eye + l·ahead enters the volume. There is no face where the ray starts
 * inside, at l = from. The axes must be orthogonal and have even spacing; no clipping. */
void test_face_enter(struct test_face *face, const struct test_interpolant *field,
                     const struct sp_transfer_function *tf, double range, const double eye[3],
                     const double ahead[3], double from);

/* Returns the share that the face has of the light at l. square: of the length of the gradient
 * there. */
double test_face_share(const struct test_face *face, double l, double square);

#endif
