// SPDX-License-Identifier: Apache-2.0
// Voxel → splat (derivation: splat/ewa.h). One work group per chunk of a brick, one thread per entry. Every entry has a
// record, drawn or not, so that nothing has to be compacted.

layout(local_size_x = GROUP) in;

layout(std430, binding = 1) readonly buffer Chunks { uvec4 chunks[]; }; // struct gl_chunk
// Low 12 bits: place in the brick, i0 | i1 << 4 | i2 << 8. Above: the key, if the list has a table by key.
layout(std430, binding = 2) readonly buffer Entries { uint entries[]; };
// Scales of the opacity by packed magnitude. Rows of rectilinear axes: distance from the brick's first voxel, local
// spacing, and the distance of that voxel from the grid's first one as a sum of two. Classes (colour, depth) by key or
// by entry.
layout(std430, binding = 3) readonly buffer Tables { vec4 tables[]; };
layout(std430, binding = 4) readonly buffer Normals { uint normals[]; };
// records.glsl
layout(std430, binding = 5) writeonly buffer Records { uvec4 records[]; };

layout(location = 1) uniform uvec2 batch; // first chunk, first layer
layout(location = 2) uniform uvec4 list;  // has keys, bytes of a normal, first class, has scales
layout(location = 3) uniform uint stride; // of the records

// enum sp_filter_mode
const uint ADAPTIVE = 0u, EWA = 1u, RECONSTRUCTION = 2u, LOWPASS = 3u, SWAN = 4u, NONE = 5u;
const float FARTHEST = 1e7; // cells: everything beyond counts as this far (draw/footprints/depth.c)
const float VARIANCE_MIN = 1e-6, DEPTH_MAX = 1e6, LOG2E = 1.44269504;

shared uint filter_mode;

// Equal for all threads.
uint part;    // of parts[]
uvec3 corner; // first voxel of the brick
uint mode;    // filter of the brick

// A kernel in camera space and on the image (struct sp_kernel_place).
struct Place {
    vec3 u;
    vec3 k[3];   // rows of K
    vec3 m0, m1; // the first two rows of J·K
    vec2 ratio;  // u0/u2 and u1/u2, clamped for the Jacobian
    float h2;    // part of the variance that is the low-pass filter
};

struct Outline {
    vec2 at;     // px
    vec3 conic;  // a, b, c; flat: its box
    float gain;  // depth of a class → τ
    float area;  // px inside the cutoff
    ivec4 box;   // x0, y0, x1, y1, half open
    bool begins; // begins in this band, not above it
};

// The contribution of a record.
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

// Factor for m that makes the smaller variance of V̂ at least h² (Swan et al. 1997).
float widening(vec3 m0, vec3 m1, float h2) {
    vec3 v;
    float det = variance(m0, m1, 0.0, v), mean = 0.5 * (v.x + v.z);
    float apart = sqrt(0.25 * (v.x - v.z) * (v.x - v.z) + v.y * v.y);
    float smaller = det / (mean + apart);
    return smaller < h2 ? sqrt(h2 / max(smaller, 1e-12 * h2)) : 1.0;
}

