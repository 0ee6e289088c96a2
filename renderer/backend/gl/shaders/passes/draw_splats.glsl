// SPDX-License-Identifier: Apache-2.0
// Draws the splats of a layer in a band (draw/layers/splat_list/tile.c): one work group per tile, one thread per pixel. Pairs come front to back;
// their splats are staged in shared memory. ALONE: they are composited. Else splats of a pixel with nearly the same depth
// become a fragment. To keep dispatches short, a tile with many pairs takes several passes; a layer may have several batches.

layout(local_size_x = TILE, local_size_y = TILE) in;
layout(std430, binding = 2) readonly buffer Totals { uint totals[]; };
layout(std430, binding = 3) readonly buffer Pairs { uint pairs[]; };
// ALONE: by pixel of the band, transmittance and premultiplied colour. Else by pixel, then again by pixel, …, between dispatches:
// the open fragment (colour | first depth, what the pixel lets through, fragments, sum of depths), then fragments (colour | depth).
layout(std430, binding = 4) buffer Image { vec4 image[]; };

layout(location = 1) uniform uvec3 batch;    // width of the image [px]; pairs: capacity, of a tile in a pass
layout(location = 2) uniform uvec3 joint;    // pass, passes, bits as below
layout(location = 3) uniform uvec2 capacity; // fragments that the buffer holds; words before those of pixels

const uint BEGINS = 1u, ENDS = 2u; // the layer
const uint STAGED = TILE * TILE;
const float TRANSMITTANCE_MIN = 1.0 / 512.0;

shared Splat staged[STAGED];
shared bool is_live; // some pixel is not opaque

vec2 at; // the pixel's centre [px]
bool is_inside;
vec4 pixel; // transmittance; ALONE: premultiplied colour
#if !ALONE
Fragment open_one; // splats still join it; `depth` is the depth of its first splat; alpha 0 = there is none
float depth_sum;   // of its splats, times their opacities
float wall;        // splats behind this depth do not join it
const float WALL = 0.1; // SP_VOXEL_WALL
#endif

float attenuate(float depth) {
    return kind.y != 0u ? 1.0 - min(depth, 1.0) : exp2(-LOG2E * depth);
}

#if STREAKS
// draw/layers/splat_list/streak.h
const float ROW = 1.0, WIDTH = 0.8, SHARE = 0.7, MEAN = (8.0 / 15.0) * (8.0 / 15.0) * WIDTH * SHARE;

float bump(float x, float half_width) {
    float y = max(1.0 - x * x / (half_width * half_width), 0.0);
    return y * y;
}

float compute_intensity(Splat s, vec2 place) {
    float across = place.y / ROW + s.wave.z, row = roundEven(across);
    float u = place.x * s.wave.x - fract(s.wave.w) + row * 0.61803399;
    return bump(u - roundEven(u), 0.5 * SHARE) * bump(across - row, 0.5 * WIDTH);
}

// What passes the splat at the pixel, 1 = it does not cover the pixel; and its colour there.
float compute_pass(Splat s, out vec3 color) {
    vec2 d = at - s.place.xy;
    float p = (s.place.z * d.x + s.place.w * d.y) * d.x + s.shape.x * d.y * d.y;
    color = s.color.rgb;
    if (!(p <= filter_of.z))
        return 1.0;
    float weight = exp2(-p), intensity = compute_intensity(s, vec2(dot(s.turn.xy, d), dot(s.turn.zw, d)));
    if (streaks.w != 0.0)
        color = mix(color, streak_color.rgb, sqrt(weight) * (MEAN + s.wave.y * (intensity - MEAN)));
    else
        weight *= 1.0 - s.wave.y + s.wave.y / MEAN * intensity;
    return attenuate(s.shape.y * weight);
}
#else
// The weight of a kernel ahead of the eye at the pixel (draw/layers/splat_list/close.h).
float weigh_ahead(Splat s, vec4 more) {
    vec2 d = at - s.place.xy, ratio = (s.place.xy - view.yz) / view.x, near = s.shape.z * d;
    float p = (s.place.z * d.x + s.place.w * d.y) * d.x + s.shape.x * d.y * d.y;
    float b = 1.0 + dot(more.xy, near), own = b * b + 2.0 / LOG2E * s.shape.z * s.shape.z * p / more.w;
    float e = 1.0 + (2.0 * dot(ratio, near) + dot(near, near) / view.x) / (view.x * (1.0 + dot(ratio, ratio)));
    if (!(b > 0.0 && (TRAINED != 0 || p <= filter_of.z * own)))
        return 0.0;
    return exp2(-p / own) * (TRAINED != 0 ? 1.0 : sqrt(max(e, 0.0) / own));
}

