/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/cubic.h"

#include <math.h>

#define JOINT 0.889392 /* radius where the two pieces meet */

/* Coefficients of 1, r, r², r³. */
static const double inner[4] = { 0.557526, 0, -1.157743, 0.671033 };

/* b2 (t−r)² + b3 (t−r)³, multiplied out. */
static void outer(double c[4]) {
    const double t = SP_CUBIC_RADIUS, b2 = 0.067599, b3 = 0.282474;
    c[0] = (b2 + b3 * t) * t * t;
    c[1] = -(2 * b2 + 3 * b3 * t) * t;
    c[2] = b2 + 3 * b3 * t;
    c[3] = -b3;
}

double sp_cubic(double r) {
    if (r <= JOINT)
        return inner[0] + r * r * (inner[2] + r * inner[3]);
    double d = SP_CUBIC_RADIUS - r;
    return d > 0 ? d * d * (0.067599 + 0.282474 * d) : 0;
}

/* Antiderivative of Σ c_n r^n by z, r = √(ρ²+z²), that is 0 at z = 0. */
static double antiderivative(const double c[4], double rho, double z) {
    double r = hypot(rho, z);
    double curved = rho > 0 ? rho * rho * asinh(z / rho) : 0;
    double first = 0.5 * (z * r + curved);
    return c[0] * z + c[1] * first + c[2] * z * (rho * rho + z * z / 3) +
           c[3] * (0.25 * z * r * r * r + 0.75 * rho * rho * first);
}

/* Returns half of the chord at distance ρ from the centre of a sphere. */
static double half_chord(double radius, double rho) {
    return rho < radius ? sqrt((radius - rho) * (radius + rho)) : 0;
}

double sp_cubic_part(double rho, double z) {
    double joint = half_chord(JOINT, rho), end = half_chord(SP_CUBIC_RADIUS, rho), c[4];
    z = z < end ? z : end;
    if (z <= joint)
        return antiderivative(inner, rho, z);
    outer(c);
    return antiderivative(inner, rho, joint) + antiderivative(c, rho, z) -
           antiderivative(c, rho, joint);
}

double sp_cubic_footprint(double rho) {
    return 2 * sp_cubic_part(rho, SP_CUBIC_RADIUS);
}

void sp_cubic_table_init(struct sp_cubic_table *table) {
    const double top = sp_cubic_footprint(0);
    for (int i = 0; i <= SP_CUBIC_STEPS + 1; i++) {
        double rho = SP_CUBIC_RADIUS * sqrt((double)i / SP_CUBIC_STEPS);
        table->weight[i] = (float)(sp_cubic_footprint(rho) / top);
    }
    for (int i = 0; i <= SP_CUBIC_ROWS + 1; i++) {
        /* The last rows lie at the rim, where the chord has length 0. They are computed just inside
         * the rim. */
        double q = fmin((double)i / SP_CUBIC_ROWS, 1 - 1e-6), rho = SP_CUBIC_RADIUS * sqrt(q);
        double end = half_chord(SP_CUBIC_RADIUS, rho), all = sp_cubic_footprint(rho);
        for (int k = 0; k <= SP_CUBIC_COLUMNS + 1; k++)
            table->share[i][k] = (float)(sp_cubic_part(rho, end * k / SP_CUBIC_COLUMNS) / all);
    }
}
