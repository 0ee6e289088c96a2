// SPDX-License-Identifier: Apache-2.0
// Constants of a surface (surfaces.h), its blocks, and the footprints of its points
// (draw/layers/surface/set_up.c). Lengths in cells (splat/ewa.h).

// Points of 8³ cells.
struct Block {
    vec3 base;   // u of its corner
    uint first;  // point
    uint count;
    float depth; // where it begins
    uvec4 box;   // px: first column and row, ends
    uvec3 corner;
    bool is_near; // its points follow the coordinates
};

layout(std430, binding = 1) readonly buffer Surface {
    vec4 steps[3];  // rows of C
    vec4 areas[3];  // vector areas in index space → camera space
    vec4 kernel[3]; // rows of K
    vec4 view;      // scale, centre x, centre y [px], near
    vec4 filter_of; // h² [px²], Mahalanobis radius, cut, peak
    vec4 bounds;    // largest u0/u2, u1/u2; reach of a kernel, its stretch beside the image's centre
    vec4 sheet_of;  // 1 − 1/flatness, factor of bends, tolerance, depth of the first block
    vec4 look;      // colour, opacity
    vec4 cell;      // unit
    vec4 focus;     // struct sp_surface_focus: growth (0 = no block is close), least, nearest; area step of near points
    uvec4 kind;     // opaque, cuts the near plane, rectilinear, columns of tiles
    uvec4 plane_counts; // clipping planes, borders
    uvec4 words;    // first word of entries, blocks, coordinates, near points
    uvec4 rows[3];  // by axis: first row of coordinates, samples
    vec4 clip[CLIP_PLANES];
    vec4 borders[6];
    // First entry by tile of SIDE × SIDE px; by entry: block, points of the tile before it; blocks; coordinates: place,
    // length and local spacing of each cell; points close to the eye.
    uint surface_words[];
};
layout(std430, binding = 2) readonly buffer Points { uint points[]; }; // 16-bit: place, area, normal, bend

const uint BLOCK_WORDS = 12u, POINT_WORDS = 5u, ROW_WORDS = 3u;
const float PLACE_STEPS = 8192.0, AREA_STEPS = 16384.0, NORMAL_STEPS = 32767.0;
const float LOG2E = 1.44269504;

bool is_perspective;

Block read_block(uint number) {
    uint at = words.y + BLOCK_WORDS * number;
    vec3 base = vec3(uintBitsToFloat(surface_words[at]), uintBitsToFloat(surface_words[at + 1u]),
                     uintBitsToFloat(surface_words[at + 2u]));
    uint low = surface_words[at + 6u], high = surface_words[at + 7u];
    return Block(base, surface_words[at + 3u], surface_words[at + 4u], uintBitsToFloat(surface_words[at + 5u]),
                 uvec4(low & 0xffffu, low >> 16, high & 0xffffu, high >> 16),
                 uvec3(surface_words[at + 8u], surface_words[at + 9u], surface_words[at + 10u]),
                 surface_words[at + 11u] != 0u);
}

// A point in camera space.
struct Point {
    vec3 u, area, normal, size; // size: local spacing [mean spacings], less close to the eye
};

float place_high(uint word) {
    return float(word >> 16);
}

vec2 shorts(uint word) {
    return vec2(bitfieldExtract(int(word), 0, 16), bitfieldExtract(int(word), 16, 16));
}

// Distance from the block's corner along a rectilinear axis; the cell's length and the local spacing.
float measure_cell(uint axis, uint corner, float at, out float gap, out float size) {
    uint last = rows[axis].y - 1u, cell = uint(at), start = words.z + ROW_WORDS * rows[axis].x;
    uint row = start + ROW_WORDS * min(corner + cell, last), next = start + ROW_WORDS * min(corner + cell + 1u, last);
    float share = at - float(cell), low = uintBitsToFloat(surface_words[row + 2u]);
    gap = uintBitsToFloat(surface_words[row + 1u]);
    size = low + share * (uintBitsToFloat(surface_words[next + 2u]) - low);
    return uintBitsToFloat(surface_words[row]) - uintBitsToFloat(surface_words[start + ROW_WORDS * corner]) + share * gap;
}

// The size of discs at a distance from the eye, as a share of their size far away (draw/layers/surface/focus.h).
float disc_size(float distance) {
    return focus.x > 0.0 ? clamp(distance * focus.x, focus.y, 1.0) : 1.0;
}

uint point_word(Block block, uint i) {
    return block.is_near ? surface_words[words.w + i] : points[i];
}

