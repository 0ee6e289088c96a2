// SPDX-License-Identifier: Apache-2.0
// Where an interval between two sheets is seen (draw/resample/seen.h).

// Half an interval: colour times optical depth, and optical depth, of its part of the interval's mean; where its visible part
// begins, and how long that is [shares of the half].
struct Half {
    vec4 mean;
    float front, length;
};

// The mean place of the light that a layer of optical depth d sends to the eye: 1/d − 1/(e^d − 1).
float seen_share(float d) {
    return 1.0 / (2.0 + d * (1.0 / 3.0 + d * (1.0 / 18.0)));
}

// 0 at the start of the interval, 1 at its end. depth: of each half. opacity: of the first half, and of both.
float seen_place(Half own[2], vec2 depth, vec2 opacity) {
    float a = own[0].front + own[0].length * seen_share(depth.x);
    float b = own[1].front + own[1].length * seen_share(depth.y);
    float first = min(opacity.x / max(opacity.y, 1e-20), 1.0);
    return 0.5 * (1.0 + b + first * (a - b - 1.0));
}

// The polynomial of degree 3 through the gradients across the ray (yz) on four sheets, at p between the second and the third
// one; and the difference of the values' (x) polynomial from p − ½ to p + ½.
vec3 slopes_at(vec3 sheet[4], float p) {
    float outer = p * (1.0 - p) / 6.0, inner = (1.0 + p) * (2.0 - p) * 0.5;
    vec2 across = (p - 2.0) * outer * sheet[0].yz + (1.0 - p) * inner * sheet[1].yz + p * inner * sheet[2].yz -
                  (1.0 + p) * outer * sheet[3].yz;
    float rise = sheet[2].x - sheet[1].x, past = p - 0.5;
    float bend = 0.5 * (sheet[0].x + sheet[3].x - sheet[1].x - sheet[2].x);
    float turn = 0.5 * (sheet[3].x - sheet[0].x) - 1.5 * rise;
    return vec3(across, rise + past * (bend + past * turn));
}
