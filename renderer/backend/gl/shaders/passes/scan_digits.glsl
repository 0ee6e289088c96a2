// SPDX-License-Identifier: Apache-2.0
// Counts of digits → where each work group's items of a digit begin. One work group.

layout(local_size_x = GROUP) in;
layout(std430, binding = 0) buffer Counts { uint counts[]; };
layout(location = 0) uniform uint count;

void main() {
    uint thread = gl_LocalInvocationIndex, each = (count + GROUP - 1u) / GROUP, sum = 0u;
    uint first = min(thread * each, count), end = min(first + each, count);
    for (uint i = first; i < end; i++)
        sum += counts[i];
    scan(sum);
    uint at = sums[thread] - sum;
    for (uint i = first; i < end; i++) {
        uint own = counts[i];
        counts[i] = at;
        at += own;
    }
}
