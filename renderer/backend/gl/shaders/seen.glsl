// SPDX-License-Identifier: Apache-2.0
// Where an interval between two sheets is seen (draw/resample/seen.h).

// Half an interval. mean: its part of the mean of the interval (colour times optical depth, and optical depth). front,
// length: its visible part [shares of the half].
struct Half {
    vec4 mean;
    float front, length;
};

// The mean place of the light that a layer of optical depth d sends to the eye: 1/d − 1/(e^d − 1).
float seen_share(float d) {
    return 1.0 / (2.0 + d * (1.0 / 3.0 + d * (1.0 / 18.0)));
}

// 0 at the start of the interval, 1 at its end. passed: length of the ray in it. opacity: of the first half, and of both.
float seen_place(Half own[2], float passed, vec2 opacity) {
    const float TINY_LIGHT = 1e-30, FAINT = 1e-6, HIGHLIGHT = 0.01;
    vec2 depth = max(vec2(own[0].mean.w, own[1].mean.w), 0.0);
    vec2 light = max(vec2(dot(own[0].mean.rgb, vec3(1.0)), dot(own[1].mean.rgb, vec3(1.0))), 0.0) + HIGHLIGHT * depth;
    float rise = 1.0 + 0.125 * own[0].length * max(light.y - light.x, 0.0) / max(light.x + light.y, TINY_LIGHT);
    depth *= passed;
    float a = own[0].front + own[0].length * seen_share(depth.x) * rise;
    float b = own[1].front + own[1].length * seen_share(depth.y) * rise;
    float first = opacity.x * light.x * (depth.y + FAINT), second = max(opacity.y - opacity.x, 0.0) * light.y * (depth.x + FAINT);
    first = min(first / max(first + second, TINY_LIGHT), 1.0);
    return 0.5 * (1.0 + b + first * (a - b - 1.0));
}

// The gradient at p between the second and the third sheet of four, per interval along the ray (compute_gradient() of
// draw/resample/integrate.c). more: what a wider difference adds.
vec3 slopes_at(vec3 sheet[4], float p, float more) {
    float outer = p * (1.0 - p) / 6.0, inner = (1.0 + p) * (2.0 - p) * 0.5;
    vec2 across = (p - 2.0) * outer * sheet[0].yz + (1.0 - p) * inner * sheet[1].yz + p * inner * sheet[2].yz -
                  (1.0 + p) * outer * sheet[3].yz;
    float rise = sheet[2].x - sheet[1].x, past = p - 0.5;
    float bend = 0.5 * (sheet[0].x + sheet[3].x - sheet[1].x - sheet[2].x);
    float turn = 0.5 * (sheet[3].x - sheet[0].x) - 1.5 * rise;
    return vec3(across, rise + past * bend + (past * past + more) * turn);
}
