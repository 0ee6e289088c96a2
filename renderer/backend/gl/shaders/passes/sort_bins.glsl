// SPDX-License-Identifier: Apache-2.0
// Sorts the records of each bin, where splats are composited one by one, so that the image does not depend on the order
// of threads. One thread per bin; Shell sort, because bins are short unless many splats have one distance. A bin that
// would take too long is skipped, and the frame is drawn again in smaller pieces.

layout(local_size_x = GROUP) in;
layout(std430, binding = 2) readonly buffer Totals { uint totals[]; };
layout(std430, binding = 3) buffer Pairs { uint pairs[]; };
layout(location = 1) uniform uvec3 batch; // bins, capacity in pairs, most pairs of a bin

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
