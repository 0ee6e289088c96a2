// SPDX-License-Identifier: Apache-2.0
// Sheets of interpolated values (draw/resample/README.md), front to back: a work group draws a block of 8 × 8 px in a range of
// intervals between sheets. For each sheet that it needs, the group refines the samples that its pixels see in shared
// memory: raw ─► between rows ─► refined. Blocks that see too many are drawn in parts. LAYERS: intervals are cut at the
// fragments of other layers in them.

layout(local_size_x = TILE, local_size_y = TILE) in;
// By pixel of the band: transmittance and premultiplied colour; then, again by pixel, the gradient of the last surface and
// the number of fragments that were composited plus half of face_opacity; then the sum of passes. DEPTH: then moments of the
// depth (frame/depth.h), and the sum of the passes' moments.
layout(std430, binding = 4) buffer Image { vec4 image[]; };
#if PROJECTION
layout(std430, binding = 5) readonly buffer Colors { vec4 colors[]; }; // and alpha
#else
layout(std430, binding = 5) readonly buffer Integral { vec4 integral[]; };
#endif
layout(std430, binding = 7) coherent buffer Counts {
    uint splats;           // refined samples
    uint fragments, carry; // pixels of sheets: low and high word
};

layout(location = 0) uniform uvec4 band;  // width of the image, first row and last + 1 of the band, first row of the dispatch [px]
layout(location = 1) uniform ivec2 range; // intervals: first, last + 1
layout(location = 2) uniform ivec3 part;  // sheets per slice of the pass; 1 = it ends; 1 = its pixels are added to the sum
layout(location = 3) uniform float axis_share; // share of the image that slices along the pass's axis have

layout(location = 4) uniform float depth_origin; // DEPTH: depths count from here

const uint PIXELS = TILE * TILE;
// RAW: samples in shared memory, which surround the refined ones. REFINED: words of the refined samples. Less shared memory lets
// a GPU run more groups at the same time.
const int RAW = 320, REFINED = 340;
const int BINS = 4096, ACTIVE = INTERVALS / 32 + 1, SLABS = INTERVALS / REGION + 2;
const uint REGIONS_MAX = 4096u; // a block that sees more regions of a slab counts as seeing something
const float TRANSMITTANCE_MIN = 1.0 / 512.0, LOG2E = 1.44269504, TINY = 1e-20;
const float FACE = 4.0 * (CODE_MAX - CODE_MIN); // RESAMPLE_FACE of draw/resample/resample.h
const float NONE_BELOW = 512.0; // lower codes stand for samples that are not finite
const int COLORS = 1024;
const float TAP0 = 150.0 / 256.0, TAP1 = -25.0 / 256.0, TAP2 = 3.0 / 256.0;

shared vec4 rays[PIXELS];      // u, v, du, dv
#if PROJECTION
shared float raw[6 * RAW];     // of six slices, (width + 5) × (height + 5) each
shared vec2 across[RAW];       // width × (height + 5): a sample, and the value half way to the next one
#else
shared float raw[RAW];         // (width + 5) × (height + 5)
shared float between_rows[RAW]; // (width + 5) × height
#endif
shared uint refined[REFINED];   // width × 2·height: two 16-bit codes per word
shared uint seen[SLABS];       // by slab of regions: the intervals in which the block may see something
shared uint intervals[ACTIVE];    // the same by interval between sheets, from the first one of the dispatch on
shared int span[2];            // s between which some ray is inside, as integers that rise with it
shared int live_at;            // the newest sheet at which some pixel was not opaque

uint thread;
// Transmittance and premultiplied colour. Of a projection, until its pass ends: 1 while the pixel may change, the number so
// far, and the length of the ray that it comes from if samples are left out.
vec4 pixel;
vec3 normal; // gradient of the surface that was met last
vec3 face;   // unit normal of the cut by which the ray enters; 0 = no cut
float face_opacity; // of a slice of the material there
vec2 at;    // where the pixel's ray crosses the image
vec4 ray;   // u, v, du, dv
bool is_live; // some pixel of the block was not opaque at the last sheet
float begin, end, ray_length; // s inside all half spaces; length per slice
float pass_share;             // share of the pixel that belongs to the pass, of the shares for each axis of slices

// The square of the block at `corner` px.
Square find_square(uvec2 corner) {
    uint i = corner.y / SQUARE * size.x + corner.x / SQUARE;
    for (uint half_side = SQUARE / 2u; squares[i].kind.x != 0; half_side /= 2u) {
        uvec2 part = corner / half_side & 1u;
        i = uint(squares[i].kind.x) + part.x + 2u * part.y;
    }
    return squares[i];
}

void cut_ray() {
    begin = -1e9;
    end = 1e9;
    face = vec3(0);
    for (int i = 0; i < base.z; i++) {
        vec3 n = turn(halves[i].xyz);
        float rise = dot(n.xy, ray.zw) + (is_backwards ? -n.z : n.z);
        float gap = gaps[i][slices] - dot(n.xy, ray.xy), s = gap / rise;
        if (rise > 0.0) {
            face = begin < s ? faces[i].xyz : face;
            begin = max(begin, s);
        } else if (rise < 0.0)
            end = min(end, s);
        else if (gap > 0.0)
            end = -1e9;
    }
}