Point read_point(Block block, uint i) {
    uint w = POINT_WORDS * (block.first + i);
    uint w0 = point_word(block, w), w1 = point_word(block, w + 1u), w2 = point_word(block, w + 2u);
    uint w3 = point_word(block, w + 3u), w4 = point_word(block, w + 4u);
    vec3 at = vec3(float(w0 & 0xffffu), place_high(w0), float(w1 & 0xffffu)) / PLACE_STEPS;
    vec3 area = vec3(shorts(w1).y, shorts(w2)) * (block.is_near ? focus.w : 1.0 / AREA_STEPS), gap = vec3(1), normal = vec3(shorts(w3), shorts(w4).x);
    Point p;
    p.size = vec3(1);
    for (uint a = 0u; a < 3u && kind.z != 0u; a++)
        at[a] = measure_cell(a, block.corner[a], at[a], gap[a], p.size[a]);
    area *= gap.yzx * gap.zxy;
    normal /= NORMAL_STEPS;
    for (int r = 0; r < 3; r++) {
        p.normal[r] = dot(to_camera[r].xyz, normal);
        p.u[r] = block.base[r] + dot(steps[r].xyz, at);
        p.area[r] = dot(areas[r].xyz, area);
    }
    float share = disc_size(length(p.u));
    p.size *= share;
    p.u += p.normal * (shorts(w4).y * sheet_of.y * share * share);
    return p;
}

// Rows of the kernel, flattened along q, the direction of the gradient in index space.
void flatten(Point p, out vec3 k[3]) {
    vec3 q = vec3(0);
    for (int r = 0; r < 3; r++) {
        k[r] = kernel[r].xyz * p.size;
        q += p.normal[r] * k[r];
    }
    float factor = sheet_of.x / (dot(q, q) + 1e-30);
    for (int r = 0; r < 3; r++)
        k[r] -= dot(k[r], q) * factor * q;
}

// Where clipping leaves something of a kernel.
bool is_kept(Point p, float margin) {
    for (uint i = 0u; i < plane_counts.x; i++)
        if (!(dot(clip[i].xyz, p.u) - clip[i].w > -margin))
            return false;
    return true;
}

// The weight at d px from the centre is peak·2^−p, p = a·dx² + b·dx·dy + c·dy² < cut, and its depth is depth + slope·d.
struct Footprint {
    vec4 place; // x, y, a, b
    vec4 shape; // c, peak, depth, tolerance
    vec4 rest;  // slope along x and y; normal's x and y
    vec2 side;  // normal's z; 1 = seen from inside
};

// Sets up everything but the centre. False if it does not touch the tile.
bool set_up_ellipse(Point p, float inverse, float half_side, inout Footprint f) {
    float scale = view.x * inverse, h2 = filter_of.x;
    vec3 k[3];
    flatten(p, k);
    vec2 ratio = is_perspective ? p.u.xy * inverse : vec2(0);
    float facing = p.area.z + dot(p.area.xy, ratio);
    ratio = clamp(ratio, -bounds.xy, bounds.xy);
    vec3 m0 = scale * (k[0] - ratio.x * k[2]), m1 = scale * (k[1] - ratio.y * k[2]), area = cross(m0, m1);
    float v00 = dot(m0, m0), v01 = dot(m0, m1), v11 = dot(m1, m1), v02 = dot(m0, k[2]), v12 = dot(m1, k[2]);
    float det = dot(area, area) + h2 * (v00 + v11) + h2 * h2, over = 1.0 / det;
    float i00 = (v11 + h2) * over, i01 = -v01 * over, i11 = (v00 + h2) * over;
    vec2 slope = vec2(i00 * v02 + i01 * v12, i01 * v02 + i11 * v12);
    float peak = scale * scale * abs(facing) * filter_of.w / sqrt(det), thickness = length(kernel[2].xyz * p.size);
    f.place.zw = vec2(0.5 * LOG2E * i00, LOG2E * i01);
    float tolerance = sheet_of.z * (thickness + 1.75 * sqrt(h2) / scale); // deviations of the kernel and of the low-pass filter
    f.shape = vec4(0.5 * LOG2E * i11, peak, p.u.z - sheet_of.w, tolerance);
    f.rest = vec4(slope, p.normal.xy);
    f.side = vec2(p.normal.z, facing > 0.0 ? 1.0 : 0.0);
    vec2 reach = filter_of.y * sqrt(vec2(v00, v11) + h2);
    return peak > 1e-6 && peak < 1e30 && all(lessThan(abs(f.place.xy - half_side), half_side + reach));
}

// Sets up point i of a block for the square of 2·half_side px at `corner`.
bool set_up(Block block, uint i, vec2 corner, float half_side, out Footprint f) {
    Point p = read_point(block, i);
    float inverse = is_perspective ? 1.0 / max(p.u.z, 0.5 * view.w) : 1.0, scale = view.x * inverse;
    float largest = max(max(p.size.x, p.size.y), p.size.z), blur = filter_of.y * sqrt(filter_of.x);
    float most = blur + half_side + bounds.z * bounds.w * largest * scale;
    f.place = vec4(view.yz - corner + scale * p.u.xy, 0.0, 0.0);
    if (focus.x > 0.0 && !(length(p.u) > focus.z))
        return false;
    if (!(p.u.z >= 0.5 * view.w && all(lessThan(abs(f.place.xy - half_side), vec2(most)))))
        return false;
    return is_kept(p, bounds.z * largest + (blur + 2.0) / scale) && set_up_ellipse(p, inverse, half_side, f);
}
