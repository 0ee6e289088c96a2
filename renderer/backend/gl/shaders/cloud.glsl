// SPDX-License-Identifier: Apache-2.0
// The splats of points, or of trained Gaussians: TRAINED (draw/layers/cloud/set_up.c). Bindings 2 to 4 as in splat_layers.c.

layout(std430, binding = 2) readonly buffer Order { uint order[]; }; // elements, front to back; UNSEEN: none is seen any more
// Three numbers of the position of each element, then six of each factor, then the value of each, or its opacity; then the volume
// of each point, then three numbers of the vector of each, or the values of each merged point (struct sp_cloud_node).
layout(std430, binding = 3) readonly buffer Elements { float elements[]; };
// By element and coefficient: red, green, blue. Or by point: the number, or the vector whose length is the number, that gives its colour;
// then the number of each merged point.
layout(std430, binding = 4) readonly buffer Harmonics { float harmonics[]; };

const uint UNSEEN = 0xffffffffu;
const float COLOR_MAX = 1e4; // SP_CLOUD_COLOR_MAX

// Places an element: u, and rows of its K.
vec3 locate(uint e, out vec3 position, out vec3 k[3]) {
    uint p = 3u * e, l = 3u * cloud.x + 6u * e;
    vec3 first = vec3(elements[l], elements[l + 1u], elements[l + 3u]), u; // columns of the factor, from their diagonal on
    vec2 second = vec2(elements[l + 2u], elements[l + 4u]);
    float third = elements[l + 5u];
    position = vec3(elements[p], elements[p + 1u], elements[p + 2u]);
    for (int r = 0; r < 3; r++) {
        u[r] = steps[r].w + dot(steps[r].xyz, position);
        k[r] = cell.w * vec3(dot(steps[r].xyz, first), dot(steps[r].yz, second), steps[r].z * third);
    }
    return u;
}

#if TRAINED
// Real spherical harmonics, in the order and with the signs of Kerbl et al. (2023).
void compute_harmonics(vec3 d, out float basis[16]) {
    vec3 q = d * d;
    basis = float[](0.28209479, -0.48860251 * d.y, 0.48860251 * d.z, -0.48860251 * d.x, 1.09254843 * d.x * d.y,
                    -1.09254843 * d.y * d.z, 0.31539157 * (2.0 * q.z - q.x - q.y), -1.09254843 * d.x * d.z,
                    0.54627422 * (q.x - q.y), -0.59004359 * d.y * (3.0 * q.x - q.y), 2.89061144 * d.x * d.y * d.z,
                    -0.45704580 * d.y * (4.0 * q.z - q.x - q.y), 0.37317633 * d.z * (2.0 * q.z - 3.0 * q.x - 3.0 * q.y),
                    -0.45704580 * d.x * (4.0 * q.z - q.x - q.y), 1.44530572 * d.z * (q.x - q.y),
                    -0.59004359 * d.x * (q.x - 3.0 * q.y));
}

vec3 compute_color(uint e, vec3 position) {
    float basis[16];
    vec3 color = vec3(0.5), d = is_perspective ? position - eye.xyz : eye.xyz;
    compute_harmonics(d * inversesqrt(max(dot(d, d), 1e-30)), basis);
    for (uint i = 0u, at = 3u * cloud.y * e; i < cloud.y; i++, at += 3u)
        color += basis[i] * vec3(harmonics[at], harmonics[at + 1u], harmonics[at + 2u]);
    return clamp(color, 0.0, COLOR_MAX);
}

