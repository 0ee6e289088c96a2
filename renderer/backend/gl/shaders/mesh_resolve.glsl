// SPDX-License-Identifier: Apache-2.0
// What triangles show in a pixel (draw/layers/mesh/resolve.c): parts, each some samples in one triangle, shaded once.

const uint VISIBLE_MAX = 16u;     // parts of a pixel; if there are more, join_neighbours() merges two of them
const float LEAST = 1.0 / 4096.0; // smaller opacities are not drawn

struct VisiblePart {
    float depth;
    vec4 color; // rgb: colour times alpha; alpha: the share of the pixel's light that the part hides
};

VisiblePart visible[VISIBLE_MAX + 1u]; // of the pixel, nearest first; the last one while one is added
uint visible_count;

// Merges the two neighbours between which another part would change the image least.
void join_neighbours() {
    float least = 3.0e38;
    uint pair = 0u;
    for (uint i = 0u; i < VISIBLE_MAX; i++) {
        float error = visible[i + 1u].color.a * (visible[i + 1u].depth - visible[i].depth);
        if (error < least) {
            least = error;
            pair = i;
        }
    }
    visible[pair].color += visible[pair + 1u].color;
    for (uint i = 1u; i < VISIBLE_MAX; i++)
        if (i > pair)
            visible[i] = visible[i + 1u];
}

void show_part(VisiblePart own) {
    uint i = visible_count;
    for (; i > 0u && own.depth < visible[i - 1u].depth; i--)
        visible[i] = visible[i - 1u];
    visible[i] = own;
    if (visible_count == VISIBLE_MAX)
        join_neighbours();
    else
        visible_count++;
}

// Adds a fragment for a group of parts. light: the share of light that the parts in front let through; it is updated.
// color: the sum of the parts' colors. depth: the sum of their depths, each times its alpha.
bool close_group(float depth, vec4 color, inout float light) {
    float alpha = color.a / light;
    if (!(light > LEAST && alpha > LEAST))
        return false;
    add_fragment(Fragment(depth / color.a * lengths.x, vec4(color.rgb / light, min(alpha, 1.0))));
    light -= color.a;
    return true;
}

// Adds the visible parts to the pixel's fragments: parts that are close to each other become one.
bool add_visible() {
    float light = 1.0, nearest = 0.0, depth = 0.0;
    vec4 color = vec4(0);
    bool has_any = false;
    for (uint i = 0u; i < visible_count && light > LEAST; i++) {
        float own = visible[i].depth;
        if (color.a > 0.0 && own - nearest > lengths.y * (choice.x != 0u ? own : 1.0)) {
            has_any = close_group(depth, color, light) || has_any;
            color = vec4(0);
            depth = 0.0;
        }
        nearest = color.a > 0.0 ? nearest : own;
        color += visible[i].color;
        depth += own * visible[i].color.a;
    }
    return close_group(depth, color, light) || has_any;
}

// How much each corner counts in the attributes on a ray, or at its start: Σ share·(way from the ray to the corner) = 0.
vec3 compute_shares(vec3 u[3], vec2 ray) {
    vec2 v[3];
    for (int k = 0; k < 3; k++)
        v[k] = u[k].xy - ray * (choice.x != 0u ? u[k].z : 1.0);
    vec3 share = vec3(v[1].x * v[2].y - v[2].x * v[1].y, v[2].x * v[0].y - v[0].x * v[2].y, v[0].x * v[1].y - v[1].x * v[0].y);
    share = clamp(share / (share.x + share.y + share.z), 0.0, 1.0);
    float total = share.x + share.y + share.z;
    return total > 0.5 ? share / total : vec3(1.0 / 3.0);
}

// The unit normal in world space: of the vertices, or else of the plane of the triangle; 0 if both have none.
vec3 compute_normal(vec3 u[3], vec3 own) {
    const float TINY = 1e-30, HUGE = 1e30;
    vec3 world = vec3(dot(turn[0].xyz, own), dot(turn[1].xyz, own), dot(turn[2].xyz, own)), plane = cross(u[1] - u[0], u[2] - u[0]);
    float square = dot(world, world);
    if (!(square > TINY && square < HUGE)) {
        world = to_camera[0].xyz * plane.x + to_camera[1].xyz * plane.y + to_camera[2].xyz * plane.z;
        square = dot(world, world);
    }
    return square > TINY && square < HUGE ? world * inversesqrt(square) : vec3(0);
}

// Colour and opacity of a triangle at a place of the image.
vec4 shade_triangle(uint number, vec2 px) {
    vec3 u[3], normal = vec3(0);
    vec4 color = vec4(0);
    uint vertex[3];
    bool is_perspective = choice.x != 0u;
    vec2 ray = (px - view.yz) / view.x;
    for (uint k = 0u; k < 3u; k++) {
        vertex[k] = corners[3u * number + k];
        u[k] = compute_camera(vertex[k]);
    }
    vec3 share = compute_shares(u, ray);
    for (uint k = 0u; k < 3u; k++) {
        uint at = 6u * mesh_kind.z + 4u * vertex[k];
        normal += share[k] * read_three(3u * mesh_kind.z + 3u * vertex[k]);
        color += share[k] * vec4(read_three(at), vertices[at + 3u]);
    }
    for (int c = 0; c < 4; c++) // NaN counts as 0
        color[c] = color[c] > 0.0 ? min(color[c], 1.0) : 0.0;
    if (mesh_kind.x == 0u)
        color.rgb = look.rgb;
    if (choice.y != 0u)
        color.rgb = shade_normal(color.rgb, compute_normal(u, normal),
                                 is_perspective ? -normalize(vec3(ray, 1.0)) : vec3(0.0, 0.0, -1.0));
    return vec4(color.rgb, color.a * look.a);
}
