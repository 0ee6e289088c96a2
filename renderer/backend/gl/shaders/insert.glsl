// SPDX-License-Identifier: Apache-2.0
// Fragments between sheets, slabs and splats (tile/insert.c): each is composited before the first layer whose middle is
// behind it.

// Sheets: slice i of the grid lies on the plane normal·u = offset[i] of camera space; offsets rise and begin the buffer of
// fragments. The other layers are ranges of distance.
layout(location = 6) uniform vec4 sheet_planes; // normal, how many
layout(location = 7) uniform vec2 ranges;       // distance where layer 0 begins, thickness [world unit]

const uint NO_LAYER = 0xffffffffu;

uint next_layer; // the first layer behind the next fragment; NO_LAYER = there is none

// The first sheet behind a point of a ray: of the slices that the ray crosses from there on.
uint sheet_behind(vec3 ray, vec3 point) {
    float at = dot(sheet_planes.xyz, point);
    uint low = 0u, high = uint(sheet_planes.w);
    while (low < high) {
        uint middle = low + (high - low) / 2u;
        bool is_before = uintBitsToFloat(fragment_words[middle]) < at;
        low = is_before ? middle + 1u : low;
        high = is_before ? high : middle;
    }
    if (dot(sheet_planes.xyz, ray) < 0.0)
        return low > 0u ? layers[low - 1u] : NO_LAYER;
    return low < uint(sheet_planes.w) ? layers[low] : NO_LAYER;
}

uint layer_behind(vec2 px, float depth) {
    bool is_perspective = choice.x != 0u;
    vec2 aside = (px - lens.yz) / lens.x;
    vec3 ray = vec3(is_perspective ? aside : vec2(0), 1.0);
    if (compositing == COMPOSITE_SHEET)
        return sheet_behind(ray, vec3(is_perspective ? aside * depth : aside, depth));
    return uint(max(ceil((depth * length(ray) - ranges.x) / ranges.y - 0.5), 0.0));
}

void set_next(vec2 px, uint i) {
    next_fragment = i;
    next_layer = i < fragment_count ? layer_behind(px, fragment_depth(i)) : NO_LAYER;
}

// Composites the fragments in front of the middle of a layer.
vec4 insert_before(vec2 px, uint layer, vec4 pixel) {
    while (next_layer <= layer) {
        pixel = over_fragment(pixel);
        set_next(px, next_fragment + 1u);
    }
    return pixel;
}