// Computes the variance of the footprint for the filter mode; returns its determinant.
float filter_variance(float h2, inout Place p, out vec3 v) {
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

// The same for centres in [x - reach, x + reach): a width of one pixel contains exactly one.
ivec2 cover_flat(float x, float reach, int low, int high) {
    return ivec2(ceil(clamp(x - reach - 0.5, float(low), float(high))),
                 ceil(clamp(x + reach - 0.5, float(low), float(high))));
}

// True if a splat with centre y and this reach begins in this band, not above it.
bool begins_here(float y, float reach) {
    return tiles.y == 0u || y - reach - 0.5 > float(tiles.y) - 1.0;
}

void outline_flat(vec3 u, vec3 v, inout Outline o) {
    const float FLAT_NEAR = 0.7; // SP_FLAT_NEAR of splat/outline.h
    vec2 r = max(parts[part].bounds.y * sqrt(v.xz), vec2(0.5));
    vec4 view = parts[part].view;
    o.gain /= 4.0 * r.x * r.y;
    if (choice.x != 0u)
        r = min(r, max(view.x / u.z * min(FLAT_NEAR * length(u), max(u.z - view.w, 0.0)), 0.5));
    o.area = 4.0 * r.x * r.y;
    ivec2 x = cover_flat(o.at.x, r.x, 0, int(image_info.x));
    ivec2 y = cover_flat(o.at.y, r.y, int(tiles.y), int(tiles.z));
    o.box = ivec4(x.x, y.x, x.y, y.y);
    o.begins = begins_here(o.at.y, r.y);
    o.conic = uintBitsToFloat(uvec3(o.box.x | o.box.z << 16, o.box.y | o.box.w << 16, 0u));
}

void outline_ellipse(vec3 v, float det, inout Outline o) {
    float root = sqrt(det), inverse = 0.5 * LOG2E / det;
    vec2 r = parts[part].footprint.y * sqrt(v.xz);
    o.conic = inverse * vec3(v.z, -2.0 * v.y, v.x);
    o.area = 3.14159265 * parts[part].footprint.y * parts[part].footprint.y * root;
    o.gain *= parts[part].footprint.w / root;
    ivec2 x = cover(o.at.x, r.x, 0, int(image_info.x));
    ivec2 y = cover(o.at.y, r.y, int(tiles.y), int(tiles.z));
    o.box = ivec4(x.x, y.x, x.y, y.y);
    o.begins = begins_here(o.at.y, r.y);
}

// Computes the geometry of the kernel at p.u. False if it is not visible.
bool outline(inout Place p, out Outline o) {
    if (!(p.u.z >= parts[part].view.w && p.u.z < 1e18))
        return false;
    bool perspective = choice.x != 0u;
    float inverse = perspective ? 1.0 / p.u.z : 1.0, f = parts[part].view.x * inverse;
    p.ratio = perspective ? clamp(p.u.xy * inverse, -parts[part].bounds.zw, parts[part].bounds.zw) : vec2(0);
    p.m0 = f * (p.k[0] - p.ratio.x * p.k[2]);
    p.m1 = f * (p.k[1] - p.ratio.y * p.k[2]);
    o.at = parts[part].view.yz + parts[part].view.x * (p.u.xy * inverse);
    o.gain = f * f * sqrt(1.0 + dot(p.ratio, p.ratio));
    vec3 v;
    float det = filter_variance(parts[part].footprint.x, p, v);
    if (!(det > 0.0 && det < 1e36))
        return false;
    if (mode == NONE)
        outline_flat(p.u, v, o);
    else
        outline_ellipse(v, det, o);
    return o.box.x < o.box.z && o.box.y < o.box.w && o.gain > 0.0;
}

uint gradient_of(uint entry) {
    if (list.y == 2u)
        return widen_direction(normals[entry >> 1] >> (16u * (entry & 1u)) & 0xffffu);
    return list.y == 4u ? normals[entry] : 0u;
}

// Colour and depth of an entry's class. The gradient axis scales the opacity, not the depth.
vec4 classify(uint entry, uint word, uint gradient) {
    vec4 kind = tables[list.z + (list.x != 0u ? word >> 12 : entry)];
    uint magnitude = gradient >> 22;
    if (list.w != 0u)
        kind.w = scale_depth(kind.w, tables[magnitude >> 2][magnitude & 3u]);
    return kind;
}

vec3 shade(vec3 color, uint entry, uint gradient, vec3 u) {
    vec3 to_eye = choice.x != 0u ? -normalize(u) : vec3(0.0, 0.0, -1.0);
    if (list.y == 8u)
        return shade_microflakes(color, uvec2(normals[2u * entry], normals[2u * entry + 1u]), to_eye);
    return shade_normal(color, unpack_gradient(gradient), to_eye);
}

// Row of the tables for a voxel along a rectilinear axis.
vec4 row_of(uint axis, uint i) {
    return tables[parts[part].rows[axis] + i];
}

// Distance of a voxel from the origin along an axis, in spacings, and its cell's spacing over the mean.
vec2 place_of(uint axis, uint i) {
    if (parts[part].kind.y == 0u)
        return vec2(float(int(i - parts[part].origin[axis])), 1.0);
    vec4 row = row_of(axis, i), origin = row_of(axis, parts[part].origin[axis]);
    precise float place = (row.z - origin.z) + (row.w - origin.w) + row.x;
    return vec2(place, row.y);
}

// Places a voxel; returns its cell's volume over the mean volume.
float locate(uint word, out Place p) {
    uvec3 i = corner + (uvec3(word, word >> 4, word >> 8) & 15u);
    vec2 x = place_of(0u, i.x), y = place_of(1u, i.y), z = place_of(2u, i.z);
    for (int r = 0; r < 3; r++) {
        vec4 step = parts[part].step[r];
        p.u[r] = step.w + dot(step.xyz, vec3(x.x, y.x, z.x));
        p.k[r] = parts[part].kernel[r].xyz * vec3(x.y, y.y, z.y);
    }
    return x.y * y.y * z.y;
}

// Chooses the brick's filter (adaptive: splat/adaptive.h, Chen et al. 2004, eq. 7).
uint choose_mode() {
    vec2 depth = vec2(parts[part].step[2].w), stretch = vec2(1.0);
    for (uint a = 0u; a < 3u; a++) {
        uint last = min(corner[a] + 15u, parts[part].dims[a] - 1u);
        vec2 ends = parts[part].step[2][a] * vec2(place_of(a, corner[a]).x, place_of(a, last).x);
        depth += vec2(min(ends.x, ends.y), max(ends.x, ends.y));
        if (parts[part].kind.y == 0u)
            continue;
        vec2 own = vec2(row_of(a, corner[a]).y);
        for (uint i = corner[a] + 1u; i <= last; i++)
            own = vec2(min(own.x, row_of(a, i).y), max(own.y, row_of(a, i).y));
        stretch = a == 0u ? own : vec2(min(stretch.x, own.x), max(stretch.y, own.y));
    }
    if (choice.x == 0u)
        depth = vec2(1.0);
    float radius = parts[part].kernel[2].w; // of the low-pass filter
    if (parts[part].kernel[0].w * stretch.x > radius * max(depth.y, 0.0))
        return RECONSTRUCTION;
    return parts[part].kernel[1].w * stretch.y < radius * depth.x ? LOWPASS : EWA;
}

// sp_slices_layer(): the layer, front to back, of the sheet that a voxel belongs to.
uint sheet_of(uint word) {
    uint level = parts[part].kind.x, slice = corner[image_info.z] + (word >> (4u * image_info.z) & 15u);
    uint centre = (slice << level) + (level > 0u ? 1u << (level - 1u) : 0u);
    return layers[min(centre, choice.w - 1u)];
}

// Layers [first, last] of a kernel between the distances `near` and `far` from the eye.
ivec2 range_of(float near, float far) {
    return ivec2(clamp(floor((vec2(near, far) - slabs.x) / slabs.y), 0.0, 1e6));
}

// The kernel as planes and slabs cut it (splat/extent.c).
struct Extent {
    vec3 m2;           // the third row of J·K
    vec3 inverse;      // (V̂ + h²I)⁻¹: xx, xy, yy
    float variance;    // conditional variance of depth at a pixel
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

// A plane as in records.glsl: η = e + k·d, and the side that it bounds.
uvec4 cut_by(Place p, Extent extent, vec3 q, float e) {
    vec2 c = vec2(dot(p.m0, q), dot(p.m1, q)), k = regress(extent, c);
    float q2 = dot(q, q), variance = max(q2 - dot(c, k), 1e-4 * q2);
    float joint = dot(extent.m2, q) - dot(p.m0, extent.m2) * k.x - dot(p.m1, extent.m2) * k.y;
    float correlation = joint / sqrt(variance * extent.variance), scale = 1.0 / sqrt(variance);
    uint side = correlation > 0.7 ? CUT_BEFORE : correlation < -0.7 ? CUT_BEHIND : CUT_ALONG;
    return uvec4(floatBitsToUint(vec3(e, k) * scale), side);
}

// Writes the planes that cut the kernel after the record. False: nothing of the kernel is left.
bool write_cuts(Place p, Extent extent, uint at) {
    float tail = max(parts[part].footprint.y, 4.0);
    uint end = at + image_info.w;
    for (uint i = 0u; i < image_info.w; i++) {
        vec4 plane = planes[CLIP_PLANES * part + i];
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

// Finds the layers [first, last] of the kernel and writes what follows the record's head. False: none of them is in
// this batch, or planes leave nothing of the kernel.
bool compute_layers(Place p, uint word, uint at, float value, out ivec2 range) {
    uint kind = compose.x, behind = at + 2u + (compose.z != 0u ? 2u : 0u);
    float distance = min(choice.x != 0u ? length(p.u) : p.u.z, FARTHEST);
    if (kind == COMPOSITE_SHEET)
        range = ivec2(sheet_of(word));
    if (kind == COMPOSITE_SPLAT)
        range = range_of(distance, distance);
    if (compose.z == 0u && image_info.w == 0u)
        return true;
    Extent extent = extent_of(p);
    if (kind == COMPOSITE_SLAB) {
        float reach = parts[part].footprint.y * length(extent.m2);
        range = range_of(distance - reach, distance + reach);
        range.y = min(range.y, range.x + SLABS - 1);
    }
    if (compose.z != 0u) {
        vec2 slope = regress(extent, vec2(dot(p.m0, extent.m2), dot(p.m1, extent.m2)));
        records[at + 2u] =
            floatBitsToUint(vec4(distance - slabs.x, slope, 1.0 / sqrt(extent.variance)));
        records[at + 3u] = uvec4(range, floatBitsToUint(value), 0u);
    }
    return image_info.w == 0u || write_cuts(p, extent, behind);
}

// Writes the record's head for layers [first, last] of the batch; returns its bins.
uvec2 write_splat(uint at, Outline o, Amount a, uvec2 range) {
    uvec2 rest = uvec2(packHalf2x16(a.color.rg), packHalf2x16(vec2(a.color.b, 0.0)) | range.x << 16);
    records[at] = uvec4(floatBitsToUint(o.at), floatBitsToUint(o.conic.xy));
    records[at + 1u] = uvec4(floatBitsToUint(vec2(o.conic.z, a.depth)), rest);
    return bound_tiles(o.box.xy, o.box.zw, range);
}

// Computes the amount that an entry adds at the centre of its footprint: `gain` times the depth of its class. False: it adds
// nothing.
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

uvec2 set_up(uint entry, uint at) {
    uint word = entries[entry];
    if (compose.x == COMPOSITE_SHEET && sheet_of(word) - batch.y >= tiles.w)
        return NOWHERE;
    Place p;
    Outline o;
    Amount a;
    ivec2 range;
    float volume = locate(word, p);
    if (!outline(p, o) ||
        !measure(entry, word, p.u, o.gain * parts[part].bounds.x * volume, a) ||
        !compute_layers(p, word, at, a.value, range))
        return NOWHERE;
    bool is_first = batch.y == 0u || range.x >= int(batch.y);
    range = ivec2(max(range.x - int(batch.y), 0), min(range.y - int(batch.y), int(tiles.w) - 1));
    if (range.x > range.y)
        return NOWHERE;
    vec2 size = vec2(o.box.zw - o.box.xy);
    if (is_first)
        count_splat(uint(min(size.x * size.y, o.area)), o.begins);
    return write_splat(at, o, a, uvec2(range));
}

void main() {
    uint thread = gl_LocalInvocationIndex;
    uvec4 chunk = chunks[batch.x + gl_WorkGroupID.x];
    part = chunk.z >> 16;
    uint row = chunk.y / parts[part].kind.z;
    corner = 16u * uvec3(chunk.y % parts[part].kind.z, row % parts[part].kind.w, row / parts[part].kind.w);
    begin_counts();
    if (thread == 0u)
        filter_mode = parts[part].rows.w == ADAPTIVE ? choose_mode() : parts[part].rows.w;
    barrier();
    mode = filter_mode;
    uvec2 bits = NOWHERE;
    if (thread < (chunk.z & 0xffffu))
        spans[chunk.w + thread] = bits = bound(set_up(chunk.x + thread, stride * (chunk.w + thread)));
    end_counts(bits);
}
