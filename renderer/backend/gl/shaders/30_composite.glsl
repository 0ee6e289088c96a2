// SPDX-License-Identifier: Apache-2.0
// A tile's pairs, front to back (tile/blend.h): a work group a tile, a thread a pixel. Splats come through shared
// memory; a pixel sums T and E of a layer and composites it when the next one begins. A tile that lets less than
// 1/512 through takes no more.

layout(local_size_x = TILE, local_size_y = TILE) in;
layout(std430, binding = 1) readonly buffer Records { uvec4 records[]; };
layout(std430, binding = 2) readonly buffer Totals { uint totals[]; };
layout(std430, binding = 3) readonly buffer Pairs { uint pairs[]; };
layout(std430, binding = 4) buffer Done { vec4 done[]; };   // by pixel: transmittance, associated colour
layout(std430, binding = 5) buffer Open { vec4 open[]; };   // by pixel: T, E of the layer that the last batch left open
layout(std430, binding = 6) readonly buffer Cubic { float cubic[]; }; // F(ρ)/F(0) by (ρ/t)²: sp_cubic_table

layout(location = 1) uniform uvec2 batch;  // width of the picture [px], room for pairs
layout(location = 2) uniform uvec4 mode;   // linear attenuation, kernel (0 Gaussian, 1 cubic, 2 flat), resumes and leaves a layer open
layout(location = 3) uniform float cut;

const uint STAGED = TILE * TILE;
const float TRANSMITTANCE_MIN = 1.0 / 512.0, LOG2E = 1.44269504;
const float CUBIC_STEPS = 512.0;
const uint NO_LAYER = 0xffffffffu;

shared uvec4 staged[2u * STAGED];
shared bool is_live;

// (1 − e^{−t})/t, which E is multiplied by, and e^{−t}; linear: 1 or 1/t, and 1 − min(t, 1).
vec2 attenuate(float t) {
    if (mode.x != 0u)
        return t < 1.0 ? vec2(1.0, 1.0 - t) : vec2(1.0 / t, 0.0);
    if (t < 0.01) {
        float series = 1.0 - t * (0.5 - t * (1.0 / 6.0));
        return vec2(series, 1.0 - t * series);
    }
    float e = exp2(-LOG2E * t);
    return vec2((1.0 - e) / t, e);
}

void composite(vec4 sum, inout vec4 pixel) {
    vec2 a = attenuate(sum.x);
    pixel.yzw += a.x * pixel.x * sum.yzw;
    pixel.x *= a.y;
}

float cubic_weight(float q) {
    float at = q * CUBIC_STEPS;
    uint i = min(uint(at), uint(CUBIC_STEPS));
    return mix(cubic[i], cubic[i + 1u], at - float(i));
}

// Weight of a splat at a pixel's centre; 0 beyond its cutoff.
float weigh(uvec4 place, float c, vec2 at) {
    if (mode.y == 2u) {
        uvec4 box = uvec4(place.z & 0xffffu, place.w & 0xffffu, place.z >> 16, place.w >> 16);
        uvec2 px = uvec2(at);
        return all(greaterThanEqual(px, box.xy)) && all(lessThan(px, box.zw)) ? 1.0 : 0.0;
    }
    vec2 d = at - uintBitsToFloat(place.xy), ab = uintBitsToFloat(place.zw);
    float p = (ab.x * d.x + ab.y * d.y) * d.x + c * d.y * d.y;
    if (!(p <= cut))
        return 0.0;
    return mode.y == 1u ? cubic_weight(p / cut) : exp2(-p);
}

uint end_of(uint bin) {
    return totals[bin / SCAN_BLOCK] + count[bin];
}

void main() {
    uint thread = gl_LocalInvocationIndex, tile = gl_WorkGroupID.y * tiles.x + gl_WorkGroupID.x;
    uvec2 px = gl_WorkGroupID.xy * TILE + gl_LocalInvocationID.xy;
    bool inside = px.x < batch.x && px.y < tiles.z - tiles.y;
    uint index = px.y * batch.x + px.x, layer = NO_LAYER;
    vec2 at = vec2(px) + vec2(0.5, float(tiles.y) + 0.5);
    uint begin = tile > 0u ? end_of(tile * tiles.w - 1u) : 0u, end = end_of(tile * tiles.w + tiles.w - 1u);
    if (total > batch.y)
        end = begin;
    vec4 pixel = inside ? done[index] : vec4(0), sum = vec4(0);
    if (inside && mode.z != 0u) {
        sum = open[index];
        layer = 0u;
    }
    for (; begin < end; begin += STAGED) {
        barrier();
        if (thread == 0u)
            is_live = false;
        barrier();
        if (pixel.x >= TRANSMITTANCE_MIN)
            is_live = true;
        if (begin + thread < end) {
            uint record = pairs[begin + thread];
            staged[2u * thread] = records[2u * record];
            staged[2u * thread + 1u] = records[2u * record + 1u];
        }
        barrier();
        if (!is_live)
            break;
        uint n = min(STAGED, end - begin);
        for (uint i = 0u; i < n; i++) {
            uvec4 rest = staged[2u * i + 1u];
            if (rest.w >> 16 != layer) {
                composite(sum, pixel);
                sum = vec4(0);
                layer = rest.w >> 16;
            }
            float weight = weigh(staged[2u * i], uintBitsToFloat(rest.x), at);
            if (weight > 0.0) {
                float t = weight * uintBitsToFloat(rest.y);
                sum += t * vec4(1.0, unpackHalf2x16(rest.z), unpackHalf2x16(rest.w).x);
            }
        }
    }
    if (!inside)
        return;
    if (mode.w != 0u) {
        open[index] = sum;
    } else {
        composite(sum, pixel);
    }
    done[index] = pixel;
}
