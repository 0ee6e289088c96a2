// SPDX-License-Identifier: Apache-2.0
// Composites the fragments that composite has left: those behind the volume, or all of them if there is none.

layout(local_size_x = GROUP) in;
layout(std430, binding = 4) buffer Image { vec4 image[]; }; // as in composite
layout(location = 0) uniform uvec2 band;                    // pixels, planes of sheets

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= band.x)
        return;
    vec4 pixel = image[i];
    open_fragments(band.y, i, band.x);
    vec4 behind = image[band.x + 2u * i]; // shares of splats behind the first of them
    next_fragment = uint(image[band.x + 2u * i + 1u].y);
    for (; next_fragment < fragment_count; next_fragment++) {
        pixel = over_fragment(pixel);
        pixel = vec4(pixel.x * (1.0 - behind.x), pixel.yzw + pixel.x * behind.yzw);
        behind = vec4(0);
    }
    image[i] = pixel;
}
