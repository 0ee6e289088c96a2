// SPDX-License-Identifier: Apache-2.0
// Phong's model (derivation: splat/shade.h), for a voxel with a gradient and for a cell of a coarser level with
// microflakes.

const float FLAKES_MINOR = 0.525731112, FLAKES_MAJOR = 0.850650808;

float highlight(vec3 n, vec3 h) {
    float length2 = dot(h, h), along = abs(dot(n, h));
    if (!(length2 > 1e-12 && along > 1e-6))
        return 0.0;
    return exp2(phong.w * log2(along * along / length2) * 0.5);
}

// n: in camera space.
vec3 shade_facing(vec3 color, vec3 n, bool has_side, vec3 to_eye) {
    vec3 lit = vec3(phong.x), shine = vec3(0);
    for (uint i = 0u; i < choice.z; i++) {
        vec3 l = lights[i].direction.xyz, strength = lights[i].color.rgb;
        lit += phong.y * strength * (has_side ? abs(dot(n, l)) : 1.0);
        if (has_side)
            shine += phong.z * strength * highlight(n, l + to_eye);
    }
    return color * lit + shine;
}

vec3 shade_normal(vec3 color, vec3 world, vec3 to_eye) {
    vec3 n = vec3(dot(to_camera[0].xyz, world), dot(to_camera[1].xyz, world),
                  dot(to_camera[2].xyz, world));
    return shade_facing(color, n, any(notEqual(world, vec3(0))), to_eye);
}

// A symmetric matrix: diagonal (xx, yy, zz), rest (xy, xz, yz).
float quadratic(vec3 diagonal, vec3 rest, vec3 v) {
    return v.x * (diagonal.x * v.x + 2.0 * (rest.x * v.y + rest.y * v.z)) +
           v.y * (diagonal.y * v.y + 2.0 * rest.z * v.z) + diagonal.z * v.z * v.z;
}

float microflakes_area(uvec2 microflakes, uint i) {
    float area = float(microflakes[i >> 2] >> (8u * (i & 3u)) & 255u) / 255.0;
    return area * area;
}

// S of the microflakes (classify/microflakes.h).
void microflakes_matrix(uvec2 microflakes, out vec3 diagonal, out vec3 rest) {
    const float minor = 1.25 * FLAKES_MINOR * FLAKES_MINOR;
    const float major = 1.25 * FLAKES_MAJOR * FLAKES_MAJOR;
    const float mixed = 1.25 * FLAKES_MINOR * FLAKES_MAJOR;
    vec3 a = vec3(microflakes_area(microflakes, 0u), microflakes_area(microflakes, 2u), microflakes_area(microflakes, 4u));
    vec3 b = vec3(microflakes_area(microflakes, 1u), microflakes_area(microflakes, 3u), microflakes_area(microflakes, 5u));
    vec3 sum = a + b;
    diagonal = minor * sum.yxz + major * sum.zyx - 0.25 * (sum.x + sum.y + sum.z);
    rest = mixed * (a - b).yzx;
}

vec3 shade_microflakes(vec3 color, uvec2 microflakes, vec3 to_eye) {
    vec3 s, s_rest;
    microflakes_matrix(microflakes, s, s_rest);
    float sided = float(microflakes.y >> 16 & 255u) / 255.0, inverse = 1.0 / max(s.x + s.y + s.z, 1e-6);
    vec3 t = s * inverse, t_rest = s_rest * inverse, v = t + glint.x;
    // The adjugate of T + I/p.
    vec3 g = vec3(v.y * v.z - t_rest.z * t_rest.z, v.x * v.z - t_rest.y * t_rest.y,
                  v.x * v.y - t_rest.x * t_rest.x);
    vec3 g_rest = vec3(t_rest.y * t_rest.z - t_rest.x * v.z, t_rest.x * t_rest.z - t_rest.y * v.y,
                       t_rest.x * t_rest.y - v.x * t_rest.z);
    float det = v.x * g.x + t_rest.x * g_rest.x + t_rest.y * g_rest.y;
    float peak = max(det, 0.0) / (phong.w + 1.0);
    float even = 1.0 - dot(t, t) - 2.0 * dot(t_rest, t_rest);
    float narrow = clamp(1.0 - 0.25 * phong.w * even, 0.0, 1.0);
    float gain = 2.25 * even * even * glint.y;
    vec3 lit = vec3(phong.x), shine = vec3(0);
    for (uint i = 0u; i < choice.z; i++) {
        vec3 l = lights[i].world.xyz, strength = lights[i].color.rgb;
        vec3 h = l + to_camera[0].xyz * to_eye.x + to_camera[1].xyz * to_eye.y +
                 to_camera[2].xyz * to_eye.z;
        float length2 = dot(h, h), facing = sqrt(max(quadratic(s, s_rest, l), 0.0));
        lit += phong.y * strength * (1.0 + sided * (facing - 1.0));
        if (!(length2 > 1e-12))
            continue;
        h *= inversesqrt(length2);
        float along = clamp(quadratic(t, t_rest, h), 1e-12, 1.0);
        float power = exp2(min(0.5 * phong.w * log2(along) + gain, 0.0));
        float away = max(quadratic(g, g_rest, h), 1e-7);
        float spread = min(peak / (away * sqrt(away)), 1.0);
        shine += phong.z * strength * sided * (spread + narrow * (power - spread));
    }
    return color * lit + shine;
}
