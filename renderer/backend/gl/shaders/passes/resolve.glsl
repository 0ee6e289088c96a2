// SPDX-License-Identifier: Apache-2.0
// Composited pixels over the background → the frame's format (frame/resolve.h).

layout(local_size_x = GROUP) in;
layout(std430, binding = 1) readonly buffer Image { vec4 image[]; };
layout(std430, binding = 2) writeonly buffer Pixels { uint pixels[]; };
layout(location = 0) uniform uvec2 format; // pixels, as floats
layout(location = 1) uniform vec4 background;
layout(location = 2) uniform uint first; // element of the image
layout(location = 3) uniform vec2 depth; // 1 = depth and spread follow the pixels; from where depths count

// Writes depth and spread (frame/depth.h). The moments are the image's last elements; of a sum of passes, zw.
void resolve_depth(uint i, float opacity) {
    const float LEAST = 1.0 / 1024.0; // SP_DEPTH_ALPHA_MIN
    vec4 moments = image[3u * format.x + i];
    vec2 own = (first != 0u ? moments.zw : moments.xy) / max(opacity, LEAST);
    bool shows = opacity >= LEAST;
    uint at = (format.y != 0u ? 4u : 1u) * format.x + i;
    pixels[at] = shows ? floatBitsToUint(depth.y + own.x) : 0x7f800000u; // infinity
    pixels[at + format.x] = floatBitsToUint(shows ? sqrt(max(own.y - own.x * own.x, 0.0)) : 0.0);
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= format.x)
        return;
    vec4 pixel = image[first + i];
    if (depth.x != 0.0)
        resolve_depth(i, 1.0 - pixel.x);
    float share = pixel.x * background.a, alpha = 1.0 - pixel.x + share;
    vec4 color = vec4(pixel.yzw + share * background.rgb, alpha);
    if (format.y != 0u) {
        for (uint c = 0u; c < 4u; c++)
            pixels[4u * i + c] = floatBitsToUint(color[c]);
        return;
    }
    color.rgb *= alpha > 1e-6 ? 1.0 / alpha : 0.0;
    uvec4 bytes = uvec4(clamp(color, 0.0, 1.0) * 255.0 + 0.5);
    pixels[i] = bytes.r | bytes.g << 8 | bytes.b << 16 | bytes.a << 24;
}
