// SPDX-License-Identifier: Apache-2.0
// Finds the depths of elements or, of points, of the parts of their kernels, and their range. One thread per part.

layout(local_size_x = GROUP) in;
layout(std430, binding = 2) writeonly buffer Items { Item items[]; };
layout(std430, binding = 4) readonly buffer Elements { float elements[]; }; // cloud.glsl
layout(std430, binding = 5) readonly buffer Choice { uint choice[]; };      // the elements, if not all of them

layout(location = 0) uniform uvec4 batch;    // how many parts; elements in the buffer; 1 = they are chosen, 1 = trained Gaussians
layout(location = 1) uniform vec4 steps;     // from a position to its depth [cells]
layout(location = 2) uniform vec4 least;     // near plane [cells]; factor of opacities, least opacity; reach of kernels [deviations]
layout(location = 3) uniform uint planes;    // of clipping
layout(location = 4) uniform vec4 clip[CLIP_PLANES]; // from a position to what is kept, ≥ 0

layout(location = 40) uniform vec2 parts;     // of a kernel; factor on its size
layout(location = 41) uniform float part_at[12]; // struct sp_cloud

shared int group_nearest, group_farthest;

// The deviation of a kernel's depth.
float compute_deviation(uint e) {
    uint l = 3u * batch.y + 6u * e;
    vec3 first = vec3(elements[l], elements[l + 1u], elements[l + 3u]); // columns of the factor, from their diagonal on
    vec2 second = vec2(elements[l + 2u], elements[l + 4u]);
    return parts.y * length(vec3(dot(steps.xyz, first), dot(steps.yz, second), steps.z * elements[l + 5u]));
}

float compute_depth(uint e, uint part) {
    vec3 p = vec3(elements[3u * e], elements[3u * e + 1u], elements[3u * e + 2u]);
    float depth = steps.w + dot(steps.xyz, p), value = elements[9u * batch.y + e];
    bool is_drawn = (depth >= least.x || (least.w > 0.0 && depth + least.w * compute_deviation(e) >= least.x)) && depth < 1e18 &&
                    (batch.w != 0u ? value * least.y > least.z : abs(value) < INFINITE && elements[10u * batch.y + e] > 0.0);
    for (uint i = 0u; i < planes; i++)
        is_drawn = is_drawn && clip[i].w + dot(clip[i].xyz, p) >= 0.0;
    if (is_drawn && parts.x > 1.0)
        depth += part_at[part] * compute_deviation(e);
    return is_drawn ? depth : INFINITE;
}

void main() {
    uint i = gl_GlobalInvocationID.x, thread = gl_LocalInvocationIndex;
    if (thread == 0u) {
        group_nearest = 0x7fffffff;
        group_farthest = -0x7fffffff;
    }
    barrier();
    if (i < batch.x) {
        uint n = uint(parts.x), part = i % n, e = batch.z != 0u ? choice[i / n] : i / n;
        float depth = compute_depth(e, part);
        items[i] = Item(depth, e * n + part);
        if (is_seen(depth)) {
            atomicMin(group_nearest, ordinal(depth));
            atomicMax(group_farthest, ordinal(depth));
        }
    }
    barrier();
    if (thread == 0u && group_nearest <= group_farthest) {
        atomicMin(nearest, group_nearest);
        atomicMax(farthest, group_farthest);
    }
}
