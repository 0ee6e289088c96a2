/* SPDX-License-Identifier: Apache-2.0
 *
 * Vectors with three components and 3×3 matrices (m[row][column]) in double precision, for set-up
 * code.
 */
#ifndef SP_BASE_VEC_H
#define SP_BASE_VEC_H

#include <math.h>

struct sp_vec3 {
    double v[3];
};
struct sp_mat3 {
    double m[3][3];
};

static inline struct sp_vec3 sp_vec3_from(const double *p) {
    return (struct sp_vec3){ { p[0], p[1], p[2] } };
}

static inline struct sp_vec3 sp_vec3_add(struct sp_vec3 a, struct sp_vec3 b) {
    return (struct sp_vec3){ { a.v[0] + b.v[0], a.v[1] + b.v[1], a.v[2] + b.v[2] } };
}

static inline struct sp_vec3 sp_vec3_sub(struct sp_vec3 a, struct sp_vec3 b) {
    return (struct sp_vec3){ { a.v[0] - b.v[0], a.v[1] - b.v[1], a.v[2] - b.v[2] } };
}

static inline struct sp_vec3 sp_vec3_scale(struct sp_vec3 a, double s) {
    return (struct sp_vec3){ { a.v[0] * s, a.v[1] * s, a.v[2] * s } };
}

static inline double sp_vec3_dot(struct sp_vec3 a, struct sp_vec3 b) {
    return a.v[0] * b.v[0] + a.v[1] * b.v[1] + a.v[2] * b.v[2];
}

static inline struct sp_vec3 sp_vec3_cross(struct sp_vec3 a, struct sp_vec3 b) {
    return (struct sp_vec3){ { a.v[1] * b.v[2] - a.v[2] * b.v[1], a.v[2] * b.v[0] - a.v[0] * b.v[2],
                               a.v[0] * b.v[1] - a.v[1] * b.v[0] } };
}

static inline double sp_vec3_length(struct sp_vec3 a) {
    return sqrt(sp_vec3_dot(a, a));
}

/* (0,0,0) stays (0,0,0). */
static inline struct sp_vec3 sp_vec3_normalize(struct sp_vec3 a) {
    double l = sp_vec3_length(a);
    return l > 0 ? sp_vec3_scale(a, 1 / l) : a;
}

/* Returns the unit vector of v. The length of v may be anything that a double holds: squares
 * neither overflow nor underflow. */
static inline struct sp_vec3 sp_vec3_unit(const double v[3]) {
    double largest = fmax(fabs(v[0]), fmax(fabs(v[1]), fabs(v[2])));
    struct sp_vec3 r = { { 0 } };
    for (int i = 0; largest > 0 && i < 3; i++)
        r.v[i] = v[i] / largest;
    return sp_vec3_normalize(r);
}

static inline struct sp_vec3 sp_mat3_apply(const struct sp_mat3 *m, struct sp_vec3 a) {
    struct sp_vec3 r;
    for (int i = 0; i < 3; i++)
        r.v[i] = m->m[i][0] * a.v[0] + m->m[i][1] * a.v[1] + m->m[i][2] * a.v[2];
    return r;
}

static inline struct sp_mat3 sp_mat3_multiply(const struct sp_mat3 *a, const struct sp_mat3 *b) {
    struct sp_mat3 r;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            r.m[i][j] = a->m[i][0] * b->m[0][j] + a->m[i][1] * b->m[1][j] + a->m[i][2] * b->m[2][j];
    return r;
}

static inline struct sp_mat3 sp_mat3_transpose(const struct sp_mat3 *a) {
    struct sp_mat3 r;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            r.m[i][j] = a->m[j][i];
    return r;
}

static inline double sp_mat3_determinant(const struct sp_mat3 *a) {
    return a->m[0][0] * (a->m[1][1] * a->m[2][2] - a->m[1][2] * a->m[2][1]) -
           a->m[0][1] * (a->m[1][0] * a->m[2][2] - a->m[1][2] * a->m[2][0]) +
           a->m[0][2] * (a->m[1][0] * a->m[2][1] - a->m[1][1] * a->m[2][0]);
}

/* Returns the inverse. If *determinant is 0, the matrix has no inverse and the result is
 * meaningless. */
static inline struct sp_mat3 sp_mat3_inverse(const struct sp_mat3 *a, double *determinant) {
    double d = *determinant = sp_mat3_determinant(a), s = d != 0 ? 1 / d : 0;
    struct sp_mat3 r;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int r0 = (j + 1) % 3, r1 = (j + 2) % 3, c0 = (i + 1) % 3, c1 = (i + 2) % 3;
            r.m[i][j] = s * (a->m[r0][c0] * a->m[r1][c1] - a->m[r0][c1] * a->m[r1][c0]);
        }
    return r;
}

#endif
