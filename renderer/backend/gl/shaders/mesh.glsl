// SPDX-License-Identifier: Apache-2.0
// A mesh in a frame (struct constants of meshes.c), and where its corners are. Lengths in a unit that makes them near 1.

layout(std430, binding = 1) readonly buffer Mesh {
    vec4 axes[3];   // rows: mesh → camera space, and the mesh's origin there
    vec4 turn[3];    // rows: normals of the mesh → world space
    vec4 origin;     // of the mesh [its unit]
    vec4 view;       // scale, centre x, centre y [px], near; orthographic: 0
    vec4 look;       // colour of the layer, opacity
    vec4 lengths;    // unit; depths closer than this share of u2 belong together; orthographic: than this
    uvec4 mesh_kind; // the vertices have colours, number of half-spaces, of vertices
    vec4 halves[CLIP_PLANES + 1]; // a half-space keeps samples with x·a + y·b + c + inverse·d ≥ 0
};
// Three numbers of the position of each vertex, then three of each normal, then four of each colour.
layout(std430, binding = 2) readonly buffer Vertices { float vertices[]; };
layout(std430, binding = 5) readonly buffer Triangles { uint corners[]; }; // three vertices each

vec3 read_three(uint first) {
    return vec3(vertices[first], vertices[first + 1u], vertices[first + 2u]);
}

// Camera space. Precise, here and below: triangles meet at their edges only if each finds the same numbers.
vec3 compute_camera(uint vertex) {
    vec3 p = read_three(3u * vertex) - origin.xyz;
    precise vec3 u;
    for (int r = 0; r < 3; r++)
        u[r] = ((axes[r].w + axes[r].x * p.x) + axes[r].y * p.y) + axes[r].z * p.z;
    return u;
}

// Homogeneous coordinates in the image: at (x/w, y/w) px from `corner`. Also of places behind the eye.
vec3 project(vec3 u, vec2 corner) {
    bool is_perspective = choice.x != 0u;
    precise vec3 h = vec3(0, 0, is_perspective ? u.z : 1.0);
    h.xy = view.x * u.xy + (view.yz - corner) * h.z;
    return h;
}
