// SPDX-License-Identifier: Apache-2.0
// Makes the records of a layer's splats, and counts on which tiles of the band they lie. One thread per voxel or element of a
// batch, front to back. Its layer in the bins is its block of the batch, so that a tile's bins follow each other in order.

layout(local_size_x = GROUP) in;

layout(location = 1) uniform uvec4 batch; // first of the order, how many, per block; width of the image [px]

// The tiles of a box of pixels, which are counted.
uvec2 compute_span(vec4 box, uint block) {
    vec2 low = max(box.xy, vec2(0.0, float(tiles.y))), high = min(box.zw, vec2(float(batch.w), float(tiles.z)));
    if (!(low.x < high.x && low.y < high.y))
        return NOWHERE;
    count_splat(uint(min((high.x - low.x) * (high.y - low.y), area)), box.y >= float(tiles.y) || tiles.y == 0u);
    return bound_tiles(ivec2(low), ivec2(high), uvec2(block));
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    uvec2 bits = NOWHERE;
    Splat s;
    vec4 box;
    is_perspective = choice.x != 0u;
    begin_counts();
    barrier();
    if (i < batch.y) {
        if (set_up(batch.x + i, s, box))
            bits = bound(compute_span(box, i / batch.z));
        if (bits != NOWHERE)
            write_splat(i, s);
        spans[i] = bits;
    }
    end_counts(bits);
}
