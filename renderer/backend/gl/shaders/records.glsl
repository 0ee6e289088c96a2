// SPDX-License-Identifier: Apache-2.0
// The records of splats between the stages.
//
//   record   head:  x, y [px], a, b | c, depth, colour (halves r g | b), and its first layer of the batch
//            depth: distance from layer 0's near face, slope (2) [per pixel], sharpness | first and last layer, value;
//                   of slabs, and of single splats that fragments divide
//            cuts:  one per plane of the frame: e, k (2), side; a shorter list ends with CUT_NONE
//   span     the bins that it is in
//   pair     a record and which of its layers: record | layer << 22

const uint CUT_NONE = 0u, CUT_ALONG = 1u, CUT_BEFORE = 2u, CUT_BEHIND = 3u; // the side that the plane bounds
const uint COMPOSITE_SPLAT = 0u, COMPOSITE_SHEET = 1u, COMPOSITE_SLAB = 2u; // enum sp_compositing
const int SLABS = 512;                                                      // most slabs that a splat may lie in
const uint RECORD_BITS = 22u;
const uvec2 NOWHERE = uvec2(1u, 0u);

struct Span {
    uvec2 first, last; // tiles: column and row
    uvec2 layers;      // [first, last] of the batch, under 2^14
};

// Columns and rows have 10 bits each; the first layer 12 and 2 bits, the number of layers less one 10 bits.
uvec2 pack_span(uvec2 first, uvec2 last, uvec2 range) {
    return uvec2(first.x | first.y << 10 | (range.x & 0xfffu) << 20,
                 last.x | last.y << 10 | range.x >> 12 << 20 | (range.y - range.x) << 22);
}

Span unpack_span(uvec2 bits) {
    uint layer = bits.x >> 20 | (bits.y >> 20 & 3u) << 12;
    return Span(uvec2(bits.x, bits.x >> 10) & 1023u, uvec2(bits.y, bits.y >> 10) & 1023u,
                uvec2(layer, layer + (bits.y >> 22)));
}
