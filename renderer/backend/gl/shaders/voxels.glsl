// SPDX-License-Identifier: Apache-2.0
// The splats of the voxels of a shell, or of vectors: STREAKS (draw/layers/splat_list/set_up.c and streak.h).

layout(std430, binding = 2) readonly buffer Voxels { uint voxels[]; }; // struct sp_voxel, front to back

const float FLAT_NEAR = 0.7; // SP_FLAT_NEAR of splat/outline.h
const uint VOXEL_WORDS = 6u, ROW_WORDS = 2u, OPAQUE = 64u;

// Places a voxel; size: its local spacing [mean spacings].
void locate(uvec3 i, out vec3 u, out vec3 size) {
    vec3 at = vec3(i);
    size = vec3(1);
    for (uint a = 0u; a < 3u && kind.z != 0u; a++) {
        uint row = ROW_WORDS * (rows[a] + i[a]);
        at[a] = uintBitsToFloat(layer_words[row]);
        size[a] = uintBitsToFloat(layer_words[row + 1u]);
    }
    for (int r = 0; r < 3; r++)
        u[r] = steps[r].w + dot(steps[r].xyz, at);
}

#if STREAKS
// How much longer than a mean cell the cell of a rectilinear grid is along a direction in camera space, which may be 0.
float compute_length(vec3 direction, vec3 size) {
    if (kind.z == 0u || dot(direction, direction) < 0.5)
        return 1.0;
    vec3 along = direction * inverse(mat3(kernel[0].xyz, kernel[1].xyz, kernel[2].xyz));
    return sqrt(dot(along, along) / dot(along / size, along / size));
}
#endif

// Writes the outline and its box; returns |det J| times the footprint's value at its centre, or 0 if it is not drawn.
float outline(vec3 u, vec3 k[3], vec3 direction, vec3 size, inout Splat s, out vec4 box) {
    Footprint f = compute_footprint(u, k, kind.x != 0u ? VARIANCE_MIN : filter_of.x);
#if STREAKS
    stretch(u, k[2], direction, compute_length(direction, size), f, s);
#endif
    if (!(f.det < 1e36))
        return 0.0;
    if (kind.x != 0u) {
        vec2 reach = max(bounds.z * sqrt(f.variance.xz), vec2(0.5));
        float gain = f.gain / (4.0 * reach.x * reach.y);
        if (is_perspective)
            reach = min(reach, max(view.x / u.z * min(FLAT_NEAR * length(u), max(u.z - view.w, 0.0)), 0.5));
        box = s.place = ceil(vec4(f.at - reach, f.at + reach) - 0.5);
        area = 4.0 * reach.x * reach.y;
        return gain;
    }
    box = set_ellipse(f, filter_of.y, s);
    return f.gain * filter_of.w / sqrt(f.det);
}

// The optical depth at the centre.
float compute_depth(float depth, bool is_opaque, float gain) {
    float over_cell = depth * bounds.w, least = is_opaque ? cell.y : 0.0;
    return min(kind.x != 0u ? max(over_cell * gain, least) : max(over_cell, least) * gain, DEPTH_MAX);
}

// Sets up voxel i of the order. False if it is not drawn.
bool set_up(uint i, out Splat s, out vec4 box) {
    uint w = VOXEL_WORDS * i, w0 = voxels[w], w1 = voxels[w + 1u], w3 = voxels[w + 3u];
    vec3 u, size, k[3], direction = vec3(0);
    locate(uvec3(w0 & 0xffffu, w0 >> 16, w1 & 0xffffu), u, size);
    for (int r = 0; r < 3; r++)
        k[r] = kernel[r].xyz * size;
    bool is_close = STREAKS == 0 && kind.x == 0u && may_be_close(u, k, filter_of.y, filter_of.x);
    if (!((u.z >= view.w || is_close) && u.z < 1e18))
        return false;
#if STREAKS
    vec3 world = unpack_gradient(voxels[w + 2u]);
    direction = vec3(dot(streak_axes[0].xyz, world), dot(streak_axes[1].xyz, world), dot(streak_axes[2].xyz, world));
    if (streaks.w == 0.0 && voxels[w + 2u] >> 22 == 0u) // nothing is drawn where there is no vector
        return false;
#endif
    float gain = outline(u, k, direction, size, s, box);
#if !STREAKS
    s.shape.z = 0.0;
    if (is_close && !place_close(make_kernel(u, k, filter_of.x), k, filter_of.x, filter_of.y, true, s, box, gain))
        return false;
#endif
    if (!(gain > 0.0))
        return false;
    s.shape.y = compute_depth(uintBitsToFloat(voxels[w + 5u]), (w1 >> 16 & OPAQUE) != 0u, gain * size.x * size.y * size.z);
    vec3 color = vec3(w3 & 0xffffu, w3 >> 16, voxels[w + 4u] & 0xffffu) / 65535.0;
#if STREAKS
    set_phase(voxels[w + 4u] >> 16, s);
#else
    if (choice.y != 0u)
        color = shade_normal(color, unpack_gradient(voxels[w + 2u]), is_perspective ? -normalize(u) : vec3(0.0, 0.0, -1.0));
#endif
    s.color = vec4(color, u.z);
    return true;
}
