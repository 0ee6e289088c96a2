// SPDX-License-Identifier: Apache-2.0
// Elements of a cloud while they are sorted by depth (depth_order.h): in steps of 2⁻²² of the range of depths, then in their order, as
// draw/layers/cloud/order.c does. Each work group has ITEMS items.

struct Item {
    float depth; // infinite: the camera does not see the element
    uint element;
};

layout(std430, binding = 3) buffer Range { int nearest, farthest; }; // range of the visible depths, as integers in the same order

const uint DIGITS = 256u, ROUNDS = 32u, ITEMS = GROUP * ROUNDS;
const float STEPS = 4194302.0, INFINITE = uintBitsToFloat(0x7f800000u);

bool is_seen(float depth) {
    return depth < INFINITE;
}

uint digit_of(float depth, uint shift) {
    float low = from_ordinal(nearest), range = from_ordinal(farthest) - low;
    uint key = is_seen(depth) ? uint(range > 0.0 ? min((depth - low) * (STEPS / range), STEPS) : 0.0) : uint(STEPS) + 1u;
    return key >> shift & (DIGITS - 1u);
}
