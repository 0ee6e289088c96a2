// SPDX-License-Identifier: Apache-2.0
// Composites a tile's pairs front to back (draw/footprints/blend.h). One work group per tile, one thread per pixel. Splats are
// staged in shared memory. A pixel sums T and E of a layer and composites it when the next layer begins, or composites
// each splat on its own. A tile with a transmittance below 1/512 stops. To keep dispatches short, a tile with many
// pairs is composited in several passes, each of which continues where the previous one stopped. LAYERS: fragments of other
// layers are inserted.

layout(local_size_x = TILE, local_size_y = TILE) in;
layout(std430, binding = 2) readonly buffer Totals { uint totals[]; };
layout(std430, binding = 3) readonly buffer Pairs { uint pairs[]; };
// By pixel: transmittance and premultiplied colour. Behind the values of all pixels: two more per pixel for `sum` of the layer
// that the last pass or batch left open; the y of the second is the number of fragments that were composited.
layout(std430, binding = 4) buffer Image { vec4 image[]; };

layout(location = 1) uniform uvec3 batch; // width of the image [px], capacity in pairs, pairs of a tile in a pass
layout(location = 2) uniform uvec4 joint; // batch resumes a layer, batch leaves one open, pass, passes

const bool divides_splats = COMPOSITING == 0u && LAYERS != 0;
const uint STAGED = TILE * TILE, WORDS = COMPOSITING == 2u || divides_splats ? 4u : 2u; // of four, of a record without its cuts
const float TRANSMITTANCE_MIN = 1.0 / 512.0;
#if !LAYERS
const uint NO_LAYER = 0xffffffffu;
#endif

shared uvec4 staged[WORDS * STAGED];
shared uint staged_at[STAGED];
shared bool is_live;

// Sums of the open layer: T and E; post: Σ length, Σ gradient·length, and Σ value·length.
vec4 sum;
float sum_value;
vec4 pixel; // composited so far
vec2 at;    // the pixel's centre

// Factor of E, (1 − e^{−t})/t, and transmittance e^{−t}; linear: 1 or 1/t, and 1 − min(t, 1).
vec2 attenuate(float t) {
    if (is_linear)
        return t < 1.0 ? vec2(1.0, 1.0 - t) : vec2(1.0 / t, 0.0);
    if (t < 0.01) {
        float series = 1.0 - t * (0.5 - t * (1.0 / 6.0));
        return vec2(series, 1.0 - t * series);
    }
    float e = exp2(-LOG2E * t);
    return vec2((1.0 - e) / t, e);
}

#if POST
// (W, N, S) → (T, E).
void classify() {
    if (!(sum.x > 1e-12)) {
        sum = vec4(0);
        return;
    }
    bool perspective = choice.x != 0u;
    vec2 ray = perspective ? (at - lens.yz) / lens.x : vec2(0);
    vec3 gradient = sum.yzw / sum.x, to_eye = -normalize(vec3(ray, 1.0));
    vec3 world = to_camera[0].xyz * to_eye.x + to_camera[1].xyz * to_eye.y + to_camera[2].xyz * to_eye.z;
    float magnitude = length(gradient);
    Class c = classify_pixel(sum_value / sum.x, abs(dot(world, gradient)) * curve_nodes.z, magnitude);
    if (choice.y != 0u && c.depth > 0.0)
        c.color = shade_normal(c.color, magnitude > 1e-12 ? gradient / magnitude : vec3(0), to_eye);
    float t = max(c.depth, 0.0) * sum.x;
    sum = t * vec4(1.0, c.color);
}
#else
void classify() {}
#endif

// Composites more matter behind the matter that the pixel has so far. pixel: its transmittance and colour. amount: optical depth
// and colour.
vec4 add_behind(vec4 pixel, vec4 amount) {
    vec2 a = attenuate(amount.x);
    return vec4(pixel.x * a.y, pixel.yzw + a.x * pixel.x * amount.yzw);
}

