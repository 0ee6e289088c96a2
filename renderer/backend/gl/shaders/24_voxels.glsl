// SPDX-License-Identifier: Apache-2.0
// Draws a shell, or STREAKS, in a band (voxels/tile.c): one work group per tile, one thread per pixel. Voxels come front to back;
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

float attenuate(float depth) {
    return kind.y != 0u ? 1.0 - min(depth, 1.0) : exp2(-LOG2E * depth);
}

#if STREAKS
// voxels/streak.h
const float ROW = 1.0, WIDTH = 0.8, SHARE = 0.7, MEAN = (8.0 / 15.0) * (8.0 / 15.0) * WIDTH * SHARE;

float bump(float x, float half_width) {
    float y = max(1.0 - x * x / (half_width * half_width), 0.0);
    return y * y;
}

float find_intensity(Splat s, vec2 place) {
    float across = place.y / ROW + s.wave.z, row = roundEven(across);
    float u = place.x * s.wave.x - fract(s.wave.w) + row * 0.61803399;
    return bump(u - roundEven(u), 0.5 * SHARE) * bump(across - row, 0.5 * WIDTH);
}

// What passes the splat at the pixel, 1 = it does not cover the pixel; and its colour there.
float find_pass(Splat s, out vec3 color) {
    vec2 d = at - s.place.xy;
    float p = (s.place.z * d.x + s.place.w * d.y) * d.x + s.shape.x * d.y * d.y;
    color = s.color.rgb;
    if (!(p <= filter_of.z))
        return 1.0;
    float weight = exp2(-p), intensity = find_intensity(s, vec2(dot(s.turn.xy, d), dot(s.turn.zw, d)));
    if (streaks.w != 0.0)
        color = mix(color, streak_color.rgb, sqrt(weight) * (MEAN + s.wave.y * (intensity - MEAN)));
    else
        weight *= 1.0 - s.wave.y + s.wave.y / MEAN * intensity;
    return attenuate(s.shape.y * weight);
}
#else
// What passes the splat at the pixel, 1 = it does not cover the pixel; and its colour there.
float find_pass(Splat s, out vec3 color) {
    float depth = s.shape.y;
    color = s.color.rgb;
    if (kind.x != 0u) {
        if (!(all(lessThan(s.place.xy, at)) && all(lessThan(at, s.place.zw))))
            return 1.0;
    } else {
        vec2 d = at - s.place.xy;
        float p = (s.place.z * d.x + s.place.w * d.y) * d.x + s.shape.x * d.y * d.y;
        depth *= p <= filter_of.z ? exp2(-p) : 0.0;
    }
    return attenuate(depth);
}
#endif

#if ALONE
void add_splat(Splat s) {
    vec3 color;
    float left = pixel.x * find_pass(s, color);
    pixel.yzw += (pixel.x - left) * color;
    pixel.x = left;
}
#else
void close_fragment() {
    if (open_one.color.a > 0.0)
        add_fragment(open_one);
    open_one.color = vec4(0);
}

void add_splat(Splat s) {
    vec3 color;
    float pass = find_pass(s, color), depth = s.color.w * cell.x;
    if (!(pass < 1.0))
        return;
    if (open_one.color.a > 0.0 && !(abs(depth - open_one.depth) < cell.z * cell.x))
        close_fragment();
    if (!(open_one.color.a > 0.0))
        open_one.depth = depth;
    open_one.color += (1.0 - open_one.color.a) * (1.0 - pass) * vec4(color, 1.0);
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
    return layer_words[i];
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
    if (!is_inside)
        return;
    if (part.w != 0u) { // other layers of voxels may have been drawn
        load_fragments(capacity.y, i, pixels);
        return;
    }
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