void open_ray(Square square) {
    bool is_perspective = choice.x != 0u;
    vec2 x = at - square.centre.xy;
    float fall = max(1.0 + dot(x, square.fall.xy), 0.05);
    vec2 moved = (x.x * square.turn.xy + x.y * square.turn.zw) / fall;
    ray = square.at + vec4(moved * square.fall.z, 0.0, 0.0);
    if (is_perspective)
        ray.zw += is_backwards ? -moved : moved;
    cut_ray();
    vec3 d = turn(metric[0].xyz), mixed = turn(metric[1].xyz); // mixed: vw, uw, uv
    float forward = is_backwards ? -1.0 : 1.0;
    ray_length = sqrt(d.x * ray.z * ray.z + d.y * ray.w * ray.w + d.z +
                      2.0 * (mixed.x * ray.w * forward + mixed.y * ray.z * forward + mixed.z * ray.z * ray.w));
}

// The share of the pixel that a pass with part.x sheets per slice has (draw/resample/rays.h).
float compute_share(int sheets) {
    float slant = ray_length / sqrt(turn(metric[0].xyz).z), speed = max(sqrt(1.0 + dot(ray.zw, ray.zw)), slant);
    float halves = clamp((speed - steep.x) / (steep.y - steep.x), 0.0, 1.0);
    if (sheets != 3)
        return (sheets & part.x) != 0 ? 1.0 : 0.0;
    return part.x == 2 ? halves : 1.0 - halves;
}

// The coordinates on a sheet that a square of the block's pixels covers: [refined samples]. Rays that moved are inside of
// their pixels; so a pixel more on each side holds what lies between the rays at the corners.
void compute_extent(uvec2 corner, uint side, float s, out vec2 low, out vec2 high) {
    low = vec2(1e30);
    high = vec2(-1e30);
    for (uint i = 0u; i < 4u; i++) {
        uvec2 px = corner + uvec2(i & 1u, i >> 1u) * (side - 1u);
        vec4 own = rays[px.y * TILE + px.x];
        vec2 x = own.xy + s * own.zw;
        low = min(low, x);
        high = max(high, x);
    }
    for (uint i = is_crossed && side > 1u ? 1u : 0u; i > 0u; i--) { // once: software GL computes both sides of a condition
        const float MARGIN = 1.25 / float(TILE - 1u); // the rays at the corners moved as well
        vec4 right = rays[TILE - 1u] - rays[0], down = rays[TILE * (TILE - 1u)] - rays[0];
        vec2 beyond = MARGIN * (abs(right.xy + s * right.zw) + abs(down.xy + s * down.zw));
        low -= beyond;
        high += beyond;
    }
    low = index_of(low);
    high = index_of(high);
}

int interval_at(int n) {
    int i = int(floor(0.5 * (slice_of(n) + slice_of(n + 1))));
    return clamp(i, 0, int(regions[slices]) * REGION - 1);
}

// The intervals of a slab of regions in which the block may see something, as bits.
uint mark_seen(uint slab) {
    const uint ALL = (1u << REGION) - 1u;
    float near = slab == 0u ? -1.0 : float(slab * uint(REGION)), far = float((slab + 1u) * uint(REGION));
    if (slab + 1u == regions[slices])
        far = float(dims.z);
    vec2 s = vec2(s_of(is_backwards ? far : near), s_of(is_backwards ? near : far));
    vec2 own = vec2(from_ordinal(span[0]), from_ordinal(span[1]));
    if (s.y <= own.x || s.x >= own.y)
        return 0u;
    vec2 low[2], high[2];
    compute_extent(uvec2(0), TILE, max(s.x, own.x), low[0], high[0]);
    compute_extent(uvec2(0), TILE, min(s.y, own.y), low[1], high[1]);
    uvec2 most = uvec2(regions[axis_of(0)], regions[axis_of(1)]) - 1u;
    uvec2 first = min(uvec2(min(low[0], low[1])) / uint(REGION), most);
    uvec2 end = min(uvec2(max(high[0], high[1])) / uint(REGION), most);
    uvec3 by_axis = uvec3(1u, regions.x, regions.x * regions.y);
    uint bits = 0u, count = end.x - first.x + 1u, i = first.x, j = first.y;
    if (count * (end.y - first.y + 1u) > REGIONS_MAX)
        return ALL;
    while (j <= end.y) {
        uint region = i * by_axis[axis_of(0)] + j * by_axis[axis_of(1)] + slab * by_axis[slices];
        bits |= visible[region / 4u] >> (8u * (region % 4u)) & ALL;
        j += i == end.x ? 1u : 0u;
        i = i == end.x ? first.x : i + 1u;
    }
    return bits != 0u && uint(slices) != regions.w ? ALL : bits;
}

