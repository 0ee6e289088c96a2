// SPDX-License-Identifier: Apache-2.0
// Pixels that a side of the silhouette crosses (draw/resample/cover.c): how much of their area is inside, and where their
// rays go.

bool is_crossed; // a side crosses the block
float cover;     // part of the pixel's area inside

// Sets `cover`, and returns how far the ray of the pixel moves from its centre.
vec2 cover_pixel(vec2 centre, bool is_level) {
    const vec4 LINES = vec4(-0.375, -0.125, 0.125, 0.375); // across the pixel
    vec4 low = vec4(-0.5), high = vec4(0.5);
    for (uint i = 0u; i < size.z; i++) {
        vec3 line = sides[i].xyz;
        vec2 side = is_level ? line.yx : line.xy;
        float inverse = -1.0 / (abs(side.x) < 1e-6 ? 1e-6 : side.x);
        vec4 end = (dot(line.xy, centre) + line.z + side.y * LINES) * inverse;
        low = inverse < 0.0 ? max(low, end) : low;
        high = inverse < 0.0 ? high : min(high, end);
    }
    vec4 inside = max(high - low, 0.0);
    float area = dot(inside, vec4(1.0));
    vec2 moved = vec2(dot(inside, 0.5 * (low + high)), dot(inside, LINES)) / max(area, 1e-6);
    cover = 0.25 * area;
    return is_level ? moved.yx : moved;
}

// Opens a pixel of the block at `corner` px: sets is_crossed and `cover`, and returns where the ray crosses the image.
vec2 open_cover(vec2 corner, vec2 centre) {
    const float REACH = 0.70710678 * float(TILE); // half a diagonal
    vec2 middle = corner + 0.5 * float(TILE);
    float least = 1e30, nearest = 1e30;
    bool is_level = false; // the nearest side rises more across than along the x axis
    for (uint i = 0u; i < size.z; i++) {
        vec3 line = sides[i].xyz;
        float far = abs(dot(line.xy, centre) + line.z);
        least = min(least, dot(line.xy, middle) + line.z);
        is_level = far < nearest ? abs(line.x) < abs(line.y) : is_level;
        nearest = min(nearest, far);
    }
    is_crossed = abs(least) < REACH;
    cover = 1.0;
    for (uint i = is_crossed ? 1u : 0u; i > 0u; i--) // once: software GL computes both sides of a condition
        centre += cover_pixel(centre, is_level);
    return centre;
}