// They end where their opacity does.
bool set_up(uint i, out Splat s, out vec4 box) {
    const float LOWPASS2 = 0.3, RADIUS_MAX = 3.4, SLACK = 1.0001; // of the logarithm: pixels decide by their own opacity
    uint e = order[i];
    if (e == UNSEEN)
        return false;
    vec3 position, k[3], u = locate(e, position, k);
    bool is_close = may_be_close(u, k, RADIUS_MAX, LOWPASS2);
    if (!is_close && u.z < view.w)
        return false;
    Footprint f = compute_footprint(u, k, LOWPASS2);
    Kernel own;
    float opacity = elements[9u * cloud.x + e] * eye.w, close_opacity, gain;
    if (is_close)
        own = make_kernel(u, k, LOWPASS2);
    bool has_rays = is_close && own.square > 0.0;
    close_opacity = cloud.z != 0u && has_rays ? opacity * sqrt(own.own / (own.det * own.square)) : opacity;
    if (cloud.z != 0u)
        opacity *= sqrt(f.own_det / f.det);
    float parts = (is_close ? close_opacity : opacity) / TRAINED_OPACITY_MIN, radius = SLACK * sqrt(2.0 / LOG2E * log2(max(parts, 1.000001)));
    if (!(parts > 1.0 && (f.det < 1e36 || is_close)))
        return false;
    box = set_ellipse(f, radius, s);
    s.shape.yz = vec2(opacity, 0.0);
    if (is_close && !place_close(own, k, LOWPASS2, radius, false, s, box, gain))
        return false;
    if (is_close && s.shape.z < 0.0) // around the eye
        s.shape.y = close_opacity;
    s.color = vec4(compute_color(e, position), u.z);
    return true;
}
#else
float piece_word(uint piece, uint i) {
    return uintBitsToFloat(layer_words[9u * piece + i]);
}

// Red, green, blue and depth of a value (splat/pieces.h).
vec4 classify(float value) {
    uint low = 0u, high = cloud.w;
    while (high - low > 1u) {
        uint middle = (low + high) / 2u;
        bool is_before = piece_word(middle, 0u) <= value;
        low = is_before ? middle : low;
        high = is_before ? high : middle;
    }
    vec4 own;
    float along = value - piece_word(low, 0u);
    for (uint c = 0u; c < 4u; c++)
        own[c] = piece_word(low, 1u + c) + along * piece_word(low, 5u + c);
    float a = clamp(own.a, 0.0, 1.0), half_way = a / (2.0 - a), t = half_way * half_way;
    own.a = a > 0.4 ? -log(max(1.0 - a, 1e-30))
                    : half_way * (2.0 + t * (2.0 / 3.0 + t * (2.0 / 5.0 + t * (2.0 / 7.0 + t * (2.0 / 9.0)))));
    return own;
}

// The same for a merged point whose values have this mean (draw/layers/cloud/set_up.c).
vec4 classify_merged(float value, uint word) {
    const float at[4] = float[](-1.299038, -0.433013, 0.433013, 1.299038); // sp_cloud_share_at
    float spread = float((word >> 24) * ((word >> 12 & 4095u) - (word & 4095u) + 1u)) * streak_axes[0].w;
    vec4 sum = vec4(0);
    if (spread <= 0.0)
        return classify(value);
    for (int i = 0; i < 4; i++) {
        vec4 share = classify(value + at[i] * spread);
        sum += vec4(share.a * share.rgb, share.a);
    }
    return vec4(sum.rgb / max(sum.a, 1e-30), 0.25 * sum.a);
}

// The value, relative to the base, that has the colour of a point (draw/layers/cloud/set_up.c).
float compute_color_value(uint e) {
    bool is_merged = e >= cloud.z; // the number of the points; merged ones have one number
    uint at = is_merged ? cloud.y * cloud.z + (e - cloud.z) : cloud.y * e;
    float number = harmonics[at];
    if (cloud.y == 3u && !is_merged)
        number = length(vec3(number, harmonics[at + 1u], harmonics[at + 2u]));
    return streak_axes[0].z + (abs(number) < 3e38 ? (number - streak_axes[0].x) * streak_axes[0].y : 0.0);
}

// Makes a kernel a part of it (draw/layers/cloud/set_up.c).
void reduce_to_part(uint part, inout vec3 u, inout vec3 k[3]) {
    vec3 n = k[2] * inversesqrt(dot(k[2], k[2]) + 1e-30);
    for (int r = 0; r < 3; r++) {
        float along = dot(k[r], n);
        u[r] += kernel[part / 4u][part % 4u] * along;
        k[r] -= (1.0 - streaks.x) * along * n;
    }
}