// Fills `intervals`. Every thread must call it.
void mark_active() {
    int stop = min(range.y, (dims.z + 2) * per_slice), first = max(range.x, 1);
    int first_slab = min(interval_at(first), interval_at(stop - 1)) / REGION;
    int slabs = max(interval_at(first), interval_at(stop - 1)) / REGION - first_slab + 1;
    if (int(thread) < ACTIVE)
        intervals[thread] = 0u;
    for (int slab = int(thread); slab < slabs; slab += int(PIXELS))
        seen[slab] = mark_seen(uint(first_slab + slab));
    barrier();
    for (int n = first + int(thread); n < stop; n += int(PIXELS)) {
        int i = interval_at(n), bit = n - range.x;
        if ((seen[i / REGION - first_slab] >> (i % REGION) & 1u) != 0u)
            atomicOr(intervals[bit / 32], 1u << (bit % 32));
    }
    barrier();
}

// The first active interval from n on; range.y = there is none.
int find_next(int n) {
    for (int bit = n - range.x, word; bit < INTERVALS; bit = 32 * word + 32) {
        word = bit / 32;
        uint left = intervals[word] >> (bit % 32);
        if (left != 0u)
            return range.x + bit + findLSB(left);
    }
    return range.y;
}

// The value half way between the third and the fourth of six neighbours.
float between(float a, float b, float c, float d, float e, float f) {
    float value = (c + d) * TAP0 + (b + e) * TAP1 + (a + f) * TAP2;
#if PROJECTION
    if (choices.z != 0 && min(min(min(a, b), min(c, d)), min(e, f)) < NONE_BELOW)
        return min(c, d) < NONE_BELOW ? 0.0 : 0.5 * (c + d);
    if (choices.z != 0)
        value = max(value, CODE_MIN);
    if (choices.x != 0)
        value = clamp(value, min(c, d), max(c, d));
#endif
    return value;
}

// The code of a slice at sample p.
float read(ivec2 p, int z) {
    p = clamp(p, ivec2(0), last.xy);
    return code_of(uint(p.x) * strides.x + uint(p.y) * strides.y + uint(clamp(z, 0, last.z)) * strides.z);
}

uint to_word(float even, float odd) {
    vec2 code = min(max(vec2(even, odd), code_scale.w), CODE_MAX) + 0.5;
    return uint(code.x) | uint(code.y) << 16;
}

#if PROJECTION
vec2 between(vec2 x[6]) {
    return vec2(between(x[0].x, x[1].x, x[2].x, x[3].x, x[4].x, x[5].x),
                between(x[0].y, x[1].y, x[2].y, x[3].y, x[4].y, x[5].y));
}

// The third of six neighbours from `raw` on, and the value half way to the fourth one.
vec2 read_across(int at) {
    return vec2(raw[at + 2], between(raw[at], raw[at + 1], raw[at + 2], raw[at + 3], raw[at + 4], raw[at + 5]));
}

// Refines the samples [first, first + count) of the slice of sheet n. Every thread must call it. Values are kept between their
// neighbours, so the result depends on the order of the axes. The CPU backend has the same order: across, between slices, down.
void refine(ivec2 first, ivec2 count, int n) {
    int width = count.x + 5, size = width * (count.y + 5), i = int(thread) % width, j = int(thread) / width;
    ivec2 skip = ivec2(int(PIXELS) % width, int(PIXELS) / width);
    int whole = int(floor(slice_of(n))), slices_read = slice_of(n) > float(whole) ? 6 : 1;
    int slice = slices_read == 6 ? whole - 2 : whole;
    for (int k = int(thread); k < size; k += int(PIXELS)) {
        for (int z = 0; z < slices_read; z++)
            raw[z * RAW + k] = read(first - 2 + ivec2(i, j), slice + z);
        i += skip.x;
        j += skip.y + (i >= width ? 1 : 0);
        i -= i >= width ? width : 0;
    }
    barrier();
    size = count.x * (count.y + 5);
    i = int(thread) % count.x;
    j = int(thread) / count.x;
    skip = ivec2(int(PIXELS) % count.x, int(PIXELS) / count.x);
    for (int k = int(thread); k < size; k += int(PIXELS)) {
        vec2 own[6];
        for (int z = 0; z < slices_read; z++)
            own[z] = read_across(z * RAW + j * width + i);
        across[k] = own[0];
        for (int z = 1; z < slices_read; z += 5) // once, if there are slices: software GL computes both sides of a condition
            across[k] = between(own);
        i += skip.x;
        j += skip.y + (i >= count.x ? 1 : 0);
        i -= i >= count.x ? count.x : 0;
    }
    barrier();
    size = count.x * count.y;
    i = int(thread) % count.x;
    for (int k = int(thread); k < size; k += int(PIXELS)) {
        vec2 own[6];
        for (int t = 0; t < 6; t++)
            own[t] = across[k + t * count.x];
        int word = 2 * k - i; // in row 2·j
        refined[word] = to_word(own[2].x, own[2].y);
        vec2 below = between(own);
        refined[word + count.x] = to_word(below.x, below.y);
        i += skip.x;
        i -= i >= count.x ? count.x : 0;
    }
    is_live = live_at == n; // before the barrier: later threads may be at the next sheet
    barrier();
}
#else
// The code half way between slices z and z + 1.
float read_between(ivec2 p, int z) {
    float own[6];
    for (int k = 0; k < 6; k++)
        own[k] = read(p, z + k - 2);
    return between(own[0], own[1], own[2], own[3], own[4], own[5]);
}

