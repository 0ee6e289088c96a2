// SPDX-License-Identifier: Apache-2.0
// Voxel → splat (splat/ewa.h has the derivation): a work group a brick, a thread every 256th of its entries. Each
// entry has a record, whether it is drawn or not, so that nothing has to be compacted.

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
// x, y, a, b, c, depth, and packed: colour and layer.
layout(std430, binding = 5) writeonly buffer Records { uvec4 records[]; };
// Tiles that a record touches: columns and rows [first, last], and its layer; first > last: none.
layout(std430, binding = 6) writeonly buffer Spans { uvec2 spans[]; };

layout(location = 1) uniform uvec2 batch; // first brick, first layer
layout(location = 2) uniform uvec4 list;  // has keys, bytes of a normal, first class, has scales

const uint LOWPASS = 3u, RECONSTRUCTION = 2u, SWAN = 4u, NONE = 5u; // enum sp_filter_mode
const float VARIANCE_MIN = 1e-6, DEPTH_MAX = 1e6, LOG2E = 1.44269504;
const uvec2 NOWHERE = uvec2(1u, 0u);

shared uint group_splats, group_fragments, group_carry;

struct Outline {
    vec2 at;     // px
    vec3 conic;  // a, b, c; flat: its box
    float gain;  // depth of a class → τ
    float area;  // px inside the cutoff
    ivec4 box;   // x0, y0, x1, y1, half open
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

float filter_variance(uint mode, float h2, vec3 m0, vec3 m1, out vec3 v) {
    if (mode == LOWPASS) {
        v = vec3(h2, 0.0, h2);
        return h2 * h2;
    }
    if (mode == SWAN) {
        float wide = widening(m0, m1, h2);
        m0 *= wide;
        m1 *= wide;
    }
    bool plain = mode == SWAN || mode == RECONSTRUCTION || mode == NONE;
    return variance(m0, m1, plain ? VARIANCE_MIN : h2, v);
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

// Geometry of a kernel with rows k at u. False: nothing of it is in sight.
bool outline(Part part, uint mode, vec3 u, vec3 k[3], out Outline o) {
    if (!(u.z >= part.view.w && u.z < 1e18))
        return false;
    bool perspective = choice.x != 0u;
    float inverse = perspective ? 1.0 / u.z : 1.0, f = part.view.x * inverse;
    vec2 ratio = perspective ? clamp(u.xy * inverse, -part.bounds.zw, part.bounds.zw) : vec2(0);
    vec3 m0 = f * (k[0] - ratio.x * k[2]), m1 = f * (k[1] - ratio.y * k[2]), v;
    o.at = part.view.yz + part.view.x * (u.xy * inverse);
    o.gain = f * f * sqrt(1.0 + dot(ratio, ratio));
    float det = filter_variance(mode, part.footprint.x, m0, m1, v);
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
float locate(Part part, Brick brick, uint word, out vec3 u, out vec3 k[3]) {
    uvec3 i = uvec3(word, word >> 4, word >> 8) & 15u;
    vec3 at = vec3(i), size = vec3(1);
    if (part.kind.y != 0u)
        for (int a = 0; a < 3; a++) {
            vec4 row = tables[brick.place[1 + a] + i[a]];
            at[a] = row.x;
            size[a] = row.y;
        }
    for (int r = 0; r < 3; r++) {
        u[r] = brick.base[r] + dot(part.step[r].xyz, at);
        k[r] = part.kernel[r].xyz * size;
    }
    return size.x * size.y * size.z;
}

// sp_order_layer(), counted from the batch's first; beyond its layers: not of this batch.
uint layer_of(Part part, Brick brick, uint word) {
    uint level = part.kind.x, slice = brick.place.x + (word >> (4u * picture.z) & 15u);
    uint centre = (slice << level) + (level > 0u ? 1u << (level - 1u) : 0u);
    return layers[min(centre, choice.w - 1u)] - batch.y;
}

// Writes the record and counts its pairs; returns the tiles that it touches.
uvec2 write_splat(uint record, Outline o, float depth, vec3 color, uint layer) {
    uvec2 rest = uvec2(packHalf2x16(color.rg), packHalf2x16(vec2(color.b, 0.0)) | layer << 16);
    records[2u * record] = uvec4(floatBitsToUint(o.at), floatBitsToUint(o.conic.xy));
    records[2u * record + 1u] = uvec4(floatBitsToUint(vec2(o.conic.z, depth)), rest);
    uvec2 last = uvec2(tiles.x, (tiles.z - tiles.y + TILE - 1u) / TILE) - 1u;
    uvec2 first = min(uvec2(o.box.x, o.box.y - int(tiles.y)) / TILE, last);
    last = min(uvec2(o.box.z - 1, o.box.w - 1 - int(tiles.y)) / TILE, last);
    for (uint r = first.y; r <= last.y; r++)
        for (uint c = first.x; c <= last.x; c++)
            atomicAdd(count[(r * tiles.x + c) * tiles.w + layer], 1u);
    vec2 size = vec2(o.box.zw - o.box.xy);
    uint px = uint(min(size.x * size.y, o.area)), before = atomicAdd(group_fragments, px);
    atomicAdd(group_splats, 1u);
    if (before + px < before)
        atomicAdd(group_carry, 1u);
    return uvec2(first.x | first.y << 10 | (layer & 0xfffu) << 20,
                 last.x | last.y << 10 | layer >> 12 << 20);
}

uvec2 set_up(Brick brick, uint i) {
    Part part = parts[brick.list.w & 255u];
    uint entry = brick.list.x + i, word = entries[entry], layer = layer_of(part, brick, word);
    if (layer >= tiles.w)
        return NOWHERE;
    vec3 u, k[3];
    Outline o;
    float volume = locate(part, brick, word, u, k);
    if (!outline(part, brick.list.w >> 8, u, k, o))
        return NOWHERE;
    uint gradient = gradient_of(entry);
    vec4 kind = classify(entry, word, gradient);
    float depth = kind.w * (o.gain * part.bounds.x * volume);
    if (!(depth > 0.0))
        return NOWHERE;
    vec3 color = choice.y != 0u ? shade(kind.rgb, entry, gradient, u) : kind.rgb;
    return write_splat(brick.list.z + i, o, min(depth, DEPTH_MAX), color, layer);
}

void main() {
    if (gl_LocalInvocationIndex == 0u)
        group_splats = group_fragments = group_carry = 0u;
    barrier();
    Brick brick = bricks[batch.x + gl_WorkGroupID.x];
    for (uint i = gl_LocalInvocationIndex; i < brick.list.y; i += GROUP)
        spans[brick.list.z + i] = set_up(brick, i);
    barrier();
    if (gl_LocalInvocationIndex == 0u && group_splats > 0u) {
        atomicAdd(splats, group_splats);
        uint before = atomicAdd(fragments, group_fragments);
        atomicAdd(carry, group_carry + (before + group_fragments < before ? 1u : 0u));
    }
}