// Composites a part of the open layer, and leaves the rest.
void composite_part(float part) {
    vec4 front = part * sum;
    pixel = add_behind(pixel, front);
    sum -= front;
}

#if LAYERS
// Composites the fragments before and in the open layer, and what lies before the last of them.
void insert(uint layer) {
    float done = 0.0;
    while (next_layer <= layer) {
        float share = next_layer == layer ? next_share : 0.0;
        if (share > done) {
            composite_part((share - done) / (1.0 - done));
            done = share;
        }
        pixel = over_fragment(pixel);
        set_next(at, next_fragment + 1u);
    }
}
#endif

#if LAYERS
// Composites the fragments that do not divide splats of the layer, and what lies behind each of them.
void insert_before(uint layer) {
    while (next_layer <= layer) {
        pixel = over_fragment(pixel);
        pixel = vec4(pixel.x * (1.0 - sum.x), pixel.yzw + pixel.x * sum.yzw);
        sum = vec4(0);
        set_next(at, next_fragment + 1u);
    }
}

// Composites the share of staged splat i before the next fragment, and adds the rest to what lies behind it.
void add_divided(uint i) {
    uvec4 rest = staged[WORDS * i + 1u];
    vec4 line = uintBitsToFloat(staged[WORDS * i + 2u]);
    vec2 d;
    float exponent, weight = weigh(staged[WORDS * i], uintBitsToFloat(rest.x), at, d, exponent);
    if (!(weight > 0.0))
        return;
    insert_before(uint(slab.x) + (rest.w >> 16));
    uint cuts = staged_at[i] + WORDS;
    float face = (next_share - line.x - dot(line.yz, d)) * line.w;
    vec4 amount = weight * uintBitsToFloat(rest.y) * vec4(1.0, unpackHalf2x16(rest.z), unpackHalf2x16(rest.w).x);
    pixel = add_behind(pixel, amount * share_of(cuts, vec2(-UNBOUNDED, face), d, exponent));
    vec4 behind = add_behind(vec4(1.0 - sum.x, sum.yzw), amount * share_of(cuts, vec2(face, UNBOUNDED), d, exponent));
    sum = vec4(1.0 - behind.x, behind.yzw);
}
#endif

// Composites the open layer, number `layer` of the batch.
void composite(uint layer) {
    classify();
#if LAYERS
    if (layer != NO_LAYER)
        insert(uint(slab.x) + layer);
#endif
    composite_part(1.0);
    sum = vec4(0);
    sum_value = 0.0;
}

uint end_of(uint bin) {
    return totals[bin / SCAN_BLOCK] + count[bin];
}

// Loads pairs [begin, begin + STAGED) into shared memory, one per thread; true while some pixel needs them.
bool stage(uint thread, uint begin, uint end) {
    barrier();
    if (thread == 0u)
        is_live = false;
    barrier();
    if (pixel.x >= TRANSMITTANCE_MIN)
        is_live = true;
    if (begin + thread < end) {
        uint pair = pairs[begin + thread];
        uint record = shape.y * (pair & ((1u << RECORD_BITS) - 1u));
        staged_at[thread] = record;
        for (uint w = 0u; w < WORDS; w++)
            staged[WORDS * thread + w] = records[record + w];
        staged[WORDS * thread + 1u].w += pair >> RECORD_BITS << 16;
    }
    barrier();
    return is_live;
}

