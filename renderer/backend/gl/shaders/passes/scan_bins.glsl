// SPDX-License-Identifier: Apache-2.0
// Prefix sum: counts → where each bin's pairs begin inside its block of SCAN_BLOCK bins, and the total of each block.
// Four bins per thread.

layout(local_size_x = GROUP) in;
layout(std430, binding = 6) writeonly buffer Totals { uint totals[]; };
layout(location = 1) uniform uint bins;

void main() {
    uint thread = gl_LocalInvocationIndex, first = gl_WorkGroupID.x * SCAN_BLOCK + 4u * thread;
    uint own[4], sum = 0u;
    for (uint i = 0u; i < 4u; i++) {
        own[i] = sum;
        sum += first + i < bins ? count[first + i] : 0u;
    }
    scan(sum);
    uint start = sums[thread] - sum;
    for (uint i = 0u; i < 4u; i++)
        if (first + i < bins)
            count[first + i] = start + own[i];
    if (thread == GROUP - 1u)
        totals[gl_WorkGroupID.x] = sums[thread];
}
