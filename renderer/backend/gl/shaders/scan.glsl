// SPDX-License-Identifier: Apache-2.0
// Prefix sum over a work group: Hillis & Steele in shared memory. Sums saturate, so that too many pairs never look like
// few.

shared uint sums[GROUP];

uint add(uint a, uint b) {
    uint sum = a + b;
    return sum < a ? 0xffffffffu : sum;
}

// Sets sums[thread] to the sum of `own` of this thread and of all before it. Call barrier() before it is called again.
void scan(uint own) {
    uint thread = gl_LocalInvocationIndex;
    sums[thread] = own;
    barrier();
    for (uint step = 1u; step < GROUP; step *= 2u) {
        uint before = thread >= step ? sums[thread - step] : 0u;
        barrier();
        sums[thread] = add(sums[thread], before);
        barrier();
    }
}