// Refines the samples [first, first + count) of the slice of sheet n. Every thread must call it.
void refine(ivec2 first, ivec2 count, int n) {
    int width = count.x + 5, size = width * (count.y + 5), i = int(thread) % width, j = int(thread) / width;
    ivec2 skip = ivec2(int(PIXELS) % width, int(PIXELS) / width);
    float slice = slice_of(n);
    int whole = int(floor(slice));
    bool is_between = slice > float(whole);
    for (int k = int(thread); k < size; k += int(PIXELS)) {
        ivec2 p = first - 2 + ivec2(i, j);
        raw[k] = is_between ? read_between(p, whole) : read(p, whole);
        i += skip.x;
        j += skip.y + (i >= width ? 1 : 0);
        i -= i >= width ? width : 0;
    }
    barrier();
    size = width * count.y;
    for (int k = int(thread); k < size; k += int(PIXELS))
        between_rows[k] = between(raw[k], raw[k + width], raw[k + 2 * width], raw[k + 3 * width], raw[k + 4 * width],
                                  raw[k + 5 * width]);
    barrier();
    size = 2 * count.x * count.y;
    i = int(thread) % count.x;
    j = int(thread) / count.x;
    skip = ivec2(int(PIXELS) % count.x, int(PIXELS) / count.x);
    for (int k = int(thread); k < size; k += int(PIXELS)) {
        float own[6];
        int row = (j >> 1) * width + i;
        for (int t = 0; t < 6; t++)
            own[t] = (j & 1) != 0 ? between_rows[row + t] : raw[row + 2 * width + t];
        refined[k] = to_word(own[2], between(own[0], own[1], own[2], own[3], own[4], own[5]));
        i += skip.x;
        j += skip.y + (i >= count.x ? 1 : 0);
        i -= i >= count.x ? count.x : 0;
    }
    is_live = live_at == n; // before the barrier: later threads may be at the next sheet
    barrier();
}
#endif

float code_at(ivec2 p, int width) {
    uint word = refined[p.y * width + (p.x >> 1)];
    return float(word >> (16 * (p.x & 1)) & 0xffffu);
}

// The value on the sheet at refined sample p + part, and its differences along u and v over one sample. A projection: the
// value, and the range of the refined samples around.
vec3 sample_at(ivec2 p, vec2 part, int width) {
    float a = code_at(p, width), b = code_at(p + ivec2(1, 0), width);
    float c = code_at(p + ivec2(0, 1), width), d = code_at(p + 1, width);
    float value = mix(mix(a, b, part.x), mix(c, d, part.x), part.y);
#if GRADIENT
    float left = mix(mix(code_at(p + ivec2(-1, 0), width), a, part.x),
                     mix(code_at(p + ivec2(-1, 1), width), c, part.x), part.y);
    float right = mix(mix(b, code_at(p + ivec2(2, 0), width), part.x),
                      mix(d, code_at(p + ivec2(2, 1), width), part.x), part.y);
    float above = mix(mix(code_at(p + ivec2(0, -1), width), code_at(p + ivec2(1, -1), width), part.x),
                      mix(a, b, part.x), part.y);
    float below = mix(mix(c, d, part.x),
                      mix(code_at(p + ivec2(0, 2), width), code_at(p + ivec2(1, 2), width), part.x), part.y);
    return vec3(value, right - left, below - above);
#else
#if PROJECTION
    float least = min(min(a, b), min(c, d)), most = max(max(a, b), max(c, d));
    if (choices.z != 0 && least < NONE_BELOW)
        value = 0.0;
    return vec3(value, least, most);
#endif
    return vec3(value, 0.0, 0.0);
#endif
}

