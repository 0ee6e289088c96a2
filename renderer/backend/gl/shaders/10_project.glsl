// SPDX-License-Identifier: Apache-2.0
// Voxel → splat (splat/ewa.h has the derivation): a column of work groups a brick, a thread an entry. Each entry has
// a record, whether it is drawn or not, so that nothing has to be compacted.

layout(local_size_x = GROUP) in;

struct Brick {
    vec4 base;   // u of its first voxel
    uvec4 list;  // first entry, entries, first record, part | filter << 8
    uvec4 place; // of its first voxel: index along the sheets' axis, and its row in the tables by axis
};
layout(std430, binding = 1) readonly buffer Bricks { Brick bricks[]; };
// Place in the brick in the low 12 bits, i0 | i1 << 4 | i2 << 8; above them the key, where lists have tables by key.
layout(std430, binding = 2) readonly buffer Entries { uint entries[]; };
// Scales of the opacity by packed magnitude; rows (distance from the brick's first voxel, local spacing) of
// rectilinear axes; classes (colour, depth), by key or by entry.
layout(std430, binding = 3) readonly buffer Tables { vec4 tables[]; };
layout(std430, binding = 4) readonly buffer Normals { uint normals[]; };
// records.glsl
layout(std430, binding = 5) writeonly buffer Records { uvec4 records[]; };
// Bins of a record: tiles, columns and rows [first, last]; first layer and number of layers; first > last: none.
layout(std430, binding = 6) writeonly buffer Spans { uvec2 spans[]; };

layout(location = 1) uniform uvec2 batch; // first brick, first layer
layout(location = 2) uniform uvec4 list;  // has keys, bytes of a normal, first class, has scales
layout(location = 3) uniform uint stride; // of the records
layout(location = 4) uniform uint room;   // for pairs

const uint LOWPASS = 3u, RECONSTRUCTION = 2u, SWAN = 4u, NONE = 5u; // enum sp_filter_mode
const float FARTHEST = 1e7; // cells: all beyond is as far (tile/depth.c)
const float VARIANCE_MIN = 1e-6, DEPTH_MAX = 1e6, LOG2E = 1.44269504;

shared uint group_splats, group_fragments, group_carry, group_pairs;
shared bool has_room;

// A kernel in camera space and on the image (struct sp_kernel_place).
struct Place {
    vec3 u;
    vec3 k[3];   // rows of K
    vec3 m0, m1; // the first two rows of J·K
    vec2 ratio;  // u0/u2 and u1/u2 as the Jacobian has them
    float h2;    // what of the variance is low-pass filter
};

struct Outline {
    vec2 at;     // px
    vec3 conic;  // a, b, c; flat: its box
    float gain;  // depth of a class → τ
    float area;  // px inside the cutoff
    ivec4 box;   // x0, y0, x1, y1, half open
};

// What a record adds.
struct Amount {
    float depth; // τ; post: length over L
    vec3 color;  // post: gradient
    float value; // post: scalar
};

// V̂ + h²I as (V00, V01, V11); its determinant as a sum of positive terms.
float variance(vec3 m0, vec3 m1, float h2, out vec3 v) {
    vec3 n = cross(m0, m1);
    float v00 = dot(m0, m0), v11 = dot(m1, m1);
    v = vec3(v00 + h2, dot(m0, m1), v11 + h2);
    return dot(n, n) + h2 * (v00 + v11) + h2 * h2;
}

// What m has to be multiplied by so that the smaller variance of V̂ is at least h² (Swan et al. 1997).
float widening(vec3 m0, vec3 m1, float h2) {
    vec3 v;
    float det = variance(m0, m1, 0.0, v), mean = 0.5 * (v.x + v.z);
    float apart = sqrt(0.25 * (v.x - v.z) * (v.x - v.z) + v.y * v.y);
    float smaller = det / (mean + apart);
    return smaller < h2 ? sqrt(h2 / max(smaller, 1e-12 * h2)) : 1.0;
}

