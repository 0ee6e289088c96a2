// SPDX-License-Identifier: Apache-2.0
// Counts on which tiles of the band the triangles of a mesh lie. One thread per triangle.

layout(local_size_x = GROUP) in;

layout(location = 1) uniform uvec4 batch; // first triangle, triangles, width of the image [px]; 1 = they are counted as drawn

const float FAR_AWAY = 1e30;

void add_place(vec3 h, inout vec2 low, inout vec2 high) {
    low = min(low, h.xy / h.z);
    high = max(high, h.xy / h.z);
}

// The tiles that a triangle's part beyond the near plane touches.
uvec2 compute_span(uint number) {
    vec2 low = vec2(FAR_AWAY), high = -low, rows = vec2(tiles.yz), bounds;
    vec3 h[3];
    for (uint k = 0u; k < 3u; k++) {
        h[k] = project(compute_camera(corners[3u * number + k]), vec2(0));
        if (!(dot(abs(h[k]), vec3(1)) < FAR_AWAY))
            return NOWHERE;
    }
    for (int k = 0; k < 3; k++) {
        vec3 from = h[k], to = h[(k + 1) % 3];
        if (from.z >= view.w)
            add_place(from, low, high);
        if ((from.z >= view.w) != (to.z >= view.w))
            add_place(vec3(mix(from.xy, to.xy, (view.w - from.z) / (to.z - from.z)), view.w), low, high);
    }
    vec2 end = vec2(float(batch.z), rows.y);
    if (!(low.x < end.x && low.y < end.y && high.x >= 0.0 && high.y >= rows.x))
        return NOWHERE;
    if (batch.w != 0u)
        count_splat(0u, low.y >= rows.x || tiles.y == 0u);
    low = max(low, vec2(0.0, rows.x));
    high = min(high, end - 1.0);
    return bound_tiles(ivec2(low), ivec2(high) + 1, uvec2(0));
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    uvec2 bits = NOWHERE;
    begin_counts();
    barrier();
    if (i < batch.y)
        spans[i] = bits = bound(compute_span(batch.x + i));
    end_counts(bits);
}