// Reads sheet n at the group's pixels, unless all are opaque. Every thread must call it.
void read_sheet(int n, inout vec3 value, inout uint refined_count) {
    const int margin = GRADIENT;
    float s = s_of(slice_of(n));
    vec2 x = index_of(ray.xy + s * ray.zw);
    if (pixel.x > TRANSMITTANCE_MIN)
        live_at = n;
    // Parts of the block in Morton order: p is the first pixel of the next part.
    uint own = 0u;
    for (uint b = 0u; b < 3u; b++)
        own |= (thread >> b & 1u) << (2u * b) | (thread >> (b + 3u) & 1u) << (2u * b + 1u);
    for (uint p = 0u, side; p < PIXELS; p += side * side) {
        uvec2 corner = uvec2((p & 1u) | (p >> 1 & 2u) | (p >> 2 & 4u), (p >> 1 & 1u) | (p >> 2 & 2u) | (p >> 3 & 4u));
        vec2 low, high;
        ivec2 first, count;
        for (side = TILE;; side /= 2u) {
            if ((p & (side * side - 1u)) != 0u)
                continue;
            compute_extent(corner, side, s, low, high);
            first = (ivec2(2.0 * low) - margin) >> 1;
            count = ((ivec2(2.0 * high) + 1 + margin) >> 1) - first + 1;
            if (side == 1u || (count.x + 5) * (count.y + 5) <= RAW)
                break;
        }
        refine(first, count, n);
        refined_count += uint(count.x * count.y);
        if (!is_live)
            return;
        if (own >= p && own < p + side * side) {
            vec2 place = 2.0 * clamp(x, low, high);
            ivec2 whole = ivec2(place);
            value = sample_at(whole - 2 * first, place - vec2(whole), count.x);
        }
    }
#if GRADIENT
    value.yz /= vec2(spacing_at(0, x.x), spacing_at(1, x.y));
#endif
}

// The part of the interval [s, s + width] inside the half spaces; returns its share of the interval, and the share before it.
float cut(float s, float width, inout vec3 value, out float from) {
    from = clamp((begin - s) / width, 0.0, 1.0);
    float to = max(min((end - s) / width, 1.0), from);
    float first = value.x, change = value.z - first;
    float bend = value.y - (first + 0.5 * change), middle = 0.5 * (from + to);
    value = first + vec3(from, middle, to) * change +
            4.0 * vec3(from, middle, to) * (1.0 - vec3(from, middle, to)) * bend;
    return to - from;
}

#if !PROJECTION
// The half of an interval in which the value goes from x to y; the mean of the interval has two such parts.
Half classify_half(float x, float y) {
    const float top = float(BINS);
    float a = x * bin_scale.x + bin_scale.y, b = y * bin_scale.x + bin_scale.y, low = min(a, b), high = max(a, b);
    int i = int(clamp(low, 0.0, top)), j = max(int(clamp(high, 0.0, top)), i + 1);
    float above = max(high - top, 0.0) - max(low - top, 0.0);
    float inverse = 1.0 / (float(j - i) + max(-low, 0.0) + above);
    bool has_above = above_bins.w > 0.0;
    float before = max(-a, has_above ? 0.0 : a - top), seen = float(j - i) + (has_above ? above : 0.0);
    float front = clamp(before * inverse, 0.0, 1.0);
    return Half(0.5 * inverse * (integral[j] - integral[i] + above * above_bins), front, min(seen * inverse, 1.0 - front));
}

// 1 − opacity of an optical depth.
float transmit(float depth) {
    return base.y != 0 ? max(1.0 - depth, 0.0) : exp2(-LOG2E * depth);
}

// The gradient at p between the sheets of an interval, in world space.
vec3 compute_gradient(vec3 value[4], float width, float p) {
    float more = per_slice > 1 ? (0.7 / 3.0) * (1.0 / (1.0 + dot(ray.zw, ray.zw)) - 0.25) : 0.0;
    vec3 slope = slopes_at(value, p, more);
    float rest = slope.z / width - dot(ray.zw, slope.xy);
    vec3 own = turn_back(vec3(slope.xy, is_backwards ? -rest : rest));
    return vec3(dot(to_world[0].xyz, own), dot(to_world[1].xyz, own), dot(to_world[2].xyz, own));
}

#if GRADIENT
// Mixes the smooth gradient at s into the fine one.
vec3 smooth_gradient(float s, vec3 fine) {
    vec3 x = vec3(index_of(ray.xy + s * ray.zw), index_of(2, axes[slices].scale.w + (is_backwards ? -s : s)));
    vec3 own = turn_back(smooth_slopes(x));
    return mix_gradients(vec3(dot(to_world[0].xyz, own), dot(to_world[1].xyz, own), dot(to_world[2].xyz, own)), fine);
}
#endif

// Notes what the material of value x shows if the ray enters by a cut between s and s + width (draw/resample/cut_face.h).
void enter_face(float s, float width, float x) {
    if (!(s <= begin && begin < s + width && face != vec3(0)))
        return;
    float bin = x * bin_scale.x + bin_scale.y, top = float(BINS);
    int i = int(clamp(bin, 0.0, top));
    float depth = bin > top ? above_bins.w : integral[i + 1].w - integral[i].w;
    face_opacity = 1.0 - transmit(depth * ray_length);
}

// The share of the face's light in an interval that is seen at s. square: of the length of its own gradient.
float face_share(float s, float square) {
    float length = FACE * face_opacity * exp2(-2.0 * max(s - begin, 0.0));
    return length * length / max(length * length + square, TINY);
}

