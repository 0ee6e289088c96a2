// SPDX-License-Identifier: Apache-2.0
// Constants of a frame: struct gl_frame of frame.h. Lengths in cells (splat/ewa.h).

// One level of the volume, as it is or enlarged (splat/detail.h).
struct Part {
    vec4 step[3];   // rows of C
    vec4 kernel[3]; // rows of K
    vec4 view;      // scale, centre x, centre y [px], near
    vec4 footprint; // h² [px²], Mahalanobis radius, cut, peak
    vec4 bounds;    // gain, half of a flat footprint [standard deviations], largest u0/u2, u1/u2
    uvec4 kind;     // level, rectilinear
    vec4 planes[CUTS]; // that clip: unit normal in camera space, offset
};

struct Light {
    vec4 direction, world, color; // unit, in camera space and in the world's
};

layout(std430, binding = 0) readonly buffer Frame {
    Part parts[PARTS];
    vec4 to_camera[3]; // rows of W
    vec4 phong;        // ambient, diffuse, specular, exponent
    vec4 glint;        // width, gain
    Light lights[8];
    uvec4 choice;  // perspective, lit, lights, sheets of the frame
    uvec4 picture; // width, height [px], axis of the sheets, clipping planes
    uvec4 compose; // enum sp_compositing, post-classified
    vec4 slabs;    // distance where layer 0 begins, thickness of a layer
    vec4 lens;     // the camera's scale, centre x, centre y [px]
    uint layers[]; // by sheet of the finest level: its place front to back
};
