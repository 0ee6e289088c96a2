// SPDX-License-Identifier: Apache-2.0
// Adds a mesh to the fragments of a band (draw/layers/mesh/cover.c and resolve.c). One work group per tile, one thread per pixel. Triangles
// are set up in shared memory; each of a pixel's samples keeps the nearest one. A sheet is what is nearest; then triangles are drawn
// again, and each sample takes the nearest one behind the sheet before. To keep dispatches short, each sheet has its own, and a tile
// with many triangles several. The last one makes fragments.

layout(local_size_x = TILE, local_size_y = TILE) in;
layout(std430, binding = 3) readonly buffer Pairs { uint pairs[]; };
// By pixel of the band, then again by pixel, …, between dispatches: the samples of the sheet (inverse | triangle), the samples of
// the sheet before, the light that each sample lets through, and the visible parts.
layout(std430, binding = 4) buffer State { uvec4 state[]; };
layout(std430, binding = 6) readonly buffer Totals { uint totals[]; };

layout(location = 1) uniform uvec4 batch;    // width of the image [px]; pairs: capacity, of a tile in a pass; first triangle
layout(location = 2) uniform uvec4 joint;    // pass, passes, sheet, bits as below
layout(location = 3) uniform uvec2 capacity; // fragments that the buffer holds; words before those of pixels

const uint RESUMES = 1u, ENDS_SHEET = 2u, ENDS_MESH = 4u;
const uint STAGED = TILE * TILE, SAMPLES = 16u, NONE = 0xffffffffu, SHADED = 4u;
const uint AT_BEFORE = 8u, AT_LIGHT = 16u, AT_VISIBLE = 20u; // words of four
const float BEHIND_ALL = -3.4e38, INCLUSIVE = -1.17549435e-38;
const uint RECORD_BITS = 22u;

// Where the samples of a pixel lie, from its middle, 16ths of px (draw/layers/mesh/samples.h). Samples are handled in fours, and each function
// names all four fours: registers have no index.
const vec4 RIGHT[4] = vec4[](vec4(1.5, -0.5, -2.5, 4.5), vec4(-4.5, 2.5, 5.5, 3.5), vec4(-1.5, 0.5, -3.5, -5.5),
                             vec4(-7.5, 7.5, 6.5, -6.5));
const vec4 DOWN[4] = vec4[](vec4(1.5, -2.5, 2.5, -0.5), vec4(-1.5, 5.5, 3.5, -4.5), vec4(6.5, -6.5, -5.5, 4.5),
                            vec4(0.5, -3.5, 7.5, -7.5));

// x and y from the tile's corner. An edge is where a·x + b·y + c = 0; a sample is inside where that exceeds the fourth number. Of
// two triangles at an edge these are opposite, to the bit, and one of them has the edge.
struct Triangle {
    vec4 edges[3];
    vec4 depth;  // slope (2) and start of the inverse of u2, or of −u2; 1 = the near plane may cut it
    vec2 bounds; // of the same
    uint number;
};

shared Triangle staged[STAGED];
shared uint wanted[STAGED / 32u]; // bits of the staged triangles that were set up
shared bool is_live;              // some pixel may show a triangle

vec2 at, corner; // the pixel's centre in the tile, the tile's corner in the image [px]
vec4 inverse[4], inverse_before[4], light[4]; // by sample
uvec4 triangle[4], triangle_before[4];

bool is_after(vec3 a, vec3 b) {
    return a.x > b.x || (a.x == b.x && (a.y > b.y || (a.y == b.y && a.z > b.z)));
}

// The edge between two corners: both triangles there take them in the same order.
vec3 compute_edge(vec3 from, vec3 to, out bool turns) {
    turns = is_after(from, to);
    vec3 a = turns ? to : from, b = turns ? from : to;
    precise vec3 e = vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
    return turns ? -e : e;
}

bool set_up(uint number, out Triangle t) {
    vec3 h[3], e[3], q;
    bvec3 turns;
    bool is_perspective = choice.x != 0u;
    for (uint k = 0u; k < 3u; k++) {
        vec3 u = compute_camera(corners[3u * number + k]);
        h[k] = project(u, corner);
        q[k] = is_perspective ? 1.0 : -u.z;
    }
    for (int k = 0; k < 3; k++) {
        bool is_turned;
        e[k] = compute_edge(h[(k + 1) % 3], h[(k + 2) % 3], is_turned);
        turns[k] = is_turned;
    }
    float det = dot(e[0], h[0]);
    if (!(abs(det) > 0.0 && abs(det) < 1e37))
        return false;
    for (int k = 0; k < 3; k++)
        t.edges[k] = vec4(det < 0.0 ? -e[k] : e[k], turns[k] == (det < 0.0) ? INCLUSIVE : 0.0);
    vec3 w = vec3(h[0].z, h[1].z, h[2].z), own = is_perspective ? 1.0 / w : q;
    bool is_cut = !all(greaterThanEqual(w, vec3(view.w)));
    t.depth = vec4((q.x * t.edges[0].xyz + q.y * t.edges[1].xyz + q.z * t.edges[2].xyz) / abs(det), is_cut ? 1.0 : 0.0);
    t.bounds = is_cut ? vec2(0.0, 1.0 / view.w) : vec2(min(own.x, min(own.y, own.z)), max(own.x, max(own.y, own.z)));
    t.number = number;
    return true;
}

