// SPDX-License-Identifier: Apache-2.0
// The list of a mip level → the list of the next coarser level (classify/mip.c). One work group per coarse brick. By
// PASS: the number of its cells with a visible voxel; their entries, classes and microflakes (order post: values and
// gradients). Lists are sorted by place. Therefore a slice of a brick is found by bisection, and the eight voxels of a
// cell are always added in the same order.

layout(local_size_x = GROUP) in;
// The finer level, as in project.glsl, and the first entry of each of its bricks.
layout(std430, binding = 0) readonly buffer Entries { uint entries[]; };
layout(std430, binding = 1) readonly buffer Tables { vec4 tables[]; };
layout(std430, binding = 2) readonly buffer Normals { uint normals[]; };
layout(std430, binding = 3) readonly buffer Firsts { uint firsts[]; };
// The coarse level. By brick: the number of entries, or the index of the first one while they are written.
layout(std430, binding = 4) buffer Counts { uint counts[]; };
layout(std430, binding = 5) writeonly buffer CoarseEntries { uint coarse_entries[]; };
layout(std430, binding = 6) buffer CoarseTables { vec4 coarse_tables[]; };
layout(std430, binding = 7) writeonly buffer Microflakes { uint microflakes[]; }; // two words each; order post: gradients

layout(location = 0) uniform uint first_brick;
layout(location = 1) uniform uvec3 dims; // of the finer level
layout(location = 2) uniform uvec4 list; // has keys, bytes of a normal, first class, has scales
layout(location = 3) uniform uvec4 rows; // of its tables, for sample 0 of each axis; rectilinear
layout(location = 4) uniform uvec4 coarse_rows; // the same of the coarse tables; first class
layout(location = 5) uniform vec3 ratio; // of the finer spacing to the coarse one
layout(location = 6) uniform uint is_post;

const int COUNT = 0, FILL = 1;
const float MINOR = 0.525731112, MAJOR = 0.850650808;

shared uint bounds[8][17]; // first entry of slice s of finer brick b
shared uint voxels[2048];  // entries + 1 of a coarse slice, by x | y << 5 | z << 10; 0 = none

// Sums over the voxels of a cell, weighted by depth.
struct Sum {
    float depth;
    vec3 color;
    float area[6], sided;
};

void compute_bounds(uvec3 coarse) {
    uint b = gl_LocalInvocationIndex / 17u, s = gl_LocalInvocationIndex % 17u;
    if (b >= 8u)
        return;
    uvec3 bricks = (dims + 15u) / 16u, at = 2u * coarse + (uvec3(b, b >> 1, b >> 2) & 1u);
    bool is_inside = all(lessThan(at, bricks));
    uint brick = (at.z * bricks.y + at.y) * bricks.x + at.x;
    uint low = is_inside ? firsts[brick] : 0u, high = is_inside ? firsts[brick + 1u] : 0u;
    while (low < high) {
        uint middle = (low + high) / 2u;
        if ((entries[middle] & 4095u) < s << 8)
            low = middle + 1u;
        else
            high = middle;
    }
    bounds[b][s] = low;
}

// A list may contain voxels that are not visible.
bool is_hidden(uint word) {
    return is_post == 0u && list.x != 0u && !(tables[list.z + (word >> 12)].w > 0.0);
}

// Marks the cells with a visible voxel.
void mark() {
    uint thread = gl_LocalInvocationIndex;
    for (uint b = 0u; b < 8u; b++) {
        uint offset = (b & 1u) << 3 | (b & 2u) << 6 | (b & 4u) << 9;
        for (uint e = bounds[b][0] + thread; e < bounds[b][16]; e += GROUP) {
            uint word = entries[e], cell = (word >> 1 & 0x777u) + offset;
            if (!is_hidden(word))
                set_mark(cell);
        }
    }
    barrier();
    sum_marks();
}

// Finds the voxels of coarse slice s.
void collect(uint s) {
    for (uint i = gl_LocalInvocationIndex; i < 2048u; i += GROUP)
        voxels[i] = 0u;
    barrier();
    uint slice = 2u * (s & 7u);
    for (uint b = 0u; b < 4u; b++) {
        uint brick = b | s >> 3 << 2, end = bounds[brick][slice + 2u];
        for (uint e = bounds[brick][slice] + gl_LocalInvocationIndex; e < end; e += GROUP) {
            uint word = entries[e];
            uvec3 i = uvec3(word & 15u, word >> 4 & 15u, word >> 8 & 1u);
            i.xy += 16u * uvec2(b & 1u, b >> 1);
            if (!is_hidden(word))
                voxels[i.x | i.y << 5 | i.z << 10] = e + 1u;
        }
    }
    barrier();
}

// Entry + 1 of voxel k of the thread's cell; 0 = none.
uint voxel_of(uint k) {
    uvec2 i = 2u * uvec2(gl_LocalInvocationIndex & 15u, gl_LocalInvocationIndex >> 4);
    return voxels[i.x + (k & 1u) | i.y + (k >> 1 & 1u) << 5 | k >> 2 << 10];
}

// Size of voxel i over the size of its cell.
float share_of(uvec3 i) {
    vec3 share = ratio;
    for (int a = 0; rows.w != 0u && a < 3; a++)
        share[a] *= tables[rows[a] + i[a]].y / coarse_tables[coarse_rows[a] + i[a] / 2u].y;
    return share.x * share.y * share.z;
}

uint gradient_of(uint entry) {
    if (list.y == 2u)
        return widen_direction(normals[entry >> 1] >> (16u * (entry & 1u)) & 0xffffu);
    return list.y == 4u ? normals[entry] : 0u;
}

