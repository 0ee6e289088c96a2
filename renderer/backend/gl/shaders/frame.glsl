// SPDX-License-Identifier: Apache-2.0
// Constants of a frame: struct gl_constants of frame.h. Lengths in cells (splat/ewa.h).

// One level of the volume, in its own size or enlarged (splat/detail.h).
struct Part {
    vec4 step[3];   // rows of C; u of the voxel `origin`
    vec4 kernel[3]; // rows of K; adaptive: R·u2 of the smallest kernel · c_min, of the largest · c_max, r_h [px]
    vec4 view;      // scale, centre x, centre y [px], near
    vec4 footprint; // h² [px²], Mahalanobis radius, cut, peak
    vec4 bounds;    // gain, half of a flat footprint [standard deviations], largest u0/u2, u1/u2
    uvec4 kind;     // level, rectilinear, bricks along axes 0 and 1
    uvec4 rows;     // of the tables, by rectilinear axis: of sample 0; then enum sp_filter_mode
    uvec4 dims;     // voxels per axis
    uvec4 origin;   // first voxel of the brick nearest to the eye
};

struct Light {
    vec4 direction, world, color; // unit vectors in camera and in world space
};

layout(std430, binding = 0) readonly buffer Frame {
    vec4 to_camera[3]; // rows of W
    vec4 phong;        // ambient, diffuse, specular, exponent
    vec4 glint;        // width, gain
    uvec4 choice;  // perspective, lit, lights, sheets of the frame
    uvec4 image_info; // width, height [px], axis of the sheets, clipping planes
    uvec4 compose; // enum sp_compositing, post-classified, records have depths
    vec4 slabs;    // distance where layer 0 begins, thickness of a layer
    vec4 lens;     // the camera's scale, centre x, centre y [px]
    Light lights[LIGHTS];
    Part parts[PARTS];
    vec4 planes[PARTS * CLIP_PLANES]; // clipping planes by part: unit normal in camera space, offset
    uint layers[]; // by sheet of the finest level: its layer, front to back
};