// The same for a kernel around the eye.
float weigh_around(Splat s, vec4 more) {
    const float FADE = 4.0;
    vec2 d = (at - view.yz) / view.x;
    float own = (s.place.z * d.x + s.place.w * d.y + s.place.x) * d.x + (s.shape.x * d.y + s.place.y) * d.y + 1.0;
    float root = sqrt(own), t = (dot(more.xy, d) + more.z) / root, p = 0.5 * LOG2E * (more.w - t * t);
    float weight = exp2(-p) * normal_share(t + (s.shape.z + 1.0) * root);
    if (TRAINED != 0)
        return weight;
    if (t <= 0.0)
        weight *= clamp(FADE * (filter_of.y - sqrt(more.w)), 0.0, 1.0);
    return p <= filter_of.z ? weight * sqrt(1.0 + dot(d, d)) / root : 0.0;
}

float weigh(Splat s) {
    if (s.shape.z != 0.0) {
        vec4 more = records[RECORD_WORDS * uint(s.shape.w) + 3u];
        return s.shape.z > 0.0 ? weigh_ahead(s, more) : weigh_around(s, more);
    }
    vec2 d = at - s.place.xy;
    float p = (s.place.z * d.x + s.place.w * d.y) * d.x + s.shape.x * d.y * d.y;
    return TRAINED != 0 || p <= filter_of.z ? exp2(-p) : 0.0;
}

float compute_pass(Splat s, out vec3 color) {
    color = s.color.rgb;
#if TRAINED
    float opacity = s.shape.y * weigh(s);
    return opacity >= TRAINED_OPACITY_MIN ? 1.0 - min(opacity, TRAINED_OPACITY_MAX) : 1.0;
#else
    if (kind.x != 0u)
        return all(lessThan(s.place.xy, at)) && all(lessThan(at, s.place.zw)) ? attenuate(s.shape.y) : 1.0;
    return attenuate(s.shape.y * weigh(s));
#endif
}
#endif

#if ALONE
void add_splat(Splat s) {
    vec3 color;
    float left = pixel.x * compute_pass(s, color);
    pixel.yzw += (pixel.x - left) * color;
    pixel.x = left;
}
#else
void close_fragment() {
    if (open_one.color.a > 0.0)
        add_fragment(Fragment(depth_sum / open_one.color.a, open_one.color));
    open_one.color = vec4(0);
    depth_sum = 0.0;
}

// Sets the wall: the depth of the nearest dense fragment of another layer behind the open fragment.
void update_wall() {
    wall = 3.0e38;
    for (uint i = merged_count; i > 0u && merged[i - 1u].depth > open_one.depth; i--)
        if (merged[i - 1u].color.a >= WALL)
            wall = merged[i - 1u].depth;
}

// struct sp_voxel_frame: apart
bool joins(float depth) {
    float before = pixel.x / (1.0 - open_one.color.a);
    return depth < wall && abs(depth - open_one.depth) * before < cell.z * cell.x * (1.0 + 0.5 * float(merged_count));
}