// What the half-spaces keep of four samples.
bvec4 keep(vec4 right, vec4 down, vec4 depth) {
    vec4 least = vec4(0);
    for (uint i = 0u; i < mesh_kind.y; i++)
        least = min(least, halves[i].x * right + halves[i].y * down + halves[i].z + halves[i].w * depth);
    return greaterThanEqual(least, vec4(0));
}

void cover_four(Triangle t, vec3 middle, float depth, int q) {
    vec4 right = RIGHT[q] / 16.0, down = DOWN[q] / 16.0;
    bvec4 inside = bvec4(true);
    for (int k = 0; k < 3; k++) {
        precise vec4 edge = (middle[k] + t.edges[k].x * right) + t.edges[k].y * down;
        inside = bvec4(uvec4(inside) & uvec4(greaterThan(edge, vec4(t.edges[k].w))));
    }
    if (!any(inside))
        return;
    vec4 own = depth + t.depth.x * right + t.depth.y * down;
    uvec4 hits = uvec4(inside), number = uvec4(t.number); // 1 or 0 each
    if (t.depth.w != 0.0)
        hits &= uvec4(greaterThan(own, t.bounds.xxxx)) & uvec4(lessThanEqual(own, t.bounds.yyyy));
    own = clamp(own, t.bounds.x, t.bounds.y);
    hits &= uvec4(greaterThan(own, inverse[q])) |
                   (uvec4(equal(own, inverse[q])) & uvec4(lessThan(number, triangle[q])));
    if (joint.z != 0u) // triangles at the same depth follow each other in their order
        hits &= uvec4(lessThan(own, inverse_before[q])) |
                       (uvec4(equal(own, inverse_before[q])) & uvec4(lessThan(triangle_before[q], number)));
    if (mesh_kind.y != 0u)
        hits &= uvec4(keep(corner.x + at.x + right, corner.y + at.y + down, own));
    inverse[q] = mix(inverse[q], own, bvec4(hits));
    triangle[q] = (triangle[q] & (hits - 1u)) | (number & ~(hits - 1u));
}

void add_triangle(Triangle t) {
    precise vec3 middle;
    for (int k = 0; k < 3; k++)
        middle[k] = (t.edges[k].z + t.edges[k].x * at.x) + t.edges[k].y * at.y;
    if (middle.x < -0.5 * (abs(t.edges[0].x) + abs(t.edges[0].y)) || middle.y < -0.5 * (abs(t.edges[1].x) + abs(t.edges[1].y)) ||
        middle.z < -0.5 * (abs(t.edges[2].x) + abs(t.edges[2].y)))
        return;
    float depth = t.depth.z + dot(t.depth.xy, at);
    cover_four(t, middle, depth, 0);
    cover_four(t, middle, depth, 1);
    cover_four(t, middle, depth, 2);
    cover_four(t, middle, depth, 3);
}

uint match_bits(uvec4 numbers, uint number) {
    uvec4 bits = uvec4(equal(numbers, uvec4(number))) * uvec4(1, 2, 4, 8);
    return bits.x | bits.y | bits.z | bits.w;
}

// The samples in a triangle, as bits.
uint match_samples(uint number) {
    return match_bits(triangle[0], number) | match_bits(triangle[1], number) << 4 | match_bits(triangle[2], number) << 8 |
           match_bits(triangle[3], number) << 12;
}

// The four that sample s belongs to.
uvec4 choose_four(uvec4 a, uvec4 b, uvec4 c, uvec4 d, uint s) {
    return s < 8u ? (s < 4u ? a : b) : (s < 12u ? c : d);
}

uint triangle_of(uint s) {
    return choose_four(triangle[0], triangle[1], triangle[2], triangle[3], s)[s % 4u];
}

float inverse_of(uint s) {
    return uintBitsToFloat(choose_four(floatBitsToUint(inverse[0]), floatBitsToUint(inverse[1]), floatBitsToUint(inverse[2]),
                                       floatBitsToUint(inverse[3]), s)[s % 4u]);
}