// The variance of the footprint as the mode wants it; returns its determinant.
float filter_variance(uint mode, float h2, inout Place p, out vec3 v) {
    p.h2 = mode == SWAN || mode == RECONSTRUCTION || mode == NONE ? VARIANCE_MIN : h2;
    if (mode == LOWPASS) {
        v = vec3(h2, 0.0, h2);
        return h2 * h2;
    }
    if (mode == SWAN) {
        float wide = widening(p.m0, p.m1, h2);
        p.m0 *= wide;
        p.m1 *= wide;
    }
    return variance(p.m0, p.m1, p.h2, v);
}

// Pixels [first, last + 1) inside [low, high) whose centres lie within ±reach of x.
ivec2 cover(float x, float reach, int low, int high) {
    return ivec2(ceil(clamp(x - reach - 0.5, float(low), float(high))),
                 floor(clamp(x + reach + 0.5, float(low), float(high))));
}

// The same for centres in [x - reach, x + reach): of a width of one pixel there is just one.
ivec2 cover_flat(float x, float reach, int low, int high) {
    return ivec2(ceil(clamp(x - reach - 0.5, float(low), float(high))),
                 ceil(clamp(x + reach - 0.5, float(low), float(high))));
}

void outline_flat(Part part, vec3 v, inout Outline o) {
    vec2 r = max(part.bounds.y * sqrt(v.xz), vec2(0.5));
    o.area = 4.0 * r.x * r.y;
    o.gain /= o.area;
    ivec2 x = cover_flat(o.at.x, r.x, 0, int(picture.x));
    ivec2 y = cover_flat(o.at.y, r.y, int(tiles.y), int(tiles.z));
    o.box = ivec4(x.x, y.x, x.y, y.y);
    o.conic = uintBitsToFloat(uvec3(o.box.x | o.box.z << 16, o.box.y | o.box.w << 16, 0u));
}

void outline_ellipse(Part part, vec3 v, float det, inout Outline o) {
    float root = sqrt(det), inverse = 0.5 * LOG2E / det;
    vec2 r = part.footprint.y * sqrt(v.xz);
    o.conic = inverse * vec3(v.z, -2.0 * v.y, v.x);
    o.area = 3.14159265 * part.footprint.y * part.footprint.y * root;
    o.gain *= part.footprint.w / root;
    ivec2 x = cover(o.at.x, r.x, 0, int(picture.x));
    ivec2 y = cover(o.at.y, r.y, int(tiles.y), int(tiles.z));
    o.box = ivec4(x.x, y.x, x.y, y.y);
}

// Geometry of the kernel at p.u. False: nothing of it is in sight.
bool outline(Part part, uint mode, inout Place p, out Outline o) {
    if (!(p.u.z >= part.view.w && p.u.z < 1e18))
        return false;
    bool perspective = choice.x != 0u;
    float inverse = perspective ? 1.0 / p.u.z : 1.0, f = part.view.x * inverse;
    p.ratio = perspective ? clamp(p.u.xy * inverse, -part.bounds.zw, part.bounds.zw) : vec2(0);
    p.m0 = f * (p.k[0] - p.ratio.x * p.k[2]);
    p.m1 = f * (p.k[1] - p.ratio.y * p.k[2]);
    o.at = part.view.yz + part.view.x * (p.u.xy * inverse);
    o.gain = f * f * sqrt(1.0 + dot(p.ratio, p.ratio));
    vec3 v;
    float det = filter_variance(mode, part.footprint.x, p, v);
    if (!(det > 0.0 && det < 1e36))
        return false;
    if (mode == NONE)
        outline_flat(part, v, o);
    else
        outline_ellipse(part, v, det, o);
    return o.box.x < o.box.z && o.box.y < o.box.w && o.gain > 0.0;
}

// e^x − 1 and ln(1 + x) where the difference to x counts.
float expm1(float x) {
    return abs(x) < 0.05 ? x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x * (1.0 / 24.0)))) : exp(x) - 1.0;
}

