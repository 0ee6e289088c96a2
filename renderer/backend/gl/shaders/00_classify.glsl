// SPDX-License-Identifier: Apache-2.0
// Samples → the list of visible voxels (classify/collect.c), a work group a brick of 16³. By PASS: the range of each
// brick's keys; how many of its voxels are listed; their entries and gradients, in rising order of their place; the
// voxels of each key.

layout(local_size_x = GROUP) in;
// 8 or 16 bits each, as they lie in memory.
layout(std430, binding = 0) readonly buffer Samples { uint samples[]; };
// By brick: smallest key | largest << 16.
layout(std430, binding = 1) buffer Ranges { uint ranges[]; };
// A bit a key.
layout(std430, binding = 2) readonly buffer Listed { uint listed[]; };
// By brick: entries; while they are written, where the first of them goes. By key: voxels.
layout(std430, binding = 3) buffer Counts { uint counts[]; };
// 10_project.glsl
layout(std430, binding = 4) writeonly buffer Entries { uint entries[]; };
layout(std430, binding = 5) buffer Normals { uint normals[]; };
layout(std430, binding = 6) readonly buffer Tables { vec4 tables[]; };

layout(location = 0) uniform uint first_brick;
layout(location = 1) uniform uvec3 dims;
layout(location = 2) uniform ivec4 type;       // bytes of a sample, signed, value of key 0, bytes of a normal
layout(location = 3) uniform uvec4 axis_rows;  // of the tables: of sample 0 of each axis; rectilinear
layout(location = 4) uniform mat3 to_gradient; // differences a spacing → world gradient over its bound

const int RANGES = 0, COUNT = 1, FILL = 2, HISTOGRAM = 3;

shared uint low, high, shows;
shared uint masks[128], ends[128]; // by 32 voxels: a bit each, and the entries up to their end

// As the type has it.
int sample_at(uvec3 i) {
    uint at = (i.z * dims.y + i.y) * dims.x + i.x;
    int bits = 8 * type.x, per_word = 4 / type.x;
    uint word = samples[at / uint(per_word)], shift = uint(bits) * (at % uint(per_word));
    return type.y != 0 ? bitfieldExtract(int(word), int(shift), bits)
                       : int(bitfieldExtract(word, int(shift), bits));
}

uint key_at(uvec3 i) {
    return uint(sample_at(i) - type.z);
}

uvec3 corner_of(uint brick) {
    uvec3 bricks = (dims + 15u) / 16u;
    return 16u * uvec3(brick % bricks.x, brick / bricks.x % bricks.y, brick / bricks.x / bricks.y);
}

// The thread's voxel of a slice.
uvec3 voxel_of(uvec3 corner, uint slice) {
    return corner + uvec3(gl_LocalInvocationIndex & 15u, gl_LocalInvocationIndex >> 4, slice);
}

void find_range(uint brick) {
    uvec3 corner = corner_of(brick);
    uint least = 0xffffu, most = 0u;
    for (uint s = 0u; s < 16u; s++) {
        uvec3 i = voxel_of(corner, s);
        if (all(lessThan(i, dims))) {
            uint key = key_at(i);
            least = min(least, key);
            most = max(most, key);
        }
    }
    atomicMin(low, least);
    atomicMax(high, most);
    barrier();
    if (gl_LocalInvocationIndex == 0u)
        ranges[brick] = low | high << 16;
}

// Whether any key of the brick's range is listed.
bool shows_any(uint brick) {
    uint first = ranges[brick] & 0xffffu, last = ranges[brick] >> 16, any = 0u;
    for (uint w = first / 32u + gl_LocalInvocationIndex; w <= last / 32u; w += GROUP) {
        uint bits = listed[w];
        bits &= w == first / 32u ? 0xffffffffu << (first & 31u) : 0xffffffffu;
        bits &= w == last / 32u ? 0xffffffffu >> (31u - (last & 31u)) : 0xffffffffu;
        any |= bits;
    }
    if (any != 0u)
        atomicOr(shows, 1u);
    barrier();
    return shows != 0u;
}

// Fills masks and ends.
void mark(uvec3 corner) {
    uint thread = gl_LocalInvocationIndex;
    for (uint s = 0u; s < 16u; s++) {
        uvec3 i = voxel_of(corner, s);
        if (!all(lessThan(i, dims)))
            continue;
        uint key = key_at(i);
        if ((listed[key / 32u] >> (key & 31u) & 1u) != 0u)
            atomicOr(masks[8u * s + thread / 32u], 1u << (thread & 31u));
    }
    barrier();
    if (thread < 128u)
        ends[thread] = uint(bitCount(masks[thread]));
    barrier();
    for (uint step = 1u; step < 128u; step *= 2u) {
        uint before = thread >= step && thread < 128u ? ends[thread - step] : 0u;
        barrier();
        if (thread < 128u)
            ends[thread] += before;
        barrier();
    }
}

