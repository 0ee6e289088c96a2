/* SPDX-License-Identifier: Apache-2.0
 *
 * Products of vectors with three components.
 */
#ifndef SRV_COMMON_VECTORS_H
#define SRV_COMMON_VECTORS_H

static inline double srv_dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void srv_cross(const double a[3], const double b[3], double out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

#endif
