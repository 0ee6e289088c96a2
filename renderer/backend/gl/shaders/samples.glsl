// SPDX-License-Identifier: Apache-2.0
// The samples of a volume, as in memory, and the ranges that a transfer function makes visible.
//
//   ordinal   an integer that rises with the sample: the sample itself, or the bits of a real, reversed if negative
//   listed    intervals of ordinals, low and high, that rise: a range of values meets one that begins at or before its
//             end and ends at or behind its begin

layout(std430, binding = 0) readonly buffer Samples { uint samples[]; };
// One bit per listed key; or the intervals.
layout(std430, binding = 2) readonly buffer Listed { uint listed[]; };

layout(location = 0) uniform uint first_brick;
layout(location = 1) uniform uvec3 dims;
layout(location = 2) uniform ivec4 type; // bytes of a sample; 0 unsigned, 1 signed, 2 real; value of key 0; bytes of a normal

const int REAL = 2;
const int NONE_LOW = 0x7fffffff, NONE_HIGH = -0x7fffffff - 1; // the empty range

uint index_of(uvec3 i) {
    return (i.z * dims.y + i.y) * dims.x + i.x;
}

int ordinal_at(uvec3 i) {
    uint at = index_of(i);
    if (type.x == 4) {
        int word = int(samples[at]);
        return type.y == REAL ? word ^ (word >> 31 & 0x7fffffff) : word;
    }
    int bits = 8 * type.x, per_word = 4 / type.x;
    uint word = samples[at / uint(per_word)], shift = uint(bits) * (at % uint(per_word));
    return type.y != 0 ? bitfieldExtract(int(word), int(shift), bits)
                       : int(bitfieldExtract(word, int(shift), bits));
}

// Infinities and NaN lie beyond the ordinals of all numbers.
bool is_finite(int ordinal) {
    return type.y != REAL || (ordinal >= -0x7f800000 && ordinal <= 0x7f7fffff);
}

// a − b, rounded once.
float difference(int a, int b) {
    return a >= b ? float(uint(a) - uint(b)) : -float(uint(b) - uint(a));
}

uvec3 count_bricks() {
    return (dims + 15u) / 16u;
}

uvec3 corner_of(uint brick) {
    uvec3 bricks = count_bricks();
    return 16u * uvec3(brick % bricks.x, brick / bricks.x % bricks.y, brick / bricks.x / bricks.y);
}

// The thread's voxel of a slice.
uvec3 voxel_of(uvec3 corner, uint slice) {
    return corner + uvec3(gl_LocalInvocationIndex & 15u, gl_LocalInvocationIndex >> 4, slice);
}

// True if one of `count` intervals overlaps the range.
bool meets(ivec2 range, uint count) {
    uint low = 0u, high = count; // bisection: the first interval that ends after the range begins
    while (low < high) {
        uint middle = (low + high) / 2u;
        if (int(listed[2u * middle + 1u]) < range.x)
            low = middle + 1u;
        else
            high = middle;
    }
    return range.x <= range.y && low < count && int(listed[2u * low]) <= range.y;
}