float log1p(float x) {
    return abs(x) < 0.05 ? x * (1.0 - x * (0.5 - x * (1.0 / 3.0 - x * (0.25 - 0.2 * x)))) : log(1.0 + x);
}

uint gradient_of(uint entry) {
    if (list.y == 2u)
        return widen_direction(normals[entry >> 1] >> (16u * (entry & 1u)) & 0xffffu);
    return list.y == 4u ? normals[entry] : 0u;
}

// Colour and depth of an entry's class; the gradient axis scales the opacity, not the depth.
vec4 classify(uint entry, uint word, uint gradient) {
    vec4 kind = tables[list.z + (list.x != 0u ? word >> 12 : entry)];
    uint magnitude = gradient >> 22;
    float scale = list.w != 0u ? tables[magnitude >> 2][magnitude & 3u] : 1.0;
    if (scale < 1.0)
        kind.w = scale > 0.0 ? -log1p(scale * expm1(-kind.w)) : 0.0;
    return kind;
}

vec3 shade(vec3 color, uint entry, uint gradient, vec3 u) {
    vec3 to_eye = choice.x != 0u ? -normalize(u) : vec3(0.0, 0.0, -1.0);
    if (list.y == 8u)
        return shade_flakes(color, uvec2(normals[2u * entry], normals[2u * entry + 1u]), to_eye);
    return shade_normal(color, unpack_gradient(gradient), to_eye);
}

// Places a voxel; returns its cell's volume over the mean one's.
float locate(Part part, Brick brick, uint word, out Place p) {
    uvec3 i = uvec3(word, word >> 4, word >> 8) & 15u;
    vec3 at = vec3(i), size = vec3(1);
    if (part.kind.y != 0u)
        for (int a = 0; a < 3; a++) {
            vec4 row = tables[brick.place[1 + a] + i[a]];
            at[a] = row.x;
            size[a] = row.y;
        }
    for (int r = 0; r < 3; r++) {
        p.u[r] = brick.base[r] + dot(part.step[r].xyz, at);
        p.k[r] = part.kernel[r].xyz * size;
    }
    return size.x * size.y * size.z;
}

// sp_order_layer(): the place front to back of the sheet that a voxel belongs to.
uint sheet_of(Part part, Brick brick, uint word) {
    uint level = part.kind.x, slice = brick.place.x + (word >> (4u * picture.z) & 15u);
    uint centre = (slice << level) + (level > 0u ? 1u << (level - 1u) : 0u);
    return layers[min(centre, choice.w - 1u)];
}

// Layers [first, last] of a kernel that lies from `near` to `far` of the eye.
ivec2 range_of(float near, float far) {
    return ivec2(clamp(floor((vec2(near, far) - slabs.x) / slabs.y), 0.0, 1e6));
}

// What of the kernel the planes and slabs cut (splat/extent.c).
struct Extent {
    vec3 m2;           // the third row of J·K
    vec3 inverse;      // (V̂ + h²I)⁻¹: xx, xy, yy
    float variance;    // of depth, given the pixel
};

Extent extent_of(Place p) {
    Extent e;
    vec3 v;
    float det = variance(p.m0, p.m1, p.h2, v);
    e.m2 = (p.ratio.x * p.k[0] + p.ratio.y * p.k[1] + p.k[2]) *
           (1.0 / sqrt(1.0 + dot(p.ratio, p.ratio)));
    e.inverse = vec3(v.z, -v.y, v.x) / det;
    vec3 a = cross(p.m1, e.m2), b = cross(p.m0, e.m2);
    float volume = dot(p.m0, a), h2 = p.h2;
    float all = volume * volume + h2 * (dot(a, a) + dot(b, b)) + h2 * h2 * dot(e.m2, e.m2);
    e.variance = max(all / det, 1e-12);
    return e;
}

vec2 regress(Extent e, vec2 c) {
    return vec2(e.inverse.x * c.x + e.inverse.y * c.y, e.inverse.y * c.x + e.inverse.z * c.y);
}