// Mixes two gradients as lines: draw/resample/normal.h. mean: of their lengths.
vec3 mix_normal(vec3 gradient, vec3 past, float firm, out float mean) {
    float square = dot(gradient, gradient), past_square = dot(past, past), both = dot(gradient, past);
    float inverse = inversesqrt(max(square, TINY)), past_inverse = inversesqrt(max(past_square, TINY));
    float cosine = clamp(both * inverse * past_inverse, -1.0, 1.0), sine_square = 1.0 - cosine * cosine;
    float a = firm * square * inverse, b = (1.0 - firm) * past_square * past_inverse * (1.0 - 0.4 * sine_square);
    vec2 m = vec2(a + b * (1.0 - 2.0 * sine_square), 2.0 * b * cosine * sqrt(sine_square));
    float scale = inversesqrt(max(dot(m, m), TINY)), larger = sqrt(0.5 + 0.5 * abs(m.x) * scale);
    float smaller = 0.5 * abs(m.y) * scale / larger, turned = m.x < 0.0 ? larger : smaller;
    float aside = (cosine < 0.0 ? -turned : turned) * inversesqrt(max(sine_square, 1e-8)) * past_inverse;
    float along = (m.x < 0.0 ? smaller : larger) * inverse - aside * both * inverse * inverse;
    mean = a + b;
    return along * gradient + aside * past;
}

// The unit normal of an interval; zero if there is none. As compute_normal() of draw/resample/integrate.c says, a surface's gradient
// stays for a while behind it.
vec3 compute_normal(vec3 gradient, float width, float opacity) {
    const float SHARE = 0.8, FAINT = 64.0;
    float rounding = metric[0].w, mean;
    vec3 past = normal * exp2(-2.0 * width);
    float least = SHARE * SHARE * dot(past, past) + rounding * rounding;
    float firm = min(dot(gradient, gradient) / least, 1.0);
    vec3 own = mix_normal(gradient, past, firm, mean);
    normal = mix(dot(normal, own) < 0.0 ? -normal : normal, mean * own, min(opacity * FAINT, 1.0));
    return own;
}

#if DEPTH
vec2 moments; // Σ T α d, Σ T α d², d = depth − depth_origin

void add_depth(float share, float d) {
    moments += share * vec2(d, d * d);
}

// d of a place on the ray.
float depth_at(float s) {
    vec4 by_depth = depths[slices];
    float aside = dot(at - lens.yz, by_depth.zw), forward = is_backwards ? -s : s;
    bool is_perspective = choice.x != 0u;
    float from = by_depth.x + (depth_origin - metric[1].w) * by_depth.y + (is_perspective ? depth_origin * aside : aside);
    return (forward - from) / (by_depth.y + (is_perspective ? aside : 0.0));
}
#endif

// place: s.
void add(float opacity, vec3 color, float place) {
#if DEPTH
    add_depth(pixel.x * opacity, depth_at(place));
#endif
    pixel.yzw += pixel.x * opacity * color;
    pixel.x *= 1.0 - opacity;
}

#if LAYERS
float next_s; // of the next fragment; FAR_AWAY = there is none
const float FAR_AWAY = 1e38;

// s of a fragment (draw/resample/insert.c). Depths count from one inside the volume, for the sake of rounding.
float compute_s(float depth) {
    vec4 by_depth = depths[slices];
    float beyond = depth - metric[1].w, aside = dot(at - lens.yz, by_depth.zw);
    float s = by_depth.x + beyond * by_depth.y + (choice.x != 0u ? depth * aside : aside);
    return is_backwards ? -s : s;
}

void set_next(uint i) {
    next_fragment = i;
    next_s = i < fragment_count ? compute_s(fragment_depth(i)) : FAR_AWAY;
}

// Composites the next fragment.
void insert() {
#if DEPTH
    float before = pixel.x, d = fragment_depth(next_fragment) - depth_origin;
#endif
    pixel = over_fragment(pixel);
#if DEPTH
    add_depth(before - pixel.x, d);
#endif
    set_next(next_fragment + 1u);
}

// Composites all fragments that lie before s.
void insert_before(float s) {
    while (next_s < s)
        insert();
}

// The opacity of a part of an interval.
float part_of(float opacity, float share) {
    if (base.y != 0)
        return opacity * share;
    return share > 0.0 ? 1.0 - pow(max(1.0 - opacity, 0.0), share) : 0.0;
}

// Composites the interval [s, s + width], which is seen at `place`, and the fragments in it.
void composite(float s, float width, float place, float opacity, vec3 color) {
    float from = max(s, begin), to = min(s + width, end), before = from, left = 1.0;
    while (next_s < to) {
        float next = max(next_s, before), share = to > from ? min((next - before) / (to - from), left) : 0.0;
        add(part_of(opacity, share), color, 0.5 * (before + next));
        insert();
        left -= share;
        before = next;
    }
    add(part_of(opacity, left), color, left < 1.0 ? 0.5 * (before + to) : place);
}
#else
void composite(float s, float width, float place, float opacity, vec3 color) {
    add(opacity, color, place);
}
#endif

