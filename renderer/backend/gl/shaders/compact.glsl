// SPDX-License-Identifier: Apache-2.0
// Stream compaction: marks of the 16³ places of a brick → the index of each marked place in a sorted list.

shared uint masks[128], ends[128]; // per 32 places: one bit per marked place; number of marks up to their end

// Clears all marks. Call barrier() after this, and after set_mark().
void clear_marks() {
    if (gl_LocalInvocationIndex < 128u)
        masks[gl_LocalInvocationIndex] = 0u;
}

void set_mark(uint place) {
    atomicOr(masks[place / 32u], 1u << (place & 31u));
}

// Fills `ends`.
void sum_marks() {
    uint thread = gl_LocalInvocationIndex;
    if (thread < 128u)
        ends[thread] = uint(bitCount(masks[thread]));
    barrier();
    for (uint step = 1u; step < 128u; step *= 2u) {
        uint before = thread >= step && thread < 128u ? ends[thread - step] : 0u;
        barrier();
        if (thread < 128u)
            ends[thread] += before;
        barrier();
    }
}

// Number of marks before a place that is a multiple of 32.
uint marks_before(uint place) {
    return place > 0u ? ends[place / 32u - 1u] : 0u;
}

// True if the place is marked; `before`: the number of marks before it.
bool read_mark(uint place, out uint before) {
    uint word = place / 32u, bit = 1u << (place & 31u), mask = masks[word];
    before = ends[word] - uint(bitCount(mask)) + uint(bitCount(mask & (bit - 1u)));
    return (mask & bit) != 0u;
}
