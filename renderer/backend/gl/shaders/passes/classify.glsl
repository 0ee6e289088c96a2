// SPDX-License-Identifier: Apache-2.0
// Samples → the list of visible voxels (classify/collect.c). One work group per brick of 16³ voxels. By PASS: the
// range of each brick's samples; the number of its listed voxels; their entries, gradients and classes, sorted by
// place; the number of voxels of each key; new classes of existing entries.

layout(local_size_x = GROUP) in;
// Smallest and largest ordinal by brick; order post: by cell, joined with its neighbourhood (compute_cell_bounds.glsl).
layout(std430, binding = 1) buffer Ranges { ivec2 ranges[]; };
// By brick: the number of entries, or the index of the first one while they are written. By key: number of voxels.
layout(std430, binding = 3) buffer Counts { uint counts[]; };
// project.glsl
layout(std430, binding = 4) buffer Entries { uint entries[]; };
layout(std430, binding = 6) buffer Tables { vec4 tables[]; };
layout(std430, binding = 7) buffer Normals { uint normals[]; };

layout(location = 3) uniform uvec4 axis_rows;  // rows of the tables for sample 0 of each axis; rectilinear
layout(location = 4) uniform mat3 to_gradient; // differences per spacing, times their scale → world gradient over its bound
layout(location = 5) uniform uvec4 how;        // BY_…; intervals; NO_CLASSES …; row of the first class
layout(location = 6) uniform vec3 base;        // base of values, as a sum of two; scale of differences
layout(location = 7) uniform int whole_base;   // for integers: a third term of that sum

const int RANGES = 0, COUNT = 1, FILL = 2, HISTOGRAM = 3, CLASSES = 4;
const uint BY_KEY = 0u, BY_VALUE = 1u, BY_CELL = 2u;   // how.x
const uint NO_CLASSES = 0u, COLORS = 1u, VALUES = 2u; // how.z

shared int low, high;
shared uint shows, marked[2]; // one bit per cell of the brick that can matter

uint key_of(int ordinal) {
    return uint(ordinal - type.z);
}

// Returns the brick's range in keys.
uvec2 key_range(uint brick) {
    return uvec2(ranges[brick] - type.z);
}

void measure_range(uint brick) {
    uvec3 corner = corner_of(brick);
    ivec2 range = ivec2(NONE_LOW, NONE_HIGH);
    for (uint s = 0u; s < 16u; s++) {
        uvec3 i = voxel_of(corner, s);
        if (!all(lessThan(i, dims)))
            continue;
        int ordinal = ordinal_at(i);
        if (is_finite(ordinal))
            range = ivec2(min(range.x, ordinal), max(range.y, ordinal));
    }
    atomicMin(low, range.x);
    atomicMax(high, range.y);
    barrier();
    if (gl_LocalInvocationIndex == 0u)
        ranges[brick] = ivec2(low, high);
}