// Composites the interval between sheets n and n + 1, of which value[1] and value[2] are the values.
void integrate(int n, vec3 value[4]) {
    float s = s_of(slice_of(n)), width = s_of(slice_of(n + 1)) - s;
#if LAYERS
    insert_before(s);
#endif
    float middle = (9.0 / 16.0) * (value[1].x + value[2].x) - (1.0 / 16.0) * (value[0].x + value[3].x);
    vec3 x = vec3(value[1].x, max(middle, code_scale.w), value[2].x);
    float low = min(min(x.x, x.y), x.z), high = max(max(x.x, x.y), x.z);
    if (!(bin_scale.z < high && low < bin_scale.w))
        return;
    float front, share = cut(s, width, x, front), passed = ray_length * width * share;
#if GRADIENT
    enter_face(s, width, x.x);
#endif
    Half own[2] = Half[2](classify_half(x.x, x.y), classify_half(x.y, x.z));
    vec4 sum = own[0].mean + own[1].mean;
    if (!(sum.w > 0.0))
        return;
    float light = transmit(sum.w * passed), seen_at = 0.0;
#if DEPTH && !GRADIENT
    seen_at = front + share * seen_share(sum.w * passed);
#endif
#if GRADIENT
    vec2 opacities = 1.0 - vec2(transmit(own[0].mean.w * passed), light);
    seen_at = front + share * seen_place(own, passed, opacities);
    vec3 gradient = compute_gradient(value, width, seen_at);
    if (base.w > 0) {
        float opacity = scale_of(sqrt(dot(gradient, gradient))) * (1.0 - exp2(-LOG2E * sum.w));
        light = transmit(-log2(max(1.0 - opacity, 1e-30)) / LOG2E * passed);
    }
#endif
    vec3 color = sum.rgb / max(sum.w, TINY);
#if GRADIENT
    if (choice.y != 0u && light < 1.0) {
        const float FAINT_LIGHT = 1.0 / 32.0; // share of the pixel's light
        if (smoothing.z > 0.0 && pixel.x * (1.0 - light) > FAINT_LIGHT)
            gradient = smooth_gradient(s + seen_at * width, gradient);
        vec3 to_eye = -normalize(vec3(choice.x != 0u ? (at - lens.yz) / lens.x : vec2(0), 1.0));
        float cut_share = face_share(s + seen_at * width, dot(gradient, gradient));
        vec3 unlit = color;
        color = shade_normal(unlit, compute_normal(gradient, width, 1.0 - light), to_eye);
        if (cut_share > 0.0)
            color = mix(color, shade_normal(unlit, face, to_eye), cut_share);
    }
#endif
    composite(s, width, s + seen_at * width, 1.0 - light, color);
}
#else
// Adds the interval between sheets n and n + 1 to the pixel's number (draw/resample/accumulate.c).
void integrate(int n, vec3 value[4]) {
    float s = s_of(slice_of(n)), width = s_of(slice_of(n + 1)) - s, sign = numbers[0].x, front;
    float middle = (9.0 / 16.0) * (value[1].x + value[2].x) - (1.0 / 16.0) * (value[0].x + value[3].x);
    bool is_known = choices.z == 0 || min(value[1].x, value[2].x) >= NONE_BELOW;
    if (choices.z != 0 && min(value[0].x, value[3].x) < NONE_BELOW)
        middle = 0.5 * (value[1].x + value[2].x);
    vec3 x = vec3(value[1].x, clamp(middle, CODE_MIN, CODE_MAX), value[2].x);
    float share = cut(s, width, x, front), passed = ray_length * width * share;
    if (!(share > 0.0) || !is_known)
        return;
    pixel.z += passed;
    if (choices.x == 0) {
        pixel.y += passed * dot(max(x - numbers[0].w, 0.0), vec3(1.0, 4.0, 1.0) / 6.0);
        return;
    }
    x *= sign;
    float bend = x.x + x.z - 2.0 * x.y, change = x.z - x.x, most = max(max(x.x, x.z), x.y);
    float low = min(sign * value[1].x, sign * value[2].x);
    float high = sign > 0.0 ? max(value[1].z, value[2].z) : -min(value[1].y, value[2].y);
    if (bend < -1e-3 && abs(change) < -2.0 * bend)
        most = max(most, x.y - change * change / (8.0 * bend));
    pixel.y = max(pixel.y, max(min(most, high), low));
    if (pixel.y >= numbers[0].z)
        pixel.x = 0.0;
}

// Turns the pixel's number into transmittance and colour.
void close_pixel() {
    float number = pixel.y, ray = choices.z != 0 ? pixel.z : (end - begin) * ray_length;
    if (!(begin < end) || !(ray > 0.0)) {
        pixel = vec4(1.0, 0.0, 0.0, 0.0);
        return;
    }
    if (choices.y != 0)
        number /= ray;
    if (numbers[1].x > 0.0)
        number = 1.0 - exp2(-numbers[1].x * number);
    float place = clamp(number * numbers[1].y + numbers[1].z, 0.0, 1.0) * float(COLORS);
    int whole = min(int(place), COLORS - 1);
    vec4 color = mix(colors[whole], colors[whole + 1], place - float(whole));
    pixel = vec4(1.0 - color.a, color.rgb * color.a);
}
#endif

