// SPDX-License-Identifier: Apache-2.0
// Constants of a shell or of vectors (struct constants of voxel_layers.c), and the splats of its voxels (voxels/set_up.c and
// streak.h). Lengths in cells. STREAKS: of vectors.

layout(std430, binding = 1) readonly buffer Layer {
    vec4 steps[3];  // rows of C, base of u
    vec4 kernel[3]; // rows of K
    vec4 view;      // scale, centre x, centre y [px], near
    vec4 filter_of; // h² [px²], Mahalanobis radius, cut, peak
    vec4 bounds;    // largest u0/u2, u1/u2; half of a flat footprint [standard deviations], gain
    vec4 cell;      // unit, least depth of opaque voxels, depth within which splats become one fragment, reach of a kernel
    uvec4 kind;     // flat, linear attenuation, rectilinear, columns of tiles
    uvec4 words;    // first word of entries, coordinates
    uvec4 rows[3];  // by axis: first row of coordinates
    vec4 streak_axes[3]; // STREAKS: world → camera space
    vec4 streaks;      // the same: σ²·(stretch² − 1), length of a period, phase, 1 = blends
    vec4 streak_color; // the same, of style blend
    // entries.glsl, with voxels for blocks; coordinates: place and local spacing of each sample.
    uint layer_words[];
};
layout(std430, binding = 2) readonly buffer Voxels { uint voxels[]; }; // struct sp_voxel, front to back

const uint VOXEL_WORDS = 6u, ROW_WORDS = 2u, OPAQUE = 64u;
const float VARIANCE_MIN = 1e-6, DEPTH_MAX = 1e6, LOG2E = 1.44269504;

bool is_perspective;

struct Splat {
    vec4 place; // x, y, a, b; flat: its box, columns [x, z) and rows [y, w)
    vec4 color; // shaded; u2
    vec2 shape; // c, optical depth at the centre
#if STREAKS
    vec4 turn;  // the map from pixels to standard deviations along and across the vector, row by row
    vec4 wave;  // periods per standard deviation, contrast, shift of rows [rows], phase [periods]
#endif
};

// Places a voxel; size: its local spacing [mean spacings].
void locate(uvec3 i, out vec3 u, out vec3 size) {
    vec3 at = vec3(i);
    size = vec3(1);
    for (uint a = 0u; a < 3u && kind.z != 0u; a++) {
        uint row = words.y + ROW_WORDS * (rows[a].x + i[a]);
        at[a] = uintBitsToFloat(layer_words[row]);
        size[a] = uintBitsToFloat(layer_words[row + 1u]);
    }
    for (int r = 0; r < 3; r++)
        u[r] = steps[r].w + dot(steps[r].xyz, at);
}

// Is a splat there that may touch the square of TILE × TILE px at `corner`?
bool is_near(vec3 u, vec3 size, vec2 corner) {
    if (!(u.z >= view.w && u.z < 1e18))
        return false;
    float scale = is_perspective ? view.x / u.z : view.x, half_side = 0.5 * float(TILE);
    float reach = cell.w * max(max(size.x, size.y), size.z) * scale + filter_of.y * sqrt(filter_of.x) + 1.0;
    return all(lessThan(abs(view.yz + scale * u.xy - corner - half_side), vec2(half_side + reach)));
}

#if STREAKS
// The outline of a kernel that is stretched along a direction, which may be 0, and its pattern (voxels/streak.h).
void stretch(vec3 u, vec3 direction, inout vec3 v, inout float det, inout Splat s) {
    const float TINY = 1e-12, SHORTEST = 0.33;
    float inverse = is_perspective ? 1.0 / u.z : 1.0;
    vec2 ratio = is_perspective ? clamp(u.xy * inverse, -bounds.xy, bounds.xy) : vec2(0);
    vec2 e = view.x * inverse * (direction.xy - ratio * direction.z);
    det += streaks.x * (v.z * e.x * e.x - 2.0 * v.y * e.x * e.y + v.x * e.y * e.y);
    v += streaks.x * vec3(e.x * e.x, e.x * e.y, e.y * e.y);
    float l00 = inversesqrt(v.x), l10 = v.y * l00, l11 = inversesqrt(max(v.z - l10 * l10, TINY));
    l10 *= -l00 * l11;
    vec2 w = vec2(l00 * e.x, l10 * e.x + l11 * e.y);
    float size = length(w);
    w = size > TINY ? w / size : vec2(1.0, 0.0);
    s.turn = vec4(w.x * l00 + w.y * l10, w.y * l11, w.x * l10 - w.y * l00, w.x * l11);
    float rows = 1.0 / max(length(s.turn.zw), TINY) - 1.0;
    bool is_still = dot(direction, direction) < 0.5;
    s.wave.xy = vec2(1.0 / max(streaks.y * size, SHORTEST), is_still ? 0.0 : clamp(rows, 0.0, 1.0));
}
#endif

