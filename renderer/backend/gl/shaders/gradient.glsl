// SPDX-License-Identifier: Apache-2.0
// Packed gradients of lists (classify/gradient.h), and how they scale the opacity.

// sp_gradient_unpack(): the unit direction in world space; zero for a gradient of zero length.
vec3 unpack_gradient(uint bits) {
    if (bits >> 22 == 0u)
        return vec3(0);
    vec2 uv = (vec2(bits & 2047u, bits >> 11 & 2047u) - 1023.0) / 1023.0;
    float w = 1.0 - abs(uv.x) - abs(uv.y), fold = max(-w, 0.0);
    uv += mix(vec2(-fold), vec2(fold), lessThan(uv, vec2(0)));
    return normalize(vec3(uv, w));
}

// The octahedral map of a direction whose absolute values add up to `sum`, > 0.
vec2 unfold(vec3 d, float sum) {
    vec2 uv = d.xy / sum, side = mix(vec2(1), vec2(-1), lessThan(uv, vec2(0)));
    return d.z < 0.0 ? (1.0 - abs(uv.yx)) * side : uv;
}

// sp_gradient_pack_direction().
uint pack_direction(vec3 d) {
    float sum = abs(d.x) + abs(d.y) + abs(d.z);
    if (!(sum > 0.0))
        return 0u;
    uvec2 steps = uvec2(unfold(d, sum) * 127.0 + 127.5);
    uint code = steps.y << 8 | steps.x;
    return code != 0u ? code : 254u << 8 | 254u;
}

// sp_gradient_pack() of a gradient divided by its bound.
uint pack_gradient(vec3 d) {
    float sum = abs(d.x) + abs(d.y) + abs(d.z);
    if (!(sum > 0.0))
        return 0u;
    float magnitude = clamp(floor(sqrt(sum * length(d / sum)) * 1023.0 + 0.5), 1.0, 1023.0);
    uvec2 steps = uvec2(floor(unfold(d, sum) * 1023.0 + 0.5) + 1023.0);
    return uint(magnitude) << 22 | steps.y << 11 | steps.x;
}

// sp_gradient_widen(): 16 bits of direction as a packed gradient of full magnitude.
uint widen_direction(uint bits) {
    if (bits == 0u)
        return 0u;
    ivec2 steps = (ivec2(bits & 255u, bits >> 8) - 127) * 1031 + 64;
    uvec2 uv = uvec2((steps >> 7) + 1023);
    return uv.x | uv.y << 11 | 1023u << 22;
}

// e^x − 1 and ln(1 + x), accurate for small x.
float expm1(float x) {
    return abs(x) < 0.05 ? x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x * (1.0 / 24.0)))) : exp(x) - 1.0;
}

float log1p(float x) {
    return abs(x) < 0.05 ? x * (1.0 - x * (0.5 - x * (1.0 / 3.0 - x * (0.25 - 0.2 * x)))) : log(1.0 + x);
}

// The depth whose opacity is `scale` times the opacity of `depth`.
float scale_depth(float depth, float scale) {
    if (scale < 1.0)
        return scale > 0.0 ? -log1p(scale * expm1(-depth)) : 0.0;
    return depth;
}