// A plane as records.glsl has it: η = e + k·d, and which side it bounds.
uvec4 cut_by(Place p, Extent extent, vec3 q, float e) {
    vec2 c = vec2(dot(p.m0, q), dot(p.m1, q)), k = regress(extent, c);
    float q2 = dot(q, q), variance = max(q2 - dot(c, k), 1e-4 * q2);
    float joint = dot(extent.m2, q) - dot(p.m0, extent.m2) * k.x - dot(p.m1, extent.m2) * k.y;
    float correlation = joint / sqrt(variance * extent.variance), scale = 1.0 / sqrt(variance);
    uint side = correlation > 0.7 ? CUT_BEFORE : correlation < -0.7 ? CUT_BEHIND : CUT_ALONG;
    return uvec4(floatBitsToUint(vec3(e, k) * scale), side);
}

// Writes the planes that cut the kernel behind a record. False: nothing of it is left.
bool write_cuts(Part part, Place p, Extent extent, uint at) {
    float tail = max(part.footprint.y, 4.0);
    uint end = at + picture.w;
    for (uint i = 0u; i < picture.w; i++) {
        vec4 plane = part.planes[i];
        vec3 q = p.k[0] * plane.x + p.k[1] * plane.y + p.k[2] * plane.z;
        float e = dot(plane.xyz, p.u) - plane.w, deviation = sqrt(dot(q, q));
        if (!(e > -tail * deviation))
            return false;
        if (e < tail * deviation)
            records[at++] = cut_by(p, extent, q, e);
    }
    if (at < end)
        records[at] = uvec4(0u, 0u, 0u, CUT_NONE);
    return true;
}

// Layers [first, last] of the kernel; false: none of them is of this batch, or planes leave nothing
// of it. Writes what follows the record's head.
bool find_layers(Part part, Brick brick, Place p, uint word, uint at, float value, out ivec2 range) {
    uint kind = compose.x, behind = at + 2u + (kind == COMPOSITE_SLAB ? 2u : 0u);
    float distance = min(choice.x != 0u ? length(p.u) : p.u.z, FARTHEST);
    if (kind == COMPOSITE_SHEET)
        range = ivec2(sheet_of(part, brick, word));
    if (kind == COMPOSITE_SPLAT)
        range = range_of(distance, distance);
    if (kind != COMPOSITE_SLAB && picture.w == 0u)
        return true;
    Extent extent = extent_of(p);
    if (kind == COMPOSITE_SLAB) {
        float reach = part.footprint.y * length(extent.m2);
        range = range_of(distance - reach, distance + reach);
        range.y = min(range.y, range.x + SLABS - 1);
        vec2 slope = regress(extent, vec2(dot(p.m0, extent.m2), dot(p.m1, extent.m2)));
        records[at + 2u] =
            floatBitsToUint(vec4(distance - slabs.x, slope, 1.0 / sqrt(extent.variance)));
        records[at + 3u] = uvec4(range, floatBitsToUint(value), 0u);
    }
    return picture.w == 0u || write_cuts(part, p, extent, behind);
}

// Writes the record's head, of layers [first, last] of the batch; returns its bins.
uvec2 write_splat(uint at, Outline o, Amount a, uvec2 range) {
    uvec2 rest = uvec2(packHalf2x16(a.color.rg), packHalf2x16(vec2(a.color.b, 0.0)) | range.x << 16);
    records[at] = uvec4(floatBitsToUint(o.at), floatBitsToUint(o.conic.xy));
    records[at + 1u] = uvec4(floatBitsToUint(vec2(o.conic.z, a.depth)), rest);
    uvec2 last = uvec2(tiles.x, (tiles.z - tiles.y + TILE - 1u) / TILE) - 1u;
    uvec2 first = min(uvec2(o.box.x, o.box.y - int(tiles.y)) / TILE, last);
    last = min(uvec2(o.box.z - 1, o.box.w - 1 - int(tiles.y)) / TILE, last);
    vec2 size = vec2(o.box.zw - o.box.xy);
    uint px = uint(min(size.x * size.y, o.area)), before = atomicAdd(group_fragments, px);
    atomicAdd(group_splats, 1u);
    if (before + px < before)
        atomicAdd(group_carry, 1u);
    return pack_span(first, last, range);
}

