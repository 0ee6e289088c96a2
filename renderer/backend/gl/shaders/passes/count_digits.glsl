// SPDX-License-Identifier: Apache-2.0
// Counts the digits of items, by digit and work group.

layout(local_size_x = GROUP) in;
layout(std430, binding = 0) writeonly buffer Counts { uint counts[]; };
layout(std430, binding = 1) readonly buffer Items { Item items[]; };
layout(location = 0) uniform uvec2 sorting; // items, first bit of the digit

shared uint own[DIGITS];

void main() {
    uint thread = gl_LocalInvocationIndex, first = gl_WorkGroupID.x * ITEMS;
    own[thread] = 0u; // GROUP is DIGITS
    barrier();
    for (uint i = first + thread; i < min(first + ITEMS, sorting.x); i += GROUP)
        atomicAdd(own[digit_of(items[i].depth, sorting.y)], 1u);
    barrier();
    counts[thread * gl_NumWorkGroups.x + gl_WorkGroupID.x] = own[thread];
}