// Mixes the pixel with what it shows without the volume.
void close_cover() {
    vec4 other = vec4(1.0, 0.0, 0.0, 0.0);
#if LAYERS
#if DEPTH
    vec2 others = vec2(0);
    for (next_fragment = 0u; next_fragment < fragment_count; next_fragment++) {
        float before = other.x, d = fragment_depth(next_fragment) - depth_origin;
        other = over_fragment(other);
        others += (before - other.x) * vec2(d, d * d);
    }
    moments = mix(others, moments, cover);
#else
    for (next_fragment = 0u; next_fragment < fragment_count; next_fragment++)
        other = over_fragment(other);
#endif
#elif DEPTH
    moments *= cover;
#endif
    pixel = mix(other, pixel, cover);
}

void add_counts(uint refined_count, uint sheets) {
    uint px = sheets * PIXELS, before = atomicAdd(fragments, px);
    if (before + px < before)
        atomicAdd(carry, 1u);
    atomicAdd(splats, refined_count);
}

void draw() {
    vec3 value[4] = vec3[4](vec3(0), vec3(0), vec3(0), vec3(0)); // of sheets n − 3 to n
    uint refined_count = 0u, sheets = 0u;
    mark_active();
    is_live = true;
    for (int next = find_next(range.x), n = next - 1; next < range.y && is_live; n++) {
        value[0] = value[1];
        value[1] = value[2];
        value[2] = value[3];
        read_sheet(n, value[3], refined_count);
        sheets++;
        if (n < next + 2)
            continue;
        integrate(next, value); // also where it is dark: an end per pixel would change the image more
        next = find_next(next + 1);
        n = max(n, next - 2); // sheets next − 1 to next + 2 are needed
    }
    if (thread == 0u && sheets > 0u)
        add_counts(refined_count, sheets);
}

void main() {
    thread = gl_LocalInvocationIndex;
    uvec2 corner = gl_WorkGroupID.xy * TILE + uvec2(0u, band.w), px = corner + gl_LocalInvocationID.xy;
    bool is_inside = px.x < band.x && px.y < band.z;
    uint index = (px.y - band.y) * band.x + px.x;
    Square square = find_square(corner);
    at = open_cover(vec2(corner), vec2(px) + 0.5);
    pixel = is_inside ? image[index] : vec4(0);
    uint pixels = band.x * (band.z - band.y), own = index + pixels;
    vec4 kept = is_inside && range.x > 0 ? image[own] : vec4(0);
    normal = kept.xyz;
    face_opacity = 2.0 * fract(kept.w);
#if DEPTH
    vec4 kept_moments = is_inside ? image[own + 2u * pixels] : vec4(0);
    moments = kept_moments.xy;
#endif
#if PROJECTION
    if (is_inside && range.x == 0)
        pixel = vec4(1.0, choices.x != 0 ? numbers[0].y : 0.0, 0.0, 0.0);
#endif
    open_axis(square.kind.y, square.kind.z != 0, part.x);
    open_ray(square);
    pass_share = compute_share(square.kind.w);
#if LAYERS
    open_fragments(0u, is_inside ? index : 0u, pixels);
    set_next(is_inside ? uint(kept.w) : fragment_count);
#endif
    rays[thread] = ray;
    if (thread == 0u) {
        span[0] = ordinal(1e30);
        span[1] = ordinal(-1e30);
        live_at = 0;
    }
    barrier();
    if (begin < end) {
        atomicMin(span[0], ordinal(begin));
        atomicMax(span[1], ordinal(end));
    }
    if (pixel.x > TRANSMITTANCE_MIN && pass_share > 0.0)
        live_at = 1;
    barrier();
    bool has_work = live_at != 0 && span[0] < span[1];
    barrier();
    if (has_work)
        draw();
#if LAYERS
    if (part.y != 0)
        insert_before(FAR_AWAY);
    kept.w = float(next_fragment);
#endif
#if PROJECTION
    if (part.y != 0)
        close_pixel();
#endif
    for (int i = is_crossed ? part.y : 0; i > 0; i--) // once
        close_cover();
    if (is_inside && part.y != 0 && part.z != 0) {
        image[own + pixels] += axis_share * pass_share * pixel;
#if DEPTH
        image[own + 2u * pixels] = vec4(0.0, 0.0, kept_moments.zw + axis_share * pass_share * moments);
#endif
        image[index] = vec4(1.0, 0.0, 0.0, 0.0); // for the next pass
    } else if (is_inside) {
        image[index] = pixel;
#if DEPTH
        image[own + 2u * pixels] = vec4(moments, kept_moments.zw);
#endif
#if GRADIENT || LAYERS
        image[own] = vec4(normal, floor(kept.w) + 0.5 * face_opacity);
#endif
    }
}