#if STREAKS
// The phase of a point, in 65536ths: the lower 16 bits of sp_streak_hash() (draw/layers/splat_list/phase.h).
uint compute_phase(uint e) {
    const uvec2 FIRST = uvec2(0xed558ccdu, 0xff51afd7u), SECOND = uvec2(0x1a85ec53u, 0xc4ceb9feu); // low words first
    uint low, high;
    umulExtended(e, FIRST.x, high, low);
    high += e * FIRST.y;
    low ^= high >> 1;
    uint product_low, product_high;
    umulExtended(low, SECOND.x, product_high, product_low);
    product_high += low * SECOND.y + high * SECOND.x;
    return (product_low ^ product_high >> 1) & 0xffffu;
}

// The standard deviation of a kernel along a unit vector of the world of the data (draw/layers/cloud/set_up.c).
float compute_deviation(uint e, vec3 d) {
    const float TINY = 1e-20;
    uint l = 3u * cloud.x + 6u * e;
    float x = d.x / max(elements[l], TINY), y = (d.y - elements[l + 1u] * x) / max(elements[l + 2u], TINY);
    float z = (d.z - elements[l + 3u] * x - elements[l + 4u] * y) / max(elements[l + 5u], TINY);
    float deviation = inversesqrt(x * x + y * y + z * z);
    return deviation < 1e30 ? deviation : 0.0;
}

// Stretches a kernel along the vector of its point. False if nothing is drawn, because there is none.
bool stretch_along_vector(uint e, vec3 u, vec3 deep, inout Footprint f, inout Splat s) {
    uint v = 11u * cloud.x + 3u * e;
    vec3 d = vec3(elements[v], elements[v + 1u], elements[v + 2u]), direction = vec3(0);
    float sum = dot(abs(d), vec3(1)), sigma = 0.0;
    bool moves = sum > 0.0 && sum < 3e38; // and is a number
    if (moves) {
        d = normalize(d / sum);
        for (int r = 0; r < 3; r++)
            direction[r] = dot(steps[r].xyz, d);
        float size = length(direction);
        direction /= size;
        sigma = cell.w * size * compute_deviation(e, d);
    }
    stretch(u, deep, direction, sigma, f, s);
    set_phase(compute_phase(e), s);
    return moves || streaks.w != 0.0;
}
#endif

bool set_up(uint i, out Splat s, out vec4 box) {
    uint number = order[i], e = number / rows.x, n = cloud.x;
    if (number == UNSEEN)
        return false;
    vec3 position, k[3], u = locate(e, position, k);
    if (rows.x > 1u)
        reduce_to_part(number % rows.x, u, k);
    Footprint f = compute_footprint(u, k, filter_of.x);
    bool is_close = false;
#if STREAKS
    if (!stretch_along_vector(e, u, k[2], f, s))
        return false;
#else
    is_close = may_be_close(u, k, filter_of.y, filter_of.x);
#endif
    if (!(f.det < 1e36 || is_close) || (!is_close && u.z < view.w))
        return false;
    float value = elements[9u * n + e] - eye.x;
    vec4 own = e < cloud.z ? classify(value) : classify_merged(value, floatBitsToUint(elements[11u * n + e - cloud.z]));
    if (cloud.y != 0u)
        own.rgb = classify(compute_color_value(e)).rgb;
    float gain = f.gain * filter_of.w / sqrt(f.det);
    box = set_ellipse(f, filter_of.y, s);
#if !STREAKS
    s.shape.z = 0.0;
    if (is_close && !place_close(make_kernel(u, k, filter_of.x), k, filter_of.x, filter_of.y, true, s, box, gain))
        return false;
#endif
    s.shape.y = min(own.a * bounds.w * elements[10u * n + e] * eye.w * gain, DEPTH_MAX);
    s.color = vec4(own.rgb, u.z);
    return s.shape.y > 0.0;
}
#endif
