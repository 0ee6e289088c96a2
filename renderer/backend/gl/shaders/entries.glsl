// SPDX-License-Identifier: Apache-2.0
// Lists the blocks of surface points on each tile, front to back (surfaces.c). A work group draws those on its part of the tile.
//
//   words   by tile of SIDE × SIDE px: its first entry | by entry: block, points of the tile before it

const uint STAGED = TILE * TILE, SIDE = 32u;

shared uint wanted[STAGED / 32u]; // bits of the entries that are drawn now

// Every thread calls begin_entries() and add_entry(); is_wanted() is for the thread's own entry. slot: of the thread that had
// it.
void begin_entries();
bool is_wanted(uint block);
void add_entry(uint slot, uint block);
uint tile_word(uint i);

// Does a block with columns and rows [low, high) px touch the square of TILE × TILE px at `corner`?
bool touches(uvec2 low, uvec2 high, uvec2 corner) {
    return all(lessThan(low, corner + TILE)) && all(lessThan(corner, high));
}

// The first of the entries [low, high) with at least `before` points before it.
uint find_entry(uint low, uint high, uint entries, uint before) {
    while (low < high) {
        uint middle = low + (high - low) / 2u;
        bool is_less = tile_word(entries + 2u * middle + 1u) < before;
        low = is_less ? middle + 1u : low;
        high = is_less ? high : middle;
    }
    return low;
}

// Draws those entries of the tile at `corner` that begin at points [points.x, points.y) of it. `entries`: their first word. Every
// thread must call it.
void add_entries(uvec2 corner, uint columns, uint entries, uvec2 points) {
    uint tile = corner.y / SIDE * columns + corner.x / SIDE, thread = gl_LocalInvocationIndex;
    uint begin = find_entry(tile_word(tile), tile_word(tile + 1u), entries, points.x);
    uint end = find_entry(begin, tile_word(tile + 1u), entries, points.y);
    for (uint first = begin; first < end; first += STAGED) {
        barrier();
        if (thread < STAGED / 32u)
            wanted[thread] = 0u;
        begin_entries();
        barrier();
        if (first + thread < end && is_wanted(tile_word(entries + 2u * (first + thread))))
            atomicOr(wanted[thread / 32u], 1u << (thread % 32u));
        barrier();
        for (uint w = 0u; w < STAGED / 32u; w++)
            for (uint left = wanted[w]; left != 0u; left &= left - 1u) {
                uint slot = 32u * w + uint(findLSB(left));
                add_entry(slot, tile_word(entries + 2u * (first + slot)));
            }
    }
}
