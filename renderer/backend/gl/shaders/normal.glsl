// SPDX-License-Identifier: Apache-2.0

// Φ (splat/normal.h).
float normal_share(float x) {
    float z = abs(x) * 0.707106781, t = 1.0 / (1.0 + 0.3275911 * z);
    float p = t * (0.254829592 +
                   t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))));
    float tail = 0.5 * p * exp2(-1.44269504 * z * z);
    return x < 0.0 ? tail : 1.0 - tail;
}
