// SPDX-License-Identifier: Apache-2.0
// Moves items to their digits, in their order. In a round, each thread has one; bits tell which threads have a digit.

layout(local_size_x = GROUP) in;
layout(std430, binding = 0) readonly buffer Counts { uint counts[]; }; // scan_digits
layout(std430, binding = 1) readonly buffer Items { Item items[]; };
layout(std430, binding = 2) writeonly buffer Moved { Item moved[]; };
layout(std430, binding = 4) writeonly buffer Order { uint order[]; };
layout(location = 0) uniform uvec3 sorting; // items, first bit of the digit, 1 = the last digit: the order is written

const uint WORDS = GROUP / 32u, UNSEEN = 0xffffffffu; // as in cloud.glsl

shared uint bits[DIGITS][WORDS];
shared uint starts[DIGITS];

void move(Item item, uint at) {
    if (sorting.z != 0u)
        order[at] = is_seen(item.depth) ? item.element : UNSEEN;
    else
        moved[at] = item;
}

void main() {
    uint thread = gl_LocalInvocationIndex, first = gl_WorkGroupID.x * ITEMS, word = thread / 32u;
    starts[thread] = counts[thread * gl_NumWorkGroups.x + gl_WorkGroupID.x];
    for (uint round = 0u; round < ROUNDS && first + round * GROUP < sorting.x; round++) {
        uint i = first + round * GROUP + thread, digit = 0u, at = 0u;
        bool has_item = i < sorting.x;
        Item item;
        for (uint w = 0u; w < WORDS; w++)
            bits[thread][w] = 0u;
        barrier();
        if (has_item) {
            item = items[i];
            digit = digit_of(item.depth, sorting.y);
            atomicOr(bits[digit][word], 1u << (thread % 32u));
        }
        barrier();
        if (has_item) {
            at = starts[digit] + uint(bitCount(bits[digit][word] & ((1u << (thread % 32u)) - 1u)));
            for (uint w = 0u; w < word; w++)
                at += uint(bitCount(bits[digit][w]));
            move(item, at);
        }
        barrier();
        for (uint w = 0u; w < WORDS; w++)
            starts[thread] += uint(bitCount(bits[thread][w]));
    }
}
