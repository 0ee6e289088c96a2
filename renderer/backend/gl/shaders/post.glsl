// SPDX-License-Identifier: Apache-2.0
// Post-classification: classifies a pixel of a slab from (W, N, S); derivation in draw/footprints/post.h.

// Points of the transfer function: value, 1/(distance to the next), opacity | colour. Then the gradient axis: magnitude,
// scale. Then nodes of the integral of depth and of colour times depth, each as a sum in two floats and the difference
// to the next node: single precision would lose the difference of two sums.
layout(std430, binding = 5) readonly buffer Curve {
    uvec4 curve_counts; // points, points of the gradient axis, nodes (0 = none)
    vec4 curve_nodes;   // first node, nodes per unit of value, half an interval per unit of gradient
    vec4 curve_ends[2]; // the integrand before the first and behind the last node
    vec4 curve[];
};

struct Class {
    vec3 color;
    float depth;
};

float depth_of(float a) {
    return a < 0.03 ? a * (1.0 + a * (0.5 + a * (1.0 / 3.0 + a * 0.25))) : -log(1.0 - a);
}

float gradient_scale(float magnitude) {
    uint first = 2u * curve_counts.x, n = curve_counts.y, i = 1u;
    if (n == 0u)
        return 1.0;
    if (!(magnitude > curve[first].x))
        return curve[first].y;
    while (i < n && curve[first + i].x <= magnitude)
        i++;
    if (i == n)
        return curve[first + n - 1u].y;
    vec2 low = curve[first + i - 1u].xy, high = curve[first + i].xy;
    return mix(low.y, high.y, (magnitude - low.x) / (high.x - low.x));
}

Class class_at(float value) {
    uint low = 0u, high = curve_counts.x; // the last point at or before the value
    while (high - low > 1u) {
        uint middle = (low + high) / 2u;
        if (curve[2u * middle].x <= value)
            low = middle;
        else
            high = middle;
    }
    uint next = min(low + 1u, curve_counts.x - 1u);
    float f = clamp((value - curve[2u * low].x) * curve[2u * low].y, 0.0, 1.0);
    float opacity = mix(curve[2u * low].z, curve[2u * next].z, f);
    return Class(mix(curve[2u * low + 1u].rgb, curve[2u * next + 1u].rgb, f), depth_of(opacity));
}

// Integrals up to a value as head + rest; the heads of two integrals cancel.
void integral_at(float value, out vec4 head, out vec4 rest) {
    uint first = 2u * curve_counts.x + curve_counts.y, last = curve_counts.z - 1u;
    float at = (value - curve_nodes.x) * curve_nodes.y;
    float inside = clamp(at, 0.0, float(last));
    uint i = min(uint(inside), last - 1u), row = first + 3u * i;
    head = curve[row];
    rest = curve[row + 1u] + (inside - float(i)) * curve[row + 2u];
    rest += (at - inside) / curve_nodes.y * (at < 0.0 ? curve_ends[0] : curve_ends[1]);
}

// The mean over [value − half, value + half].
Class class_around(float value, float half_interval) {
    vec4 head[2], rest[2];
    integral_at(value - half_interval, head[0], rest[0]);
    integral_at(value + half_interval, head[1], rest[1]);
    precise vec4 sum = (head[1] - head[0]) + (rest[1] - rest[0]);
    if (!(sum.x > 0.0))
        return Class(vec3(0), 0.0);
    return Class(sum.yzw / sum.x, sum.x / (2.0 * half_interval));
}

Class classify_pixel(float value, float half_interval, float magnitude) {
    bool is_point = curve_counts.z == 0u || !(half_interval * curve_nodes.y > 0.5);
    Class c;
    if (is_point)
        c = class_at(value);
    else
        c = class_around(value, half_interval);
    float scale = c.depth > 0.0 ? gradient_scale(magnitude) : 1.0;
    if (scale < 1.0)
        c.depth = depth_of(scale * (1.0 - exp2(-1.44269504 * c.depth)));
    return c;
}
