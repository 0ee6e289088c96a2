/* SPDX-License-Identifier: Apache-2.0 */
#include "support/cubic.h"

#include <math.h>

#define JOINT 0.889392

double test_cubic(double r) {
    double q = TEST_CUBIC_RADIUS - r;
    if (r <= JOINT)
        return 0.557526 + r * r * (0.671033 * r - 1.157743);
    return q > 0 ? q * q * (0.067599 + 0.282474 * q) : 0;
}

/* Integrates g along the ray over [a, b], by the Gauss-Legendre rule of eight points. */
static double panel(double rho, double a, double b) {
    static const double x[4] = { 0.1834346424956498, 0.5255324099163290, 0.7966664774136267,
                                 0.9602898564975363 };
    static const double w[4] = { 0.3626837833783620, 0.3137066458778873, 0.2223810344533745,
                                 0.1012285362903763 };
    double middle = 0.5 * (a + b), half = 0.5 * (b - a), sum = 0;
    for (int i = 0; i < 4; i++)
        for (int side = -1; side <= 1; side += 2)
            sum += w[i] * test_cubic(hypot(rho, middle + side * x[i] * half));
    return sum * half;
}

/* Integrates from 0 to end ≥ 0, in panels that end where the polynomials join. */
static double from_middle(double rho, double end) {
    double stops[2] = { JOINT, TEST_CUBIC_RADIUS }, begin = 0, sum = 0;
    for (int i = 0; i < 2; i++) {
        double stop = rho < stops[i] ? sqrt(stops[i] * stops[i] - rho * rho) : 0;
        double last = fmin(stop, end);
        double middle = 0.5 * (begin + last);
        if (last > begin)
            sum += panel(rho, begin, middle) + panel(rho, middle, last);
        begin = fmax(begin, last);
    }
    return sum;
}

double test_cubic_gathered(double rho, double end) {
    return from_middle(rho, INFINITY) + copysign(from_middle(rho, fabs(end)), end);
}

double test_cubic_variance(void) {
    enum { STEPS = 4096 };
    double second = 0, all = 0;
    for (int k = 0; k < STEPS; k++) {
        double r = (k + 0.5) * TEST_CUBIC_RADIUS / STEPS, g = test_cubic(r) * r * r;
        second += g * r * r;
        all += g;
    }
    return second / all / 3;
}
