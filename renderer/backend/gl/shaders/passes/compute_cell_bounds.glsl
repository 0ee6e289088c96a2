// SPDX-License-Identifier: Apache-2.0
// Value ranges of cells, which say what can matter to post-classified pixels (classify/reach.h). One work group per
// brick. PASS 0: the range of each cell of 4³ samples. PASS 1: joins it with the cells around it along one axis.

layout(local_size_x = GROUP) in;
// By cell: smallest and largest ordinal, axis 0 fastest. Bricks have all their cells, also beyond the volume.
layout(std430, binding = 1) buffer Cells { ivec2 cells[]; };
layout(std430, binding = 3) writeonly buffer Widened { ivec2 widened[]; };
// By cell along the axis: the first and the last cell that it joins.
layout(std430, binding = 4) readonly buffer Ends { uvec2 ends[]; };

layout(location = 3) uniform uint axis;

const int MEASURE = 0, WIDEN = 1;

shared int low[64], high[64];

// Index of the thread's cell in the brick, and the index step along the axis.
uint cell_of(uvec3 corner, uint thread, out uvec3 at, out uint stride) {
    uvec3 size = 4u * count_bricks();
    at = corner / 4u + (uvec3(thread, thread >> 2, thread >> 4) & 3u);
    stride = axis == 0u ? 1u : axis == 1u ? size.x : size.x * size.y;
    return (at.z * size.y + at.y) * size.x + at.x;
}

void measure(uvec3 corner) {
    uint thread = gl_LocalInvocationIndex;
    for (uint s = 0u; s < 16u; s += 4u) {
        ivec2 range = ivec2(NONE_LOW, NONE_HIGH);
        for (uint k = s; k < s + 4u; k++) {
            uvec3 i = voxel_of(corner, k);
            if (!all(lessThan(i, dims)))
                continue;
            int ordinal = ordinal_at(i);
            if (is_finite(ordinal))
                range = ivec2(min(range.x, ordinal), max(range.y, ordinal));
        }
        uint cell = (thread >> 2 & 3u) | (thread >> 4 & 12u) | s << 2;
        atomicMin(low[cell], range.x);
        atomicMax(high[cell], range.y);
    }
}

void widen(uvec3 corner, uint thread) {
    uvec3 at;
    uint stride, cell = cell_of(corner, thread, at, stride);
    uvec2 end = ends[at[axis]];
    ivec2 range = ivec2(NONE_LOW, NONE_HIGH);
    for (uint k = end.x; k <= end.y; k++) {
        ivec2 other = cells[cell + (k - at[axis]) * stride]; // wraps below 0
        range = ivec2(min(range.x, other.x), max(range.y, other.y));
    }
    widened[cell] = range;
}

void main() {
    uint thread = gl_LocalInvocationIndex;
    uvec3 corner = corner_of(first_brick + gl_WorkGroupID.x), at;
    if (PASS == WIDEN) {
        if (thread < 64u)
            widen(corner, thread);
        return;
    }
    if (thread < 64u) {
        low[thread] = NONE_LOW;
        high[thread] = NONE_HIGH;
    }
    barrier();
    measure(corner);
    barrier();
    uint stride;
    if (thread < 64u)
        cells[cell_of(corner, thread, at, stride)] = ivec2(low[thread], high[thread]);
}
