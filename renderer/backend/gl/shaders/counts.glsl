// SPDX-License-Identifier: Apache-2.0
// How a stage that makes records counts their pairs by tile and layer. Every thread calls begin_counts(), barrier(), and
// end_counts() with the bins of its record.

// Bins of a record: columns and rows of tiles [first, last]; first layer and number of layers. first > last: none.
layout(std430, binding = 6) writeonly buffer Spans { uvec2 spans[]; };

layout(location = 4) uniform uvec2 capacity; // capacity: pairs; rounds of a record over its tiles and layers

// Sums of the group: splats, pairs, px in the low 16 bits and above. Threads of a subgroup add to different words.
const uint SPLATS = 0u, PAIRS = 1u, PX_LOW = 2u, PX_HIGH = 3u, SUMS = 4u, LANES = 32u;
shared uint sums[SUMS][LANES];
shared bool has_capacity;

// The tiles of the band that the box [low, high) px of the image touches, which is not empty, in layers [first, last] of the batch.
uvec2 bound_tiles(ivec2 low, ivec2 high, uvec2 range) {
    uvec2 last = uvec2(tiles.x, (tiles.z - tiles.y + TILE - 1u) / TILE) - 1u;
    uvec2 first = min(uvec2(low.x, low.y - int(tiles.y)) / TILE, last);
    last = min(uvec2(high.x - 1, high.y - 1 - int(tiles.y)) / TILE, last);
    return pack_span(first, last, range);
}

// Counts a splat: its pixels in this band, and the splat itself where it begins.
void count_splat(uint px, bool begins) {
    uint lane = gl_LocalInvocationIndex % LANES;
    atomicAdd(sums[SPLATS][lane], begins ? 1u : 0u);
    atomicAdd(sums[PX_LOW][lane], px & 0xffffu);
    atomicAdd(sums[PX_HIGH][lane], px >> 16);
}

uint pairs_of(Span span) {
    uvec2 size = span.last - span.first + 1u;
    return size.x * size.y * (span.layers.y - span.layers.x + 1u);
}

// True if the group's pairs fit. Beyond the capacity bins are not counted any more, only the total: a kernel may touch
// every tile.
bool plan(uint own) {
    if (own == 0u)
        return false;
    uint before = atomicAdd(planned, own);
    if (before + own < before)
        atomicMax(needed, 0xffffffffu);
    return before + own >= before && before + own <= capacity.x;
}

// A record with too many rounds over tiles and layers is left out; then the frame is drawn again in smaller pieces.
uvec2 bound(uvec2 bits) {
    Span span = unpack_span(bits);
    uvec2 size = span.last - span.first + 1u;
    uint rounds = bits == NOWHERE ? 0u : size.x * size.y * (span.layers.y - span.layers.x + 3u);
    if (rounds <= capacity.y)
        return bits;
    atomicMax(widest, rounds);
    return NOWHERE;
}

void count_pairs(Span span) {
    for (uint r = span.first.y; r <= span.last.y; r++)
        for (uint c = span.first.x; c <= span.last.x; c++)
            for (uint l = span.layers.x; l <= span.layers.y; l++)
                atomicAdd(count[(r * tiles.x + c) * tiles.w + l], 1u);
}

void add_px(uint px) {
    uint before = atomicAdd(fragments, px);
    if (before + px < before)
        atomicAdd(carry, 1u);
}

// Adds up a sum of the group and adds it to the frame's.
void close_sum(uint kind) {
    uint sum = 0u;
    for (uint lane = 0u; lane < LANES; lane++)
        sum += sums[kind][lane];
    if (kind == SPLATS && sum > 0u)
        atomicAdd(splats, sum);
    if (kind == PAIRS)
        has_capacity = plan(sum);
    if (kind == PX_LOW && sum > 0u)
        add_px(sum);
    if (kind == PX_HIGH && sum > 0u) {
        add_px(sum << 16);
        atomicAdd(carry, sum >> 16);
    }
}

void begin_counts() {
    uint thread = gl_LocalInvocationIndex;
    if (thread < SUMS * LANES)
        sums[thread / LANES][thread % LANES] = 0u;
}

void end_counts(uvec2 bits) {
    uint thread = gl_LocalInvocationIndex;
    Span span = unpack_span(bits);
    bool is_drawn = bits != NOWHERE;
    if (is_drawn)
        atomicAdd(sums[PAIRS][thread % LANES], pairs_of(span));
    barrier();
    if (thread < SUMS)
        close_sum(thread);
    barrier();
    if (is_drawn && has_capacity)
        count_pairs(span);
}
