// SPDX-License-Identifier: Apache-2.0
// Makes lists of fragments (frame/fragments.c). A list that grows is written to a new place of the buffer.

const uint FRAGMENTS_MAX = 16u;
const float CLEARLY = 0.999; // as in frame/fragments.c

struct Fragment {
    float depth;
    vec4 color; // premultiplied by alpha, alpha
};

shared uint made, place; // fragments of the work group, and where they begin

Fragment merged[FRAGMENTS_MAX + 1u]; // of the pixel, sorted by depth; the last one while one is added
uint merged_count;

// Reads the pixel's list.
void load_fragments(uint planes, uint pixel, uint pixels) {
    open_fragments(planes, pixel, pixels);
    for (merged_count = 0u; merged_count < fragment_count; merged_count++) {
        uint w = fragment_at + FRAGMENT_WORDS * merged_count;
        merged[merged_count].depth = uintBitsToFloat(fragment_words[w]);
        for (uint c = 0u; c < 4u; c++)
            merged[merged_count].color[c] = uintBitsToFloat(fragment_words[w + 1u + c]);
    }
}

// Of FRAGMENTS_MAX + 1 fragments, makes those two neighbours one between which a further fragment would matter least.
void merge_neighbours() {
    float through = 1.0, least = 3.0e38;
    uint pair = FRAGMENTS_MAX - 1u;
    for (uint i = 0u; i < FRAGMENTS_MAX; i++) {
        through *= 1.0 - merged[i].color.a;
        float error = through * merged[i + 1u].color.a * (merged[i + 1u].depth - merged[i].depth);
        if (error < CLEARLY * least) {
            least = error;
            pair = i;
        }
    }
    merged[pair].color += (1.0 - merged[pair].color.a) * merged[pair + 1u].color;
    for (uint i = 1u; i < FRAGMENTS_MAX; i++)
        if (i > pair)
            merged[i] = merged[i + 1u];
}

// sp_fragment_add()
void add_fragment(Fragment f) {
    const uint LAST = FRAGMENTS_MAX - 1u;
    if (merged_count == FRAGMENTS_MAX && !(f.depth < merged[LAST].depth)) {
        merged[LAST].color += (1.0 - merged[LAST].color.a) * f.color;
        return;
    }
    uint i = merged_count;
    for (; i > 0u && f.depth < merged[i - 1u].depth; i--)
        merged[i] = merged[i - 1u];
    merged[i] = f;
    if (merged_count == FRAGMENTS_MAX)
        merge_neighbours();
    else
        merged_count++;
}

// Stores the pixel's list if it has changed. Every thread must call it. If the work group's lists do not fit into the memory for
// `capacity` fragments, the band is drawn again with more.
void store_fragments(bool has_changed, uint planes, uint capacity, uint pixel, uint pixels) {
    uint own = 0u, total = has_changed ? merged_count : 0u, first = planes + pixels;
    if (gl_LocalInvocationIndex == 0u)
        made = 0u;
    barrier();
    if (total > 0u)
        own = atomicAdd(made, total);
    barrier();
    if (gl_LocalInvocationIndex == 0u && made > 0u)
        place = atomicAdd(stored, made);
    barrier();
    if (total == 0u || place + made > capacity || place + made < place)
        return;
    for (uint i = 0u; i < total; i++) {
        uint w = first + FRAGMENT_WORDS * (place + own + i);
        fragment_words[w] = floatBitsToUint(merged[i].depth);
        for (uint c = 0u; c < 4u; c++)
            fragment_words[w + 1u + c] = floatBitsToUint(merged[i].color[c]);
    }
    fragment_words[planes + pixel] = (place + own) << FRAGMENT_COUNT_BITS | total;
}
