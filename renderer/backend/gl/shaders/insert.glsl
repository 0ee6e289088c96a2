// SPDX-License-Identifier: Apache-2.0
// Fragments inside of sheets, slabs and splats, which they divide (draw/footprints/insert.c).

// Sheets: slice i of the grid lies between the planes normal·u = offset[i] and offset[i + 1] of camera space; offsets rise
// and begin the buffer of fragments. The other layers are ranges of distance.
layout(location = 6) uniform vec4 sheet_planes; // normal, how many
// Distance where layer 0 begins, thickness; splats: most that a kernel reaches along the ray, a cell [world unit].
layout(location = 7) uniform vec4 ranges;

const uint NO_LAYER = 0xffffffffu;

// That the next fragment lies in, or the first one behind it; splats: the first one that it does not divide; NO_LAYER =
// there is none.
uint next_layer;
float next_share; // of that layer in front of it; splats: its distance from the near face of layer 0 [cells]

void place_in_sheets(vec3 ray, vec3 point) {
    float at = dot(sheet_planes.xyz, point);
    bool is_falling = dot(sheet_planes.xyz, ray) < 0.0;
    uint planes = uint(sheet_planes.w), low = 0u, high = planes;
    while (low < high) { // the first plane beyond the point
        uint middle = low + (high - low) / 2u;
        bool is_before = uintBitsToFloat(fragment_words[middle]) <= at;
        low = is_before ? middle + 1u : low;
        high = is_before ? high : middle;
    }
    if (low == 0u || low == planes) {
        bool is_behind = (low == 0u) == is_falling;
        next_layer = is_behind ? NO_LAYER : layers[low == 0u ? 0u : planes - 2u];
        return;
    }
    float before = at - uintBitsToFloat(fragment_words[low - 1u]), behind = uintBitsToFloat(fragment_words[low]) - at;
    next_layer = layers[low - 1u];
    next_share = (is_falling ? behind : before) / (before + behind);
}

// `next`: depth of the one behind it.
void place_fragment(vec2 px, float depth, float next) {
    bool is_perspective = choice.x != 0u;
    vec2 aside = (px - lens.yz) / lens.x;
    vec3 ray = vec3(is_perspective ? aside : vec2(0), 1.0);
    if (compositing == COMPOSITE_SHEET) {
        place_in_sheets(ray, vec3(is_perspective ? aside * depth : aside, depth));
        return;
    }
    float distance = depth * length(ray) - ranges.x;
    if (compositing == COMPOSITE_SPLAT) {
        float end = min(distance + ranges.z, 0.5 * (distance + next * length(ray) - ranges.x));
        next_layer = uint(max(ceil(end / ranges.y - 0.5), 0.0));
        next_share = distance / ranges.w;
        return;
    }
    float number = max(distance / ranges.y, 0.0);
    next_layer = uint(floor(number));
    next_share = number - floor(number);
}

void set_next(vec2 px, uint i) {
    next_fragment = i;
    next_layer = NO_LAYER;
    next_share = compositing == COMPOSITE_SPLAT ? 1e30 : 0.0;
    if (i < fragment_count)
        place_fragment(px, fragment_depth(i), i + 1u < fragment_count ? fragment_depth(i + 1u) : 1e30);
}
