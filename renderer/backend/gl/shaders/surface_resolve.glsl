// SPDX-License-Identifier: Apache-2.0
// From a sheet of a surface to what it shows of a pixel (draw/layers/surface/resolve.c).

const float FULL = 0.94, LEAST = 1.0 / 4096.0; // weight of a covered pixel; smaller coverage is not drawn

// The ray of a pixel: u = depth·ray in perspective, (ray.x, ray.y, depth) else.
vec2 compute_ray(vec2 px) {
    return (px - view.yz) / view.x;
}

// A sheet as a plane sees it: distance from the plane, positive where it keeps; how much that changes per pixel.
vec2 cross_plane(vec4 plane, vec2 ray, float depth, vec3 n) {
    float across = n.z, along = plane.z, value = dot(plane.xyz, vec3(ray, depth)) - plane.w;
    if (is_perspective) {
        across = dot(n, vec3(ray, 1.0));
        along = dot(plane.xyz, vec3(ray, 1.0));
        value = depth * along - plane.w;
    }
    // A sheet that is seen from its side changes by as much as one at 85°.
    float bound = max(0.08 * length(n), 1e-20);
    across = across < 0.0 ? min(across, -bound) : max(across, bound);
    float change = length(plane.xy - along * n.xy / across);
    return vec2(value, max(change * (is_perspective ? depth : 1.0) / view.x, 1e-20));
}

// How much a plane keeps of the pixel.
float keep(vec2 crossing) {
    return clamp(crossing.x / crossing.y + 0.5, 0.0, 1.0);
}

// The share of the pixel that clipping keeps of a sheet.
float clip_share(vec2 px, float depth, vec3 n) {
    vec2 ray = compute_ray(px);
    float share = 1.0;
    for (uint i = 0u; i < plane_counts.x; i++)
        share *= keep(cross_plane(clip[i], ray, depth, n));
    return kind.y != 0u ? share * keep(cross_plane(vec4(0.0, 0.0, 1.0, view.w), ray, depth, n)) : share;
}

// Variance of the flat kernel along a direction.
float kernel_variance(vec3 direction, vec3 n) {
    vec3 k = vec3(0), q = vec3(0);
    for (int r = 0; r < 3; r++) {
        k += direction[r] * kernel[r].xyz;
        q += n[r] * kernel[r].xyz;
    }
    float mixed = dot(k, q);
    return dot(k, k) - sheet_of.x * (2.0 - sheet_of.x) * mixed * mixed / (dot(q, q) + 1e-30);
}

// Raises the weight beside borders of the volume, where kernels are missing, and cuts the surface there.
float end_at_borders(vec2 px, float depth, vec3 n, float weight, inout float share) {
    vec2 ray = compute_ray(px);
    float size = disc_size(depth * length(vec3(ray, 1)));
    for (uint i = 0u; i < plane_counts.y; i++) {
        vec2 crossing = cross_plane(borders[i], ray, depth, n);
        if (!(crossing.x < bounds.z + 4.0 * crossing.y))
            continue;
        float variance = kernel_variance(borders[i].xyz, n) * size * size + filter_of.x * crossing.y * crossing.y;
        weight /= max(normal_share(crossing.x / sqrt(max(variance, 1e-12))), 0.2);
        share *= keep(crossing);
    }
    return weight;
}

float cover(float weight) {
    return weight < 0.5 ? weight : min(0.5 + (weight - 0.5) * (0.5 / (FULL - 0.5)), 1.0);
}

// A sheet of a pixel.
struct Resolved {
    float depth, coverage;
    vec3 color;
    uint side; // 1 = seen from inside
};

Resolved resolve(vec2 px, float weight, float depth_sum, vec3 normal_sum) {
    Resolved to = Resolved(0.0, 0.0, look.rgb, 0u);
    if (!(weight > LEAST))
        return to;
    float side = length(normal_sum), share = 1.0;
    vec3 n = side > weight * 1e-3 ? normal_sum / max(side, 1e-30) : vec3(0);
    to.depth = depth_sum / weight + sheet_of.w;
    weight = end_at_borders(px, to.depth, n, weight, share);
    to.coverage = cover(weight) * share * clip_share(px, to.depth, n);
    if (choice.y != 0u) {
        vec3 to_eye = -normalize(vec3(is_perspective ? compute_ray(px) : vec2(0), 1.0));
        to.color = shade_facing(to.color, n, any(notEqual(n, vec3(0))), to_eye);
    }
    return to;
}

// The rays of a pixel by where they are: their share of all rays, and the light that comes through along them to the eye, as a
// share of all light. Rays that have not met a sheet may be outside of the body or, behind a cut, inside.
vec2 rays[3];
const uint OUTSIDE = 0u, INSIDE = 1u, UNKNOWN = 2u;

// Takes rays that cover at most `share` of the pixel.
vec2 spend_rays(uint place, float share) {
    float most = max(share, 0.0);
    vec2 from = rays[place], taken = from * (most < from.x ? most / from.x : 1.0);
    rays[place] = from - taken;
    return taken;
}

// Lets rays cross a sheet: first rays on its near side, then rays of unknown place. If these are fewer than the sheet covers, a
// sheet before it is missing, and other rays cross. Returns the light that the sheet hides.
float cross_sheet(uint side, float coverage) {
    vec2 crossing = spend_rays(side, coverage);
    crossing += spend_rays(UNKNOWN, coverage - crossing.x);
    crossing += spend_rays(1u - side, coverage - crossing.x);
    rays[1u - side] += crossing * vec2(1.0, 1.0 - look.w);
    return look.w * crossing.y;
}
