// SPDX-License-Identifier: Apache-2.0
// Pixels of a splat (draw/footprints/footprint.h): the weight, and the share of the kernel along the ray that a layer gets.

layout(std430, binding = 1) readonly buffer Records { uvec4 records[]; };
// Tables of struct sp_cubic_table, one after the other: F(ρ)/F(0) by (ρ/t)², and ∫₀^z / F(ρ) by z/√(t²−ρ²).
layout(std430, binding = 6) readonly buffer Cubic { float cubic[]; };

layout(location = 3) uniform float cut;    // largest exponent
layout(location = 4) uniform uvec2 shape;  // clipping planes, words of four of a record
layout(location = 5) uniform vec2 slab;    // index of the batch's first layer, thickness of a layer

// Compile-time choices: COMPOSITING is an enum sp_compositing; FLAT draws rectangles for either kernel.
const uint compositing = COMPOSITING;
const bool is_flat = FLAT != 0, is_cubic = CUBIC != 0;
const bool is_clipped = CLIPPED != 0, is_linear = LINEAR != 0, is_post = POST != 0;

const float LOG2E = 1.44269504, UNBOUNDED = 1e4;
const uint CUBIC_STEPS = 512u, CUBIC_ROWS = 32u, CUBIC_COLUMNS = 64u;
const uint CUBIC_SHARES = CUBIC_STEPS + 2u, CUBIC_ROW = CUBIC_COLUMNS + 2u;
const float CUBIC_RADIUS = 1.556228 / 0.44654961306714; // standard deviations

float cubic_weight(float q) {
    float at = q * float(CUBIC_STEPS);
    uint i = min(uint(at), CUBIC_STEPS);
    return mix(cubic[i], cubic[i + 1u], at - float(i));
}

// The share before ζ standard deviations; q = (ρ/t)².
float cubic_share(float q, float zeta) {
    float end = CUBIC_RADIUS * sqrt(max(1.0 - q, 0.0)), z = abs(zeta);
    if (!(z < end))
        return zeta > 0.0 ? 1.0 : 0.0;
    float row = min(q, 1.0) * float(CUBIC_ROWS), column = z / end * float(CUBIC_COLUMNS);
    uint i = min(uint(row), CUBIC_ROWS), k = min(uint(column), CUBIC_COLUMNS);
    uint at = CUBIC_SHARES + i * CUBIC_ROW + k;
    float f = column - float(k), low = mix(cubic[at], cubic[at + 1u], f);
    float high = mix(cubic[at + CUBIC_ROW], cubic[at + CUBIC_ROW + 1u], f);
    float part = mix(low, high, row - float(i));
    return zeta > 0.0 ? 0.5 + part : 0.5 - part;
}

float share(float exponent, float depth) {
    return is_cubic ? cubic_share(exponent / cut, depth) : normal_share(depth);
}

// Weight at distance d from the centre, and its exponent; 0 beyond the cutoff. `place`: the record's first words.
float weigh(uvec4 place, float c, vec2 at, out vec2 d, out float exponent) {
    exponent = 0.0;
    d = at - uintBitsToFloat(place.xy);
    if (is_flat) {
        uvec4 box = uvec4(place.z & 0xffffu, place.w & 0xffffu, place.z >> 16, place.w >> 16);
        uvec2 px = uvec2(at);
        return all(greaterThanEqual(px, box.xy)) && all(lessThan(px, box.zw)) ? 1.0 : 0.0;
    }
    vec2 ab = uintBitsToFloat(place.zw);
    exponent = (ab.x * d.x + ab.y * d.y) * d.x + c * d.y * d.y;
    if (!(exponent <= cut))
        return 0.0;
    return is_cubic ? cubic_weight(exponent / cut) : exp2(-exponent);
}

// The part of the ray that clipping planes leave: a factor, and bounds of depth in standard deviations.
float clip_ray(uint at, vec2 d, float exponent, inout vec2 bounds) {
    float factor = 1.0;
    for (uint i = 0u; i < shape.x; i++) {
        uvec4 plane = records[at + i];
        if (plane.w == CUT_NONE)
            break;
        vec3 p = uintBitsToFloat(plane.xyz);
        float eta = p.x + dot(p.yz, d);
        if (plane.w == CUT_BEFORE)
            bounds.x = max(bounds.x, -eta);
        else if (plane.w == CUT_BEHIND)
            bounds.y = min(bounds.y, eta);
        else
            factor *= share(exponent, eta);
    }
    return factor;
}

// Where layer `own` cuts a kernel along the ray. `line`, `range`: the record's depth.
vec2 slab_bounds(vec4 line, ivec2 range, int own, vec2 d) {
    float near = (float(own) * slab.y - line.x - dot(line.yz, d)) * line.w;
    float far = near + slab.y * line.w;
    // The tails beyond the kernel's reach count with its first and last slab.
    return vec2(own > range.x ? near : -UNBOUNDED, own < range.y ? far : UNBOUNDED);
}

// Share of the record's weight at d between the bounds, and between clipping planes. `at`: its first cut.
float share_of(uint at, vec2 bounds, vec2 d, float exponent) {
    vec2 shares;
    float factor = is_clipped ? clip_ray(at, d, exponent, bounds) : 1.0;
    if (bounds.x <= -UNBOUNDED && bounds.y >= UNBOUNDED)
        return factor;
    shares.x = bounds.x <= -UNBOUNDED ? 0.0 : share(exponent, bounds.x);
    shares.y = bounds.y >= UNBOUNDED ? 1.0 : share(exponent, bounds.y);
    return factor * max(shares.y - shares.x, 0.0);
}
