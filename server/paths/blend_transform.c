/* SPDX-License-Identifier: Apache-2.0 */
#include "paths/blend_transform.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "common/vectors.h"

/* A turn, an even scale and a shift. */
struct similarity {
    double turn[3][3], scale, shift[3];
};

static double det_of(const double m[16]) {
    double across[3];
    srv_cross(&m[4], &m[8], across);
    return srv_dot(m, across);
}

static bool similarity_of(const double m[16], struct similarity *s) {
    const double near = 1e-6;
    s->scale = cbrt(det_of(m));
    if (!(s->scale > 0))
        return false;
    for (int r = 0; r < 3; r++) {
        s->shift[r] = m[4 * r + 3];
        for (int c = 0; c < 3; c++)
            s->turn[r][c] = m[4 * r + c] / s->scale;
    }
    for (int r = 0; r < 3; r++)
        for (int q = 0; q < 3; q++)
            if (!(fabs(srv_dot(s->turn[r], s->turn[q]) - (r == q)) < near))
                return false;
    return true;
}

/* Sets the axis and returns the angle of a turn, [0, π]. */
static double axis_of(double m[3][3], double axis[3]) {
    const double trace = m[0][0] + m[1][1] + m[2][2];
    const double sines[3] = { m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1] };
    int i = m[0][0] > m[1][1] ? 0 : 1;
    i = m[2][2] > m[i][i] ? 2 : i;
    memcpy(axis, sines, sizeof sines);
    if (trace < 0) { /* the sine alone would be lost to cancellation: (1 − cos θ)·n·nᵀ − … */
        for (int k = 0; k < 3; k++)
            axis[k] = m[i][k] + m[k][i];
        axis[i] += 1 - trace;
        if (srv_dot(axis, sines) < 0)
            for (int k = 0; k < 3; k++)
                axis[k] = -axis[k];
    }
    const double length = sqrt(srv_dot(axis, axis));
    for (int k = 0; k < 3; k++)
        axis[k] = length > 0 ? axis[k] / length : k == 0;
    return atan2(sqrt(srv_dot(sines, sines)), trace - 1);
}

/* Turns v by an angle about a unit vector. */
static void rotate(const double axis[3], double angle, double v[3]) {
    double beside[3];
    srv_cross(axis, v, beside);
    const double along = srv_dot(axis, v) * (1 - cos(angle));
    for (int k = 0; k < 3; k++)
        v[k] = v[k] * cos(angle) + beside[k] * sin(angle) + axis[k] * along;
}

/* f(x + iy) of the header. */
static void weights(double x, double y, double u, double f[2]) {
    f[0] = u;
    f[1] = 0;
    if (hypot(x, y) < 1e-8)
        return;
    const double a[2] = { exp(u * x) * cos(u * y) - 1, exp(u * x) * sin(u * y) },
                 b[2] = { exp(x) * cos(y) - 1, exp(x) * sin(y) };
    const double square = b[0] * b[0] + b[1] * b[1];
    f[0] = (a[0] * b[0] + a[1] * b[1]) / square;
    f[1] = (a[1] * b[0] - a[0] * b[1]) / square;
}

static void blend_screw(const struct similarity *a, const struct similarity *b, double u,
                        double out[16]) {
    double turn[3][3], shift[3], axis[3], beside[3], along[2], across[2];
    const double grow = log(b->scale / a->scale);
    for (int r = 0; r < 3; r++) {
        for (int c = 0; c < 3; c++)
            turn[r][c] = srv_dot(b->turn[r], a->turn[c]);
        shift[r] = b->shift[r] - b->scale / a->scale * srv_dot(turn[r], a->shift);
    }
    const double angle = axis_of(turn, axis), lift = srv_dot(axis, shift);
    srv_cross(axis, shift, beside);
    weights(grow, 0, u, along);
    weights(grow, angle, u, across);
    for (int c = 0; c < 4; c++) {
        double v[3];
        for (int r = 0; r < 3; r++)
            v[r] = c < 3 ? a->turn[r][c] * a->scale : a->shift[r];
        rotate(axis, u * angle, v);
        for (int r = 0; r < 3; r++)
            out[4 * r + c] = v[r] * exp(u * grow);
    }
    for (int r = 0; r < 3; r++)
        out[4 * r + 3] += along[0] * lift * axis[r] + across[0] * (shift[r] - lift * axis[r]) +
                          across[1] * beside[r];
}

void srv_blend_transform(const double a[16], const double b[16], double u, double out[16]) {
    struct similarity from, to;
    memcpy(out, u >= 1 ? b : a, 16 * sizeof *out);
    if (u <= 0 || u >= 1 || memcmp(a, b, 16 * sizeof *a) == 0)
        return;
    if (similarity_of(a, &from) && similarity_of(b, &to)) {
        blend_screw(&from, &to, u, out);
        return;
    }
    if ((det_of(a) > 0) == (det_of(b) > 0))
        for (int i = 0; i < 12; i++)
            out[i] = a[i] * (1 - u) + b[i] * u;
}