// For each of four samples 1 if it is in the set `samples`, else 0.
vec4 mask_four(uint samples, int q) {
    return vec4((uvec4(samples) >> (uvec4(0, 1, 2, 3) + 4u * uint(q))) & 1u);
}

// Adds the places and depths of some of four samples: right, down, inverse.
vec3 sum_four(uint samples, int q) {
    vec4 mask = mask_four(samples, q);
    return vec3(dot(mask, RIGHT[q]), dot(mask, DOWN[q]), dot(mask, mix(vec4(0), inverse[q], equal(mask, vec4(1)))));
}

// The light of four samples that a part with this opacity hides.
float hide_four(uint samples, float opacity, int q) {
    vec4 hidden = mask_four(samples, q) * light[q] * opacity;
    light[q] -= hidden;
    return dot(hidden, vec4(1));
}

// Shows some samples of one triangle, which are not empty.
void show_samples(uint number, uint samples) {
    vec3 sum = sum_four(samples, 0) + sum_four(samples, 1) + sum_four(samples, 2) + sum_four(samples, 3);
    sum *= vec3(1.0 / 16.0, 1.0 / 16.0, 1.0) / float(bitCount(samples));
    vec4 color = shade_triangle(number, corner + at + sum.xy);
    float hidden = hide_four(samples, color.a, 0) + hide_four(samples, color.a, 1) + hide_four(samples, color.a, 2) +
                   hide_four(samples, color.a, 3);
    hidden /= float(SAMPLES);
    if (hidden > 0.0)
        show_part(VisiblePart(choice.x != 0u ? 1.0 / sum.z : -sum.z, hidden * vec4(color.rgb, 1.0)));
}

// The part whose depth is nearest, by sample; SHADED = none is near. `firsts`: the depths of the parts.
uvec4 choose_nearest(vec4 firsts, int q) {
    vec4 away = lengths.y * (choice.x != 0u ? inverse[q] : vec4(1));
    uvec4 nearest = uvec4(SHADED);
    for (uint k = 0u; k < SHADED; k++) {
        vec4 one = abs(inverse[q] - firsts[k]);
        bvec4 is_nearer = lessThan(one, away);
        nearest = uvec4(mix(vec4(nearest), vec4(float(k)), is_nearer));
        away = mix(away, one, is_nearer);
    }
    return nearest;
}

// Shows the sheet: its first triangles, with those samples of others that are near them, and the other ones.
void show_sheet() {
    uint samples[SHADED], numbers[SHADED], count = 0u, left = ((1u << SAMPLES) - 1u) & ~match_samples(NONE);
    vec4 firsts;
    for (; left != 0u && count < SHADED; count++) {
        uint first = uint(findLSB(left));
        firsts[count] = inverse_of(first);
        numbers[count] = triangle_of(first);
        samples[count] = match_samples(numbers[count]);
        left &= ~samples[count];
    }
    if (left != 0u) {
        uvec4 nearest[4] = uvec4[](choose_nearest(firsts, 0), choose_nearest(firsts, 1), choose_nearest(firsts, 2), choose_nearest(firsts, 3));
        uint all = left;
        for (uint k = 0u; k < SHADED; k++) {
            uint own = all & (match_bits(nearest[0], k) | match_bits(nearest[1], k) << 4 | match_bits(nearest[2], k) << 8 |
                              match_bits(nearest[3], k) << 12);
            samples[k] |= own;
            left &= ~own;
        }
    }
    for (uint k = 0u; k < count || left != 0u; k++) {
        uint number = k < count ? numbers[min(k, SHADED - 1u)] : triangle_of(uint(findLSB(left)));
        uint own = k < count ? samples[min(k, SHADED - 1u)] : match_samples(number) & left;
        show_samples(number, own);
        left &= ~own;
    }
}

void read_samples(uint word, uint pixel, uint pixels, out vec4 depths[4], out uvec4 numbers[4]) {
    for (uint q = 0u; q < 4u; q++) {
        depths[q] = uintBitsToFloat(state[(word + q) * pixels + pixel]);
        numbers[q] = state[(word + 4u + q) * pixels + pixel];
    }
}

void keep_samples(uint word, uint pixel, uint pixels) {
    for (uint q = 0u; q < 4u; q++) {
        state[(word + q) * pixels + pixel] = floatBitsToUint(inverse[q]);
        state[(word + 4u + q) * pixels + pixel] = triangle[q];
    }
}

