// SPDX-License-Identifier: Apache-2.0
// The records of each bin in rising order, where splats are composited one by one: then the picture does not depend
// on who came first. A thread a bin (Shell's sort: bins are short, but for crowds that lie at one distance). One that
// would take too long is left, and the frame is drawn again in smaller pieces.

layout(local_size_x = GROUP) in;
layout(std430, binding = 2) readonly buffer Totals { uint totals[]; };
layout(std430, binding = 3) buffer Pairs { uint pairs[]; };
layout(location = 1) uniform uvec3 batch; // bins, room for pairs, the most of a bin

uint end_of(uint bin) {
    return totals[bin / SCAN_BLOCK] + count[bin];
}

void main() {
    uint bin = gl_GlobalInvocationID.x;
    if (bin >= batch.x || total > batch.y)
        return;
    uint begin = bin > 0u ? end_of(bin - 1u) : 0u, n = end_of(bin) - begin, gap = 1u;
    if (n > batch.z) {
        atomicMax(crowded, n);
        return;
    }
    while (gap < n / 3u)
        gap = 3u * gap + 1u;
    for (; gap > 0u; gap /= 3u)
        for (uint i = gap; i < n; i++) {
            uint own = pairs[begin + i], k = i;
            for (; k >= gap && pairs[begin + k - gap] > own; k -= gap)
                pairs[begin + k] = pairs[begin + k - gap];
            pairs[begin + k] = own;
        }
}