// Adds staged splat i, which belongs to the open layer.
void add(uint i) {
    uvec4 rest = staged[WORDS * i + 1u], line = staged[WORDS * i + WORDS - 2u], range = staged[WORDS * i + WORDS - 1u];
    vec2 d, bounds = vec2(-UNBOUNDED, UNBOUNDED);
    float exponent, weight = weigh(staged[WORDS * i], uintBitsToFloat(rest.x), at, d, exponent);
    if (compositing == COMPOSITE_SLAB)
        bounds = slab_bounds(uintBitsToFloat(line), ivec2(range.xy), int(slab.x) + int(rest.w >> 16), d);
    if (weight > 0.0 && (compositing == COMPOSITE_SLAB || is_clipped))
        weight *= share_of(staged_at[i] + WORDS, bounds, d, exponent);
    float t = weight * uintBitsToFloat(rest.y);
    sum += t * vec4(1.0, unpackHalf2x16(rest.z), unpackHalf2x16(rest.w).x);
    if (is_post)
        sum_value += t * uintBitsToFloat(range.z);
}

// Adds n staged splats layer by layer, so that each layer is composited once even if branches are masked.
void add_staged(uint n, inout uint layer) {
#if LAYERS
    for (uint i = 0u; i < n && divides_splats; i++)
        add_divided(i);
#endif
    for (uint i = 0u; i < n && !divides_splats;) {
        uint own = staged[WORDS * i + 1u].w >> 16;
        if (own != layer || compositing == COMPOSITE_SPLAT)
            composite(layer);
        layer = own;
        do {
            add(i++);
        } while (compositing != COMPOSITE_SPLAT && i < n && staged[WORDS * i + 1u].w >> 16 == own);
    }
}

// The layer of a pair.
uint layer_of(uint pair) {
    uint record = shape.y * (pair & ((1u << RECORD_BITS) - 1u));
    return (records[record + 1u].w >> 16) + (pair >> RECORD_BITS);
}

void main() {
    uint thread = gl_LocalInvocationIndex, tile = gl_WorkGroupID.y * tiles.x + gl_WorkGroupID.x;
    uvec2 px = gl_WorkGroupID.xy * TILE + gl_LocalInvocationID.xy;
    bool inside = px.x < batch.x && px.y < tiles.z - tiles.y;
    uint index = px.y * batch.x + px.x, layer = NO_LAYER;
    uint first = tile > 0u ? end_of(tile * tiles.w - 1u) : 0u, end = end_of(tile * tiles.w + tiles.w - 1u);
    if (total > batch.y)
        end = first;
    if (thread == 0u && joint.z == 0u)
        atomicMax(longest, end - first);
    if (end - first > batch.z * joint.w) // too many: the band is drawn again in more passes
        end = first;
    uint begin = first + joint.z * batch.z, stop = min(end, begin + batch.z);
    if (joint.z > 0u && begin >= end) // another pass closed the tile
        return;
    at = vec2(px) + vec2(0.5, float(tiles.y) + 0.5);
    uint left = batch.x * (tiles.z - tiles.y) + 2u * index;
    pixel = inside ? image[index] : vec4(0);
    sum = vec4(0);
    sum_value = 0.0;
#if LAYERS
    open_fragments(uint(sheet_planes.w), inside ? index : 0u, batch.x * (tiles.z - tiles.y));
    set_next(at, inside ? uint(image[left + 1u].y) : fragment_count);
#endif
    if (inside && divides_splats)
        sum = image[left];
    if (inside && !divides_splats && (joint.z > 0u || joint.x != 0u)) {
        sum = image[left];
        sum_value = image[left + 1u].x;
        layer = joint.z > 0u ? layer_of(pairs[begin - 1u]) : 0u;
    }
    for (; begin < stop && stage(thread, begin, stop); begin += STAGED)
        add_staged(min(STAGED, stop - begin), layer);
    if (begin < stop) { // the tile is opaque: drop the open layer, whose splats come in any order
        sum = vec4(0);
        sum_value = 0.0;
    }
    if (!inside)
        return;
    if (stop < end || joint.y != 0u) {
        image[left] = sum;
        image[left + 1u].x = sum_value;
    } else if (!divides_splats) {
        composite(layer);
    }
    image[index] = pixel;
#if LAYERS
    image[left] = sum;
    image[left + 1u].y = float(next_fragment);
#endif
}
