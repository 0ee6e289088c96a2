// SPDX-License-Identifier: Apache-2.0
// From a kernel in camera space to the outline of its splat (splat/outline.h).

const float VARIANCE_MIN = 1e-6, PI = 3.14159265;

bool is_perspective;
float area; // of the splat [px]
#if !STREAKS
vec4 close_words; // of a kernel close to the eye
#endif

void write_splat(uint record, Splat s) {
    uint at = RECORD_WORDS * record;
    records[at] = s.place;
    records[at + 1u] = s.color;
#if STREAKS
    records[at + 2u] = vec4(s.shape, 0.0, 0.0);
    records[at + 3u] = s.turn;
    records[at + 4u] = s.wave;
#else
    records[at + 2u] = s.shape;
    if (s.shape.z != 0.0)
        records[at + 3u] = close_words;
#endif
}

// A kernel on the image.
struct Footprint {
    vec2 at;       // px
    vec2 ratio;    // u0/u2, u1/u2 within bounds
    vec3 variance; // with the low-pass filter: V00, V01, V11
    float det;     // of that
    float own_det; // without the filter
    float gain;    // |det J|
};

// Rows of K; u0/u2 and u1/u2 in the Jacobian.
Footprint compute_footprint_at(vec3 u, vec3 k[3], float h2, vec2 ratio) {
    float inverse = is_perspective ? 1.0 / u.z : 1.0, f = view.x * inverse;
    vec3 m0 = f * (k[0] - ratio.x * k[2]), m1 = f * (k[1] - ratio.y * k[2]), area = cross(m0, m1);
    vec2 v = vec2(dot(m0, m0), dot(m1, m1)) + h2;
    float own = dot(area, area);
    return Footprint(view.yz + view.x * (u.xy * inverse), ratio, vec3(v.x, dot(m0, m1), v.y), own + h2 * (v.x + v.y - h2), own,
                     f * f * sqrt(1.0 + dot(ratio, ratio)));
}

Footprint compute_footprint(vec3 u, vec3 k[3], float h2) {
    return compute_footprint_at(u, k, h2, is_perspective ? clamp(u.xy / u.z, -bounds.xy, bounds.xy) : vec2(0));
}

// Sets the ellipse of a splat. Returns the box of pixels whose centres lie within `radius` standard deviations, half open.
vec4 set_ellipse(Footprint f, float radius, inout Splat s) {
    vec3 conic = 0.5 * LOG2E / f.det * vec3(f.variance.z, -2.0 * f.variance.y, f.variance.x);
    vec2 reach = radius * sqrt(f.variance.xz);
    s.place = vec4(f.at, conic.xy);
    s.shape.x = conic.z;
    area = PI * radius * radius * sqrt(f.det);
    return vec4(ceil(f.at - reach - 0.5), floor(f.at + reach + 0.5));
}
