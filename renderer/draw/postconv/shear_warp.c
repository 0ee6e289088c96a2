/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "draw/postconv/shear.h"
#include "frame/resolve.h"

typedef float vec4 __attribute__((vector_size(16)));

enum { W = SP_WIDE, STRIP = 64 };

/* Weights of four coefficients of a cubic B-spline, `f` samples past the second one. */
static inline vec4 spline_weights(float f) {
    const vec4 w0 = { 1.0f / 6, 2.0f / 3, 1.0f / 6, 0 }, w1 = { -0.5f, 0, 0.5f, 0 };
    const vec4 w2 = { 0.5f, -1, 0.5f, 0 }, w3 = { -1.0f / 6, 0.5f, -0.5f, 1.0f / 6 };
    return w0 + f * (w1 + f * (w2 + f * w3));
}

/* Weighted sum of 4 × 4 samples of four floats; `pitch`: floats from row to row. */
static inline vec4 sum_samples(const float *from, size_t pitch, vec4 across, vec4 down) {
#if defined SP_WIDE_AVX512
    const __m512i index = _mm512_set_epi32(3, 3, 3, 3, 2, 2, 2, 2, 1, 1, 1, 1, 0, 0, 0, 0);
    sp_wide sum = down[0] * sp_wide_load(from);
    for (int r = 1; r < 4; r++)
        sum += down[r] * sp_wide_load(from + (size_t)r * pitch);
    sum *= (sp_wide)_mm512_permutexvar_ps(index, _mm512_castps128_ps512((__m128)across));
    __m256 half =
        _mm256_add_ps(_mm512_castps512_ps256((__m512)sum), _mm512_extractf32x8_ps((__m512)sum, 1));
    return (vec4)_mm_add_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps(half, 1));
#else
    vec4 sum = { 0 };
    for (int r = 0; r < 4; r++, from += pitch) {
        vec4 c[4];
        memcpy(c, from, sizeof c);
        sum += down[r] *
               ((across[0] * c[0] + across[1] * c[1]) + (across[2] * c[2] + across[3] * c[3]));
    }
    return sum;
#endif
}

/* Interpolates the plane; red, green, blue and transmittance. */
static inline vec4 sample_plane(const struct sp_shear *shear, float x, float y) {
    int column = (int)x, row = (int)y;
    size_t pitch = 4 * (size_t)shear->size[0];
    return sum_samples(shear->plane + (size_t)(row - 1) * pitch + 4 * (size_t)(column - 1), pitch,
                       spline_weights(x - (float)column), spline_weights(y - (float)row));
}

void sp_shear_warp(const struct sp_shear *shear, int begin, int end) {
    const struct sp_frame *frame = shear->postconv->frame;
    const float *background = shear->postconv->view->background;
    const double(*m)[3] = shear->ray.m;
    float most[2] = { (float)shear->size[0] - 3, (float)shear->size[1] - 3 };
    for (int y = begin; y < end; y++) {
        unsigned char *out = (unsigned char *)frame->pixels + (size_t)y * frame->stride_bytes;
        for (int x = 0; x < (int)frame->width; x += STRIP) {
            float row[4][STRIP], place[2][STRIP];
            int count = (int)frame->width - x < STRIP ? (int)frame->width - x : STRIP;
            float q[3], step[3];
            for (int a = 0; a < 3; a++) {
                double side = a == 2 ? shear->side : 1;
                q[a] = (float)(side * (m[a][0] * (x + 0.5) + m[a][1] * (y + 0.5) + m[a][2]));
                step[a] = (float)(side * m[a][0]);
            }
            for (int i = 0; i < STRIP; i += W) {
                sp_wide n = sp_wide_count() + (float)i, ahead = q[2] + step[2] * n;
                sp_wide inv = 1.0f / ahead;
                for (int a = 0; a < 2; a++) {
                    sp_wide at = (q[a] + step[a] * n) * inv * (float)shear->scale[a] +
                                 (float)shear->centre[a];
                    at = sp_wide_select(sp_wide_lt(sp_wide_all(0), ahead), at, sp_wide_all(-1));
                    sp_wide_store(&place[a][i], at);
                }
            }
            for (int i = 0; i < count; i++) {
                vec4 p = { 0, 0, 0, 1 };
                if (place[0][i] >= 1 && place[0][i] < most[0] && place[1][i] >= 1 &&
                    place[1][i] < most[1])
                    p = sample_plane(shear, place[0][i], place[1][i]);
                row[0][i] = p[3] < 0 ? 0 : p[3] > 1 ? 1 : p[3];
                for (int c = 0; c < 3; c++)
                    row[c + 1][i] = p[c] < 0 ? 0 : p[c];
            }
            const float *const planes[4] = { row[0], row[1], row[2], row[3] };
            if (frame->format == SP_RGBA8)
                sp_resolve_rgba8(planes, (uint32_t)count, background, out + 4 * (size_t)x);
            else
                sp_resolve_rgbaf32(planes, (uint32_t)count, background,
                                   (float *)(void *)out + 4 * (size_t)x);
        }
    }
}