// Writes the outline; returns |det J| times the footprint's value at its centre, or 0 if it is not drawn (splat/outline.h).
float outline(vec3 u, vec3 k[3], vec3 direction, inout Splat s) {
    float inverse = is_perspective ? 1.0 / u.z : 1.0, f = view.x * inverse, h2 = kind.x != 0u ? VARIANCE_MIN : filter_of.x;
    vec2 ratio = is_perspective ? clamp(u.xy * inverse, -bounds.xy, bounds.xy) : vec2(0);
    vec3 m0 = f * (k[0] - ratio.x * k[2]), m1 = f * (k[1] - ratio.y * k[2]), area = cross(m0, m1);
    vec2 at = view.yz + view.x * (u.xy * inverse), v = vec2(dot(m0, m0), dot(m1, m1)) + h2;
    float det = dot(area, area) + h2 * (v.x + v.y - h2), gain = f * f * sqrt(1.0 + dot(ratio, ratio));
    if (!(det < 1e36))
        return 0.0;
    if (kind.x != 0u) {
        vec2 reach = max(bounds.z * sqrt(v), vec2(0.5));
        s.place = ceil(vec4(at - reach, at + reach) - 0.5);
        return gain / (4.0 * reach.x * reach.y);
    }
    vec3 variance = vec3(v.x, dot(m0, m1), v.y);
#if STREAKS
    stretch(u, direction, variance, det, s);
    if (!(det < 1e36))
        return 0.0;
#endif
    vec3 conic = 0.5 * LOG2E / det * vec3(variance.z, -2.0 * variance.y, variance.x);
    s.place = vec4(at, conic.xy);
    s.shape.x = conic.z;
    return gain * filter_of.w / sqrt(det);
}

// The optical depth at the centre.
float find_depth(float depth, bool is_opaque, float gain) {
    float over_cell = depth * bounds.w, least = is_opaque ? cell.y : 0.0;
    return min(kind.x != 0u ? max(over_cell * gain, least) : max(over_cell, least) * gain, DEPTH_MAX);
}

// Half of the extent of a splat in pixels, with some to spare.
vec2 reach_of(Splat s) {
    float det = max(4.0 * s.place.z * s.shape.x - s.place.w * s.place.w, 1e-30);
    return sqrt(filter_of.z * 4.0 * vec2(s.shape.x, s.place.z) / det) + 0.01;
}

// Sets up voxel i of the order. False if it does not touch the square of TILE × TILE px at `corner`.
bool set_up(uint i, vec2 corner, out Splat s) {
    uint w = VOXEL_WORDS * i, w0 = voxels[w], w1 = voxels[w + 1u], w3 = voxels[w + 3u];
    vec3 u, size, k[3];
    locate(uvec3(w0 & 0xffffu, w0 >> 16, w1 & 0xffffu), u, size);
    if (!is_near(u, size, corner))
        return false;
    for (int r = 0; r < 3; r++)
        k[r] = kernel[r].xyz * size;
    vec3 direction = vec3(0);
#if STREAKS
    vec3 world = unpack_gradient(voxels[w + 2u]);
    direction = vec3(dot(streak_axes[0].xyz, world), dot(streak_axes[1].xyz, world), dot(streak_axes[2].xyz, world));
    if (streaks.w == 0.0 && voxels[w + 2u] >> 22 == 0u) // nothing is drawn where there is no vector
        return false;
#endif
    float gain = outline(u, k, direction, s);
    vec2 low = s.place.xy, high = s.place.zw;
    if (kind.x == 0u) {
        low = s.place.xy - reach_of(s);
        high = s.place.xy + reach_of(s);
    }
    if (!(gain > 0.0 && all(lessThan(low, corner + float(TILE))) && all(lessThan(corner, high))))
        return false;
    s.shape.y = find_depth(uintBitsToFloat(voxels[w + 5u]), (w1 >> 16 & OPAQUE) != 0u, gain * size.x * size.y * size.z);
    vec3 color = vec3(w3 & 0xffffu, w3 >> 16, voxels[w + 4u] & 0xffffu) / 65535.0;
#if STREAKS
    uint phase = voxels[w + 4u] >> 16;
    s.wave.zw = vec2(float(phase * 40503u >> 8 & 255u) / 256.0, float(phase) / 65536.0 + streaks.z);
#else
    if (choice.y != 0u)
        color = shade_normal(color, unpack_gradient(voxels[w + 2u]), is_perspective ? -normalize(u) : vec3(0.0, 0.0, -1.0));
#endif
    s.color = vec4(color, u.z);
    return true;
}