// sp_gradient_at(): over its bound.
vec3 gradient_at(uvec3 i) {
    vec3 difference;
    for (int a = 0; a < 3; a++) {
        uvec3 from = i, to = i;
        from[a] -= i[a] > 0u ? 1u : 0u;
        to[a] += i[a] + 1u < dims[a] ? 1u : 0u;
        float gaps = float(to[a] - from[a]);
        if (axis_rows.w != 0u)
            gaps *= tables[axis_rows[a] + i[a]].y;
        difference[a] = from[a] < to[a] ? float(sample_at(to) - sample_at(from)) / gaps : 0.0;
    }
    return to_gradient * difference;
}

// The octahedral map of a direction whose absolute values add up to `sum`, > 0.
vec2 unfold(vec3 d, float sum) {
    vec2 uv = d.xy / sum, side = mix(vec2(1), vec2(-1), lessThan(uv, vec2(0)));
    return d.z < 0.0 ? (1.0 - abs(uv.yx)) * side : uv;
}

// sp_gradient_pack_direction().
uint pack_direction(vec3 d) {
    float sum = abs(d.x) + abs(d.y) + abs(d.z);
    if (!(sum > 0.0))
        return 0u;
    uvec2 steps = uvec2(unfold(d, sum) * 127.0 + 127.5);
    uint code = steps.y << 8 | steps.x;
    return code != 0u ? code : 254u << 8 | 254u;
}

// sp_gradient_pack().
uint pack_gradient(vec3 d) {
    float sum = abs(d.x) + abs(d.y) + abs(d.z);
    if (!(sum > 0.0))
        return 0u;
    float magnitude = clamp(floor(sqrt(sum * length(d / sum)) * 1023.0 + 0.5), 1.0, 1023.0);
    uvec2 steps = uvec2(floor(unfold(d, sum) * 1023.0 + 0.5) + 1023.0);
    return uint(magnitude) << 22 | steps.y << 11 | steps.x;
}

void write_entry(uint entry, uint local, uvec3 i) {
    entries[entry] = local | key_at(i) << 12;
    if (type.w == 4)
        normals[entry] = pack_gradient(gradient_at(i));
    if (type.w == 2) /* half a word, in one that was cleared */
        atomicOr(normals[entry / 2u], pack_direction(gradient_at(i)) << (16u * (entry & 1u)));
}

void fill(uint brick, uvec3 corner) {
    uint thread = gl_LocalInvocationIndex, first = counts[brick];
    for (uint s = 0u; s < 16u; s++) {
        uint word = 8u * s + thread / 32u, bit = 1u << (thread & 31u), mask = masks[word];
        if ((mask & bit) == 0u)
            continue;
        uint before = ends[word] - uint(bitCount(mask)) + uint(bitCount(mask & (bit - 1u)));
        write_entry(first + before, s << 8 | thread, voxel_of(corner, s));
    }
}

void add_key(uint key, uint voxels) {
    if (voxels > 0u)
        atomicAdd(counts[key], voxels);
}

// Equal neighbours are counted together: most of a volume is often one value, for which all would wait.
void count_keys(uint brick) {
    uvec3 corner = corner_of(brick), size = min(dims - corner, uvec3(16));
    uint range = ranges[brick], last = 0u, voxels = 0u;
    if (range >> 16 == (range & 0xffffu)) {
        if (gl_LocalInvocationIndex == 0u)
            add_key(range & 0xffffu, size.x * size.y * size.z);
        return;
    }
    for (uint s = 0u; s < 16u; s++) {
        uvec3 i = voxel_of(corner, s);
        if (!all(lessThan(i, dims)))
            continue;
        uint key = key_at(i);
        if (key != last) {
            add_key(last, voxels);
            voxels = 0u;
        }
        last = key;
        voxels++;
    }
    add_key(last, voxels);
}

void main() {
    uint brick = first_brick + gl_WorkGroupID.x, thread = gl_LocalInvocationIndex;
    if (thread == 0u) {
        low = 0xffffu;
        high = shows = 0u;
    }
    if (thread < 128u)
        masks[thread] = 0u;
    barrier();
    if (PASS == RANGES) {
        find_range(brick);
        return;
    }
    if (PASS == HISTOGRAM) {
        count_keys(brick);
        return;
    }
    bool is_empty = !shows_any(brick);
    if (!is_empty)
        mark(corner_of(brick));
    if (PASS == COUNT && thread == 0u)
        counts[brick] = is_empty ? 0u : ends[127];
    if (PASS == FILL && !is_empty)
        fill(brick, corner_of(brick));
}