void read_visible(uint pixel, uint pixels) {
    for (uint q = 0u; q < 4u; q++)
        light[q] = uintBitsToFloat(state[(AT_LIGHT + q) * pixels + pixel]);
    visible_count = state[AT_VISIBLE * pixels + pixel].x;
    for (uint i = 0u; i < visible_count; i++) {
        visible[i].color = uintBitsToFloat(state[(AT_VISIBLE + 1u + 2u * i) * pixels + pixel]);
        visible[i].depth = uintBitsToFloat(state[(AT_VISIBLE + 2u + 2u * i) * pixels + pixel].x);
    }
}

void keep_visible(uint pixel, uint pixels) {
    for (uint q = 0u; q < 4u; q++)
        state[(AT_LIGHT + q) * pixels + pixel] = floatBitsToUint(light[q]);
    state[AT_VISIBLE * pixels + pixel] = uvec4(visible_count);
    for (uint i = 0u; i < visible_count; i++) {
        state[(AT_VISIBLE + 1u + 2u * i) * pixels + pixel] = floatBitsToUint(visible[i].color);
        state[(AT_VISIBLE + 2u + 2u * i) * pixels + pixel] = uvec4(floatBitsToUint(visible[i].depth));
    }
}

uint end_of(uint bin) {
    return totals[bin / SCAN_BLOCK] + count[bin];
}

// Covers the samples with the tile's pairs of this pass. Every thread must call it.
void cover() {
    uint thread = gl_LocalInvocationIndex, tile = gl_WorkGroupID.y * tiles.x + gl_WorkGroupID.x;
    uint first = tile > 0u ? end_of(tile - 1u) : 0u, end = end_of(tile);
    if (total > batch.y)
        end = first;
    if (thread == 0u)
        atomicMax(longest_elements, end - first);
    if (end - first > batch.z * joint.y) // too many: the band is drawn again in more passes
        end = first;
    first += joint.x * batch.z;
    end = min(end, first + batch.z);
    for (; first < end; first += STAGED) {
        barrier();
        if (thread < STAGED / 32u)
            wanted[thread] = 0u;
        barrier();
        if (first + thread < end && set_up(batch.w + (pairs[first + thread] & ((1u << RECORD_BITS) - 1u)), staged[thread]))
            atomicOr(wanted[thread / 32u], 1u << (thread % 32u));
        barrier();
        for (uint w = 0u; w < STAGED / 32u; w++)
            for (uint left = wanted[w]; left != 0u; left &= left - 1u)
                add_triangle(staged[32u * w + uint(findLSB(left))]);
    }
}

// Reads the sheet before. Does it leave something to see?
bool begin_sheet(uint pixel, uint pixels) {
    if (joint.z == 0u)
        return true;
    read_samples(AT_BEFORE, pixel, pixels, inverse_before, triangle_before);
    uvec4 none = triangle_before[0] & triangle_before[1] & triangle_before[2] & triangle_before[3];
    return (none.x & none.y & none.z & none.w) != NONE;
}

void begin_pixel(uint pixel, uint pixels) {
    for (uint q = 0u; q < 4u; q++) {
        inverse[q] = vec4(BEHIND_ALL);
        triangle[q] = uvec4(NONE);
        light[q] = vec4(1);
    }
    visible_count = 0u;
    if ((joint.w & RESUMES) != 0u)
        read_samples(0u, pixel, pixels, inverse, triangle);
    if (joint.z != 0u && (joint.w & ENDS_SHEET) != 0u)
        read_visible(pixel, pixels);
}

void main() {
    uvec2 px = gl_WorkGroupID.xy * TILE + gl_LocalInvocationID.xy;
    uint pixels = batch.x * (tiles.z - tiles.y), own = px.y * batch.x + px.x;
    bool is_inside = px.x < batch.x && px.y < tiles.z - tiles.y;
    uint pixel = is_inside ? own : 0u;
    corner = vec2(gl_WorkGroupID.xy * TILE + uvec2(0u, tiles.y));
    at = vec2(gl_LocalInvocationID.xy) + 0.5;
    if (gl_LocalInvocationIndex == 0u)
        is_live = false;
    barrier();
    if (is_inside && begin_sheet(pixel, pixels))
        is_live = true;
    barrier();
    if (!is_live && (joint.w & ENDS_MESH) == 0u)
        return; // what was kept stays
    begin_pixel(pixel, pixels);
    if (is_live)
        cover();
    if ((joint.w & ENDS_SHEET) == 0u) {
        if (is_inside)
            keep_samples(0u, pixel, pixels);
        return;
    }
    show_sheet();
    if ((joint.w & ENDS_MESH) == 0u) {
        if (is_inside) {
            keep_samples(AT_BEFORE, pixel, pixels);
            keep_visible(pixel, pixels);
        }
        return;
    }
    load_fragments(capacity.y, pixel, pixels);
    store_fragments(is_inside && add_visible(), capacity.y, capacity.x, pixel, pixels);
}
