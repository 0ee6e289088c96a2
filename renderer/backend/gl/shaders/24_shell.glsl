// SPDX-License-Identifier: Apache-2.0
// Draws a shell in a band (shell/tile.c): one work group per tile, one thread per pixel. Voxels come front to back;
// their splats are staged in shared memory. ALONE: they are composited. Else splats of a pixel with nearly the same depth
// become a fragment. To keep dispatches short, a tile with many voxels takes several passes.

layout(local_size_x = TILE, local_size_y = TILE) in;
// ALONE: by pixel of the band, transmittance and premultiplied colour. Else by pixel, then again by pixel, …, between passes: the
// open fragment (colour | depth, what the pixel lets through, fragments), then fragments (colour | depth).
layout(std430, binding = 4) buffer Image { vec4 image[]; };

layout(location = 1) uniform uvec4 part;     // width of the image [px]; voxels of a tile in this pass: first, end; 1 = first pass
layout(location = 2) uniform uvec3 capacity; // fragments that the buffer holds; words before those of pixels; 1 = last pass

const float TRANSMITTANCE_MIN = 1.0 / 512.0;

shared Splat staged[STAGED];
shared bool is_live;            // some pixel is not opaque

uint thread;
vec2 at, corner; // the pixel's centre, the tile's corner in the image [px]
bool is_inside;
vec4 pixel;      // transmittance; ALONE: premultiplied colour
#if !ALONE
Fragment open_one; // splats still join it; alpha 0 = there is none
#endif

// What passes the splat's depth at the pixel; 1 = it does not cover the pixel.
float find_pass(Splat s) {
    float depth = s.shape.y;
    if (kind.x != 0u) {
        if (!(all(lessThan(s.place.xy, at)) && all(lessThan(at, s.place.zw))))
            return 1.0;
    } else {
        vec2 d = at - s.place.xy;
        float p = (s.place.z * d.x + s.place.w * d.y) * d.x + s.shape.x * d.y * d.y;
        depth *= p <= filter_of.z ? exp2(-p) : 0.0;
    }
    return kind.y != 0u ? 1.0 - min(depth, 1.0) : exp2(-LOG2E * depth);
}

#if ALONE
void add_splat(Splat s) {
    float left = pixel.x * find_pass(s);
    pixel.yzw += (pixel.x - left) * s.color.rgb;
    pixel.x = left;
}
#else
void close_fragment() {
    if (open_one.color.a > 0.0)
        add_fragment(open_one);
    open_one.color = vec4(0);
}

void add_splat(Splat s) {
    float pass = find_pass(s), depth = s.color.w * cell.x;
    if (!(pass < 1.0))
        return;
    if (open_one.color.a > 0.0 && !(abs(depth - open_one.depth) < cell.z * cell.x))
        close_fragment();
    if (!(open_one.color.a > 0.0))
        open_one.depth = depth;
    open_one.color += (1.0 - open_one.color.a) * (1.0 - pass) * vec4(s.color.rgb, 1.0);
    pixel.x *= pass;
}
#endif

void begin_entries() {
    if (thread == 0u)
        is_live = false;
    barrier();
    if (is_inside && pixel.x >= TRANSMITTANCE_MIN)
        is_live = true;
}

bool is_wanted(uint voxel) {
    return is_live && set_up(voxel, corner, staged[thread]);
}

void add_entry(uint slot, uint voxel) {
    if (pixel.x >= TRANSMITTANCE_MIN)
        add_splat(staged[slot]);
}

uint tile_word(uint i) {
    return shell_words[i];
}

#if ALONE
void begin_pixel(uint i, uint pixels) {
    pixel = is_inside ? image[i] : vec4(0);
}

void end_pixel(uint i, uint pixels) {
    if (is_inside)
        image[i] = pixel;
}
#else
void begin_pixel(uint i, uint pixels) {
    open_one = Fragment(0.0, vec4(0));
    merged_count = 0u;
    pixel = vec4(is_inside ? 1.0 : 0.0);
    if (part.w != 0u || !is_inside)
        return;
    vec4 rest = image[pixels + i];
    open_one = Fragment(rest.x, image[i]);
    pixel.x = rest.y;
    for (uint n = uint(rest.z); merged_count < n; merged_count++)
        merged[merged_count] = Fragment(image[(2u * merged_count + 3u) * pixels + i].x,
                                        image[(2u * merged_count + 2u) * pixels + i]);
}

void end_pixel(uint i, uint pixels) {
    if (capacity.z != 0u) {
        close_fragment();
        store_fragments(is_inside && merged_count > 0u, capacity.y, capacity.x, i, pixels);
        return;
    }
    if (!is_inside)
        return;
    image[i] = open_one.color;
    image[pixels + i] = vec4(open_one.depth, pixel.x, float(merged_count), 0.0);
    for (uint n = 0u; n < merged_count; n++) {
        image[(2u * n + 2u) * pixels + i] = merged[n].color;
        image[(2u * n + 3u) * pixels + i] = vec4(merged[n].depth);
    }
}
#endif

void main() {
    thread = gl_LocalInvocationIndex;
    is_perspective = choice.x != 0u;
    uvec2 px = gl_WorkGroupID.xy * TILE + gl_LocalInvocationID.xy;
    uint pixels = part.x * (tiles.z - tiles.y), i = px.y * part.x + px.x;
    is_inside = px.x < part.x && px.y < tiles.z - tiles.y;
    corner = vec2(gl_WorkGroupID.xy * TILE + uvec2(0u, tiles.y));
    at = corner + vec2(gl_LocalInvocationID.xy) + 0.5;
    begin_pixel(i, pixels);
    add_entries(uvec2(corner), kind.w, words.x, part.yz);
    end_pixel(i, pixels);
}
