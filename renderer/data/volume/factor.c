/* SPDX-License-Identifier: Apache-2.0 */
#include "data/volume/factor.h"

#include <math.h>
#include <stdbool.h>

/* The rows of M become orthogonal, one after the other. This keeps digits that M·Mᵀ would lose. */
void sp_factor(const double m[3][3], float factor[6]) {
    double axes[3][3] = { { 0 } };
    float *out = factor;
    for (int row = 0; row < 3; row++) {
        double rest[3] = { m[row][0], m[row][1], m[row][2] };
        for (int k = 0; k < row; k++) {
            double part = rest[0] * axes[k][0] + rest[1] * axes[k][1] + rest[2] * axes[k][2];
            for (int a = 0; a < 3; a++)
                rest[a] -= part * axes[k][a];
            *out++ = (float)part;
        }
        double length = hypot(hypot(rest[0], rest[1]), rest[2]);
        for (int a = 0; a < 3 && length > 0; a++)
            axes[row][a] = rest[a] / length;
        *out++ = (float)length;
    }
}

void sp_gaussian_factor(const double scales[3], const double rotation[4], float factor[6]) {
    double length = hypot(hypot(rotation[0], rotation[1]), hypot(rotation[2], rotation[3]));
    bool turns = length != 0;
    const double w = turns ? rotation[0] / length : 1, x = turns ? rotation[1] / length : 0,
                 y = turns ? rotation[2] / length : 0, z = turns ? rotation[3] / length : 0;
    const double r[3][3] = {
        { 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y) },
        { 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x) },
        { 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y) },
    };
    double m[3][3];
    for (int row = 0; row < 3; row++)
        for (int a = 0; a < 3; a++)
            m[row][a] = r[row][a] * scales[a];
    sp_factor((const double(*)[3])m, factor);
}