void add_splat(Splat s) {
    vec3 color;
    float pass = compute_pass(s, color), depth = s.color.w * cell.x;
    if (!(pass < 1.0))
        return;
    if (open_one.color.a > 0.0 && !joins(depth))
        close_fragment();
    if (!(open_one.color.a > 0.0)) {
        open_one.depth = depth;
        update_wall();
    }
    float share = (1.0 - open_one.color.a) * (1.0 - pass);
    open_one.color += share * vec4(color, 1.0);
    depth_sum += share * depth;
    pixel.x *= pass;
}
#endif

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
    depth_sum = 0.0;
    wall = 3.0e38;
    merged_count = 0u;
    pixel = vec4(is_inside ? 1.0 : 0.0);
    if (!is_inside)
        return;
    if ((joint.z & BEGINS) != 0u) { // other layers may have been drawn
        load_fragments(capacity.y, i, pixels);
        return;
    }
    vec4 rest = image[pixels + i];
    open_one = Fragment(rest.x, image[i]);
    depth_sum = rest.w;
    pixel.x = rest.y;
    for (uint n = uint(rest.z); merged_count < n; merged_count++)
        merged[merged_count] = Fragment(image[(2u * merged_count + 3u) * pixels + i].x,
                                        image[(2u * merged_count + 2u) * pixels + i]);
    update_wall();
}

void end_pixel(uint i, uint pixels) {
    if ((joint.z & ENDS) != 0u) {
        close_fragment();
        store_fragments(is_inside && merged_count > 0u, capacity.y, capacity.x, i, pixels);
        return;
    }
    if (!is_inside)
        return;
    image[i] = open_one.color;
    image[pixels + i] = vec4(open_one.depth, pixel.x, float(merged_count), depth_sum);
    for (uint n = 0u; n < merged_count; n++) {
        image[(2u * n + 2u) * pixels + i] = merged[n].color;
        image[(2u * n + 3u) * pixels + i] = vec4(merged[n].depth);
    }
}
#endif

uint end_of(uint bin) {
    return totals[bin / SCAN_BLOCK] + count[bin];
}

// Loads pairs [begin, begin + STAGED) into shared memory, one per thread; true while some pixel needs them.
bool stage(uint begin, uint end) {
    uint thread = gl_LocalInvocationIndex;
    barrier();
    if (thread == 0u)
        is_live = false;
    barrier();
    if (pixel.x >= TRANSMITTANCE_MIN)
        is_live = true;
    if (begin + thread < end)
        staged[thread] = read_splat(pairs[begin + thread] & ((1u << RECORD_BITS) - 1u));
    barrier();
    return is_live;
}

void main() {
    uint tile = gl_WorkGroupID.y * tiles.x + gl_WorkGroupID.x;
    uvec2 px = gl_WorkGroupID.xy * TILE + gl_LocalInvocationID.xy;
    uint pixels = batch.x * (tiles.z - tiles.y), i = px.y * batch.x + px.x;
    uint first = tile > 0u ? end_of(tile * tiles.w - 1u) : 0u, end = end_of(tile * tiles.w + tiles.w - 1u);
    is_inside = px.x < batch.x && px.y < tiles.z - tiles.y;
    at = vec2(px) + vec2(0.5, float(tiles.y) + 0.5);
    if (total > batch.y)
        end = first;
    if (gl_LocalInvocationIndex == 0u && joint.x == 0u)
        atomicMax(longest_elements, end - first);
    if (end - first > batch.z * joint.y) // too many: the band is drawn again in more passes
        end = first;
    first += joint.x * batch.z;
    end = min(end, first + batch.z);
    if (first >= end && joint.z == 0u)
        return;
    begin_pixel(i, pixels);
    for (; first < end && stage(first, end); first += STAGED)
        for (uint k = 0u, n = min(STAGED, end - first); k < n; k++)
            if (pixel.x >= TRANSMITTANCE_MIN)
                add_splat(staged[k]);
    end_pixel(i, pixels);
}
