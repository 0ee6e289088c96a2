// SPDX-License-Identifier: Apache-2.0
// Marks of the 16³ places of a brick → where each marked one goes in a list that rises by place.

shared uint masks[128], ends[128]; // by 32 places: a bit each that is marked, and the marked ones up to their end

// Marks nothing. A barrier follows this, and set_mark().
void clear_marks() {
    if (gl_LocalInvocationIndex < 128u)
        masks[gl_LocalInvocationIndex] = 0u;
}

void set_mark(uint place) {
    atomicOr(masks[place / 32u], 1u << (place & 31u));
}

// Fills ends.
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

// Marked ones before a place that 32 divides.
uint marks_before(uint place) {
    return place > 0u ? ends[place / 32u - 1u] : 0u;
}

// Whether the place is marked, and how many before it are.
bool find_mark(uint place, out uint before) {
    uint word = place / 32u, bit = 1u << (place & 31u), mask = masks[word];
    before = ends[word] - uint(bitCount(mask)) + uint(bitCount(mask & (bit - 1u)));
    return (mask & bit) != 0u;
}
