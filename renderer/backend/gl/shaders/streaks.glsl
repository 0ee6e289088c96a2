// SPDX-License-Identifier: Apache-2.0
// Splats of a layer of vectors: STREAKS (draw/layers/splat_list/streak.h).

#if STREAKS
// The outline of a kernel that is stretched along a direction, which may be 0, and its pattern. sigma: standard deviation along the
// direction, times that in `streaks`; deep: the third row of K.
void stretch(vec3 u, vec3 deep, vec3 direction, float sigma, inout Footprint f, inout Splat s) {
    const float TINY = 1e-12, SHORTEST = 0.33, FADE_GONE = 1.0, FADE_WHOLE = 3.0; // sp_place_fade() of splat/outline.h
    vec3 v = f.variance;
    vec2 e = view.x * (is_perspective ? 1.0 / u.z : 1.0) * (direction.xy - f.ratio * direction.z);
    float widen = streaks.x * sigma * sigma;
    f.det += widen * (v.z * e.x * e.x - 2.0 * v.y * e.x * e.y + v.x * e.y * e.y);
    v += widen * vec3(e.x * e.x, e.x * e.y, e.y * e.y);
    f.variance = v;
    if (is_perspective)
        f.gain *= smoothstep(FADE_GONE, FADE_WHOLE, u.z * inversesqrt(dot(deep, deep) + widen * direction.z * direction.z));
    float l00 = inversesqrt(v.x), l10 = v.y * l00, l11 = inversesqrt(max(v.z - l10 * l10, TINY));
    l10 *= -l00 * l11;
    vec2 w = vec2(l00 * e.x, l10 * e.x + l11 * e.y);
    float size = length(w);
    w = size > TINY ? w / size : vec2(1.0, 0.0);
    s.turn = vec4(w.x * l00 + w.y * l10, w.y * l11, w.x * l10 - w.y * l00, w.x * l11);
    float rows_apart = 1.0 / max(length(s.turn.zw), TINY) - 1.0;
    bool is_still = dot(direction, direction) < 0.5;
    s.wave.xy = vec2(1.0 / max(streaks.y * sigma * size, SHORTEST), is_still ? 0.0 : clamp(rows_apart, 0.0, 1.0));
}

// phase: of the sample, in 65536ths.
void set_phase(uint phase, inout Splat s) {
    s.wave.zw = vec2(float(phase * 40503u >> 8 & 255u) / 256.0, float(phase) / 65536.0 + streaks.z);
}
#endif