// True if a key of the brick's range is listed.
bool shows_key(uint brick) {
    uvec2 range = key_range(brick);
    uint first = range.x, last = range.y, any = 0u;
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

// Finds the brick's cells that can matter; false if none does.
bool shows_cell(uint brick) {
    uint thread = gl_LocalInvocationIndex;
    if (thread < 64u) {
        uvec3 size = 4u * count_bricks(), at = corner_of(brick) / 4u;
        at += uvec3(thread, thread >> 2, thread >> 4) & 3u;
        if (meets(ranges[(at.z * size.y + at.y) * size.x + at.x], how.y))
            atomicOr(marked[thread / 32u], 1u << (thread & 31u));
    }
    barrier();
    return (marked[0] | marked[1]) != 0u;
}

bool shows_any(uint brick) {
    if (how.x == BY_KEY)
        return shows_key(brick);
    return how.x == BY_CELL ? shows_cell(brick) : meets(ranges[brick], how.y);
}

bool is_listed(int ordinal, uint slice) {
    if (how.x == BY_VALUE)
        return meets(ivec2(ordinal), how.y);
    uint thread = gl_LocalInvocationIndex, key = key_of(ordinal);
    uint cell = (thread >> 2 & 3u) | (thread >> 4 & 12u) | (slice & 12u) << 2;
    if (how.x == BY_CELL)
        return (marked[cell / 32u] >> (cell & 31u) & 1u) != 0u && is_finite(ordinal);
    return (listed[key / 32u] >> (key & 31u) & 1u) != 0u;
}

void mark(uvec3 corner) {
    uint thread = gl_LocalInvocationIndex;
    for (uint s = 0u; s < 16u; s++) {
        uvec3 i = voxel_of(corner, s);
        if (all(lessThan(i, dims)) && is_listed(ordinal_at(i), s))
            set_mark(s << 8 | thread);
    }
    barrier();
    sum_marks();
}

// Distance of two neighbours of sample `i` along an axis, in spacings.
float gap_of(int axis, uint i, uint from, uint to) {
    float gaps = float(to - from);
    uint row = axis_rows[axis];
    if (axis_rows.w == 0u)
        return gaps;
    if (to == min(i + 1u, dims[axis] - 1u) && from == max(i, 1u) - 1u)
        return gaps * tables[row + i].y;
    vec4 a = tables[row + from], b = tables[row + to]; // beside a sample that is not finite
    precise float gap = (b.z - a.z) + (b.w - a.w) + (b.x - a.x);
    return gap;
}

float rise(uvec3 to, uvec3 from) {
    if (type.y != REAL)
        return difference(ordinal_at(to), ordinal_at(from));
    precise float up = uintBitsToFloat(samples[index_of(to)]) * base.z - uintBitsToFloat(samples[index_of(from)]) * base.z;
    return up;
}

// sp_gradient_at(), divided by its bound.
vec3 gradient_at(uvec3 i) {
    vec3 slope;
    for (int a = 0; a < 3; a++) {
        uvec3 from = i, to = i;
        from[a] -= i[a] > 0u ? 1u : 0u;
        to[a] += i[a] + 1u < dims[a] ? 1u : 0u;
        if (!is_finite(ordinal_at(from)))
            from = i;
        if (!is_finite(ordinal_at(to)))
            to = i;
        slope[a] = from[a] < to[a] ? rise(to, from) / gap_of(a, i[a], from[a], to[a]) : 0.0;
    }
    return to_gradient * slope;
}

// sp_transfer_keys(): the value relative to the base. Reals: the difference and its remainder, so that it is rounded once.
float value_at(uvec3 i) {
    if (type.y != REAL)
        return difference(ordinal_at(i), whole_base) - base.y;
    precise float value = uintBitsToFloat(samples[index_of(i)]), sum = value - base.x, part = sum - value;
    precise float rest = (value - (sum - part)) - (base.x + part);
    precise float all = sum + (rest - base.y);
    return all;
}

void write_class(uint entry, uvec3 i) {
    float value = value_at(i);
    vec4 row = vec4(value, 0.0, 0.0, 0.0);
    if (how.z == COLORS) {
        Class c = class_at(value);
        row = vec4(c.color, c.depth);
    }
    tables[how.w + entry] = row;
}

void write_entry(uint entry, uint local, uvec3 i) {
    entries[entry] = local | (type.x == 4 ? 0u : key_of(ordinal_at(i)) << 12);
    if (type.w == 4)
        normals[entry] = pack_gradient(gradient_at(i));
    if (type.w == 2) /* half a word, in one that was cleared */
        atomicOr(normals[entry / 2u], pack_direction(gradient_at(i)) << (16u * (entry & 1u)));
    if (how.z != NO_CLASSES)
        write_class(entry, i);
}

// Writes the classes of existing entries.
void write_classes(uint brick) {
    uvec3 corner = corner_of(brick);
    for (uint e = counts[brick] + gl_LocalInvocationIndex; e < counts[brick + 1u]; e += GROUP)
        write_class(e, corner + (uvec3(entries[e], entries[e] >> 4, entries[e] >> 8) & 15u));
}

void fill(uint brick, uvec3 corner) {
    uint thread = gl_LocalInvocationIndex, first = counts[brick];
    for (uint s = 0u; s < 16u; s++) {
        uint before;
        if (read_mark(s << 8 | thread, before))
            write_entry(first + before, s << 8 | thread, voxel_of(corner, s));
    }
}

void add_key(uint key, uint voxels) {
    if (voxels > 0u)
        atomicAdd(counts[key], voxels);
}

// Counts equal neighbours together: often most of a volume has one value, and all threads would wait for its counter.
void count_keys(uint brick) {
    uvec3 corner = corner_of(brick), size = min(dims - corner, uvec3(16));
    uvec2 range = key_range(brick);
    uint last = 0u, voxels = 0u;
    if (range.x == range.y) {
        if (gl_LocalInvocationIndex == 0u)
            add_key(range.x, size.x * size.y * size.z);
        return;
    }
    for (uint s = 0u; s < 16u; s++) {
        uvec3 i = voxel_of(corner, s);
        if (!all(lessThan(i, dims)))
            continue;
        uint key = key_of(ordinal_at(i));
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
        low = NONE_LOW;
        high = NONE_HIGH;
        shows = marked[0] = marked[1] = 0u;
    }
    clear_marks();
    barrier();
    if (PASS == RANGES) {
        measure_range(brick);
        return;
    }
    if (PASS == CLASSES) {
        write_classes(brick);
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
        counts[brick] = is_empty ? 0u : marks_before(4096u);
    if (PASS == FILL && !is_empty)
        fill(brick, corner_of(brick));
}