// What an entry adds at the centre of its footprint, `gain` times the depth of its class. False: nothing.
bool measure(uint entry, uint word, vec3 u, float gain, out Amount a) {
    uint gradient = gradient_of(entry);
    vec4 kind = classify(entry, word, gradient);
    bool is_post = compose.y != 0u;
    float share = float(gradient >> 22) / 1023.0, depth = is_post ? gain : kind.w * gain;
    if (!(depth > 0.0))
        return false;
    a = Amount(min(depth, DEPTH_MAX), kind.rgb, kind.x);
    if (is_post)
        a.color = unpack_gradient(gradient) * (share * share);
    else if (choice.y != 0u)
        a.color = shade(kind.rgb, entry, gradient, u);
    return true;
}

uvec2 set_up(Brick brick, uint i) {
    Part part = parts[brick.list.w & 255u];
    uint entry = brick.list.x + i, word = entries[entry], at = stride * (brick.list.z + i);
    if (compose.x == COMPOSITE_SHEET && sheet_of(part, brick, word) - batch.y >= tiles.w)
        return NOWHERE;
    Place p;
    Outline o;
    Amount a;
    ivec2 range;
    float volume = locate(part, brick, word, p);
    if (!outline(part, brick.list.w >> 8, p, o) ||
        !measure(entry, word, p.u, o.gain * part.bounds.x * volume, a) ||
        !find_layers(part, brick, p, word, at, a.value, range))
        return NOWHERE;
    range = ivec2(max(range.x - int(batch.y), 0), min(range.y - int(batch.y), int(tiles.w) - 1));
    return range.x <= range.y ? write_splat(at, o, a, uvec2(range)) : NOWHERE;
}

uint pairs_of(Span span) {
    uvec2 size = span.last - span.first + 1u;
    return size.x * size.y * (span.layers.y - span.layers.x + 1u);
}

// Whether there is room for the group's pairs. Beyond it nothing is counted any more, only how many they would be: a
// kernel may touch every tile.
bool plan() {
    uint before = atomicAdd(planned, group_pairs);
    if (before + group_pairs < before)
        atomicMax(needed, 0xffffffffu);
    return before + group_pairs >= before && before + group_pairs <= room;
}

void count_pairs(Span span) {
    for (uint r = span.first.y; r <= span.last.y; r++)
        for (uint c = span.first.x; c <= span.last.x; c++)
            for (uint l = span.layers.x; l <= span.layers.y; l++)
                atomicAdd(count[(r * tiles.x + c) * tiles.w + l], 1u);
}

void main() {
    if (gl_LocalInvocationIndex == 0u)
        group_splats = group_fragments = group_carry = group_pairs = 0u;
    barrier();
    Brick brick = bricks[batch.x + gl_WorkGroupID.x];
    uint i = gl_LocalInvocationIndex + GROUP * gl_WorkGroupID.y;
    uvec2 bits = NOWHERE;
    if (i < brick.list.y)
        spans[brick.list.z + i] = bits = set_up(brick, i);
    Span span = unpack_span(bits);
    bool is_drawn = bits != NOWHERE;
    if (is_drawn)
        atomicAdd(group_pairs, pairs_of(span));
    barrier();
    if (gl_LocalInvocationIndex == 0u)
        has_room = plan();
    barrier();
    if (is_drawn && has_room)
        count_pairs(span);
    if (gl_LocalInvocationIndex == 0u && group_splats > 0u) {
        atomicAdd(splats, group_splats);
        uint before = atomicAdd(fragments, group_fragments);
        atomicAdd(carry, group_carry + (before + group_fragments < before ? 1u : 0u));
    }
}