vec4 class_of(uint entry, uint gradient) {
    vec4 kind = tables[list.z + (list.x != 0u ? entries[entry] >> 12 : entry)];
    uint magnitude = gradient >> 22;
    if (list.w != 0u)
        kind.w = scale_depth(kind.w, tables[magnitude >> 2][magnitude & 3u]);
    return kind;
}

// sp_microflakes_add_normal().
void add_normal(inout Sum sum, uint gradient, float weight) {
    if (gradient == 0u)
        return;
    vec3 n = unpack_gradient(gradient), minor = MINOR * n.yxz, major = MAJOR * n.zyx;
    for (int a = 0; a < 3; a++) {
        sum.area[2 * a] += weight * abs(major[a] + minor[a]);
        sum.area[2 * a + 1] += weight * abs(major[a] - minor[a]);
    }
    sum.sided += weight;
}

// sp_microflakes_add().
void add_microflakes(inout Sum sum, uvec2 bits, float weight) {
    weight *= float(bits.y >> 16 & 255u) / 255.0;
    for (int i = 0; i < 6; i++)
        sum.area[i] += weight / 255.0 * float(bits[i >> 2] >> (8 * (i & 3)) & 255u);
    sum.sided += weight;
}

Sum add_up(uvec3 cell) {
    Sum sum = Sum(0.0, vec3(0), float[6](0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0);
    for (uint k = 0u; k < 8u; k++) {
        uint entry = voxel_of(k) - 1u;
        if (entry == 0xffffffffu)
            continue;
        uint gradient = gradient_of(entry);
        vec4 kind = class_of(entry, gradient);
        kind.w *= share_of(2u * cell + (uvec3(k, k >> 1, k >> 2) & 1u));
        sum.depth += kind.w;
        sum.color += kind.rgb * kind.w;
        if (list.y == 8u)
            add_microflakes(sum, uvec2(normals[2u * entry], normals[2u * entry + 1u]), kind.w);
        else
            add_normal(sum, gradient, kind.w);
    }
    return sum;
}

// sp_microflakes_pack().
uvec2 pack_microflakes(Sum sum) {
    uvec2 bits = uvec2(0);
    float scale = sum.sided > 0.0 ? 255.0 / sum.sided : 0.0;
    float share = sum.depth > 0.0 ? min(sum.sided / sum.depth, 1.0) * 255.0 : 0.0;
    for (int i = 0; i < 6; i++)
        bits[i >> 2] |= uint(min(sum.area[i] * scale, 255.0) + 0.5) << (8 * (i & 3));
    bits.y |= uint(share + 0.5) << 16;
    return bits;
}

// Averages values and gradients without weights of depth.
void write_scalar(uint out_entry, uvec3 cell) {
    float parts = 0.0, value = 0.0;
    vec3 gradient = vec3(0);
    for (uint k = 0u; k < 8u; k++) {
        uint entry = voxel_of(k) - 1u;
        if (entry == 0xffffffffu)
            continue;
        uint bits = gradient_of(entry);
        float part = share_of(2u * cell + (uvec3(k, k >> 1, k >> 2) & 1u)), share = float(bits >> 22) / 1023.0;
        parts += part;
        value += part * tables[list.z + (list.x != 0u ? entries[entry] >> 12 : entry)].x;
        gradient += part * share * share * unpack_gradient(bits);
    }
    coarse_tables[coarse_rows.w + out_entry] = vec4(value / parts, 0.0, 0.0, 0.0);
    if (list.y != 0u)
        microflakes[out_entry] = pack_gradient(gradient / parts);
}

void write_cell(uint out_entry, uint local, uvec3 cell) {
    coarse_entries[out_entry] = local;
    if (is_post != 0u) {
        write_scalar(out_entry, cell);
        return;
    }
    Sum sum = add_up(cell);
    float inverse = sum.depth > 0.0 ? 1.0 / sum.depth : 0.0;
    coarse_tables[coarse_rows.w + out_entry] = vec4(sum.color * inverse, sum.depth);
    if (list.y == 0u)
        return;
    uvec2 bits = pack_microflakes(sum);
    microflakes[2u * out_entry] = bits.x;
    microflakes[2u * out_entry + 1u] = bits.y;
}

// The thread's cell in each slice that has voxels.
void fill(uvec3 corner, uint first) {
    uint thread = gl_LocalInvocationIndex;
    for (uint s = 0u; s < 16u; s++) {
        if (marks_before(s << 8) == marks_before(s + 1u << 8))
            continue;
        collect(s);
        uint before;
        if (read_mark(s << 8 | thread, before))
            write_cell(first + before, s << 8 | thread, corner + uvec3(thread & 15u, thread >> 4, s));
        barrier();
    }
}

void main() {
    uint brick = first_brick + gl_WorkGroupID.x, thread = gl_LocalInvocationIndex;
    uvec3 bricks = ((dims + 1u) / 2u + 15u) / 16u;
    uvec3 at = uvec3(brick % bricks.x, brick / bricks.x % bricks.y, brick / bricks.x / bricks.y);
    clear_marks();
    compute_bounds(at);
    barrier();
    uint all_entries = 0u;
    for (uint b = 0u; b < 8u; b++)
        all_entries += bounds[b][16] - bounds[b][0];
    if (all_entries > 0u)
        mark();
    if (PASS == COUNT && thread == 0u)
        counts[brick] = all_entries > 0u ? marks_before(4096u) : 0u;
    if (PASS == FILL && all_entries > 0u)
        fill(16u * at, counts[brick]);
}
