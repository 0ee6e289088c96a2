// SPDX-License-Identifier: Apache-2.0
// The smooth gradient of the samples (draw/resample/smooth.h), and how it is mixed into a fine one (draw/resample/gradient.h).

// The weights of sample i of four, at the share f between the second and the third one.
float smooth_mean(int i, float f) {
    return 0.25 * (i < 2 ? float(1 + i) - f : i == 2 ? 1.0 + f : f);
}

float smooth_change(int i, float f) {
    float share = (i & 1) != 0 ? f : 1.0 - f;
    return i < 2 ? -0.5 * share : 0.5 * share;
}

// The smooth gradient at sample index x: codes per sample along u, v and w. Samples without data count as the
// lowest code.
vec3 smooth_slopes(vec3 x) {
    vec3 spacing = vec3(spacing_at(0, x.x), spacing_at(1, x.y), spacing_at(2, x.z));
    x = clamp(x, vec3(1.0), vec3(last - 1));
    ivec3 first = min(ivec3(x), last - 2) - 1;
    vec3 f = x - vec3(first + 1);
    vec3 slope = vec3(0);
    for (int k = 0; k < 4; k++) {
        vec3 sum = vec3(0); // of a slice
        for (int j = 0; j < 4; j++) {
            float mean = 0.0, rise = 0.0; // of a row
            for (int i = 0; i < 4; i++) {
                ivec3 p = first + ivec3(i, j, k);
                float code = code_of(uint(p.x) * strides.x + uint(p.y) * strides.y + uint(p.z) * strides.z);
                code = clamp(code, CODE_MIN, CODE_MAX) - CODE_MIN;
                mean += smooth_mean(i, f.x) * code;
                rise += smooth_change(i, f.x) * code;
            }
            sum += vec3(smooth_mean(j, f.y) * rise, smooth_change(j, f.y) * mean, smooth_mean(j, f.y) * mean);
        }
        slope += vec3(smooth_mean(k, f.z), smooth_mean(k, f.z), smooth_change(k, f.z)) * sum;
    }
    return slope / spacing;
}

// Mixes the gradients, which are in world space.
vec3 mix_gradients(vec3 smooth_one, vec3 fine) {
    const float TINY_SQUARE = 1e-20;
    float along = max(dot(fine, smooth_one) / (dot(smooth_one, smooth_one) + TINY_SQUARE), 0.0);
    vec3 aside = fine - along * smooth_one;
    float ratio = min(smoothing.x / (dot(aside, aside) + TINY_SQUARE), 1e9);
    float keep = smoothing.y / (1.0 + ratio * ratio);
    along += (1.0 - keep) * max(1.0 - along, 0.0);
    return along * smooth_one + keep * aside;
}
