// SPDX-License-Identifier: Apache-2.0
// Prefix sum of the totals → where each block begins, in one work group.

layout(local_size_x = GROUP) in;
layout(std430, binding = 6) buffer Totals { uint totals[]; };
layout(location = 1) uniform uint blocks;

void main() {
    uint thread = gl_LocalInvocationIndex, begin = 0u;
    for (uint first = 0u; first < blocks; first += GROUP) {
        uint at = first + thread, own = at < blocks ? totals[at] : 0u;
        scan(own);
        if (at < blocks)
            totals[at] = add(begin, thread > 0u ? sums[thread - 1u] : 0u);
        begin = add(begin, sums[GROUP - 1u]);
        barrier();
    }
    if (thread == 0u) {
        total = needed == 0xffffffffu ? needed : max(begin, planned);
        needed = max(needed, total);
        planned = 0u;
    }
}
