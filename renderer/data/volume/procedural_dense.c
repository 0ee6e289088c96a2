/* SPDX-License-Identifier: Apache-2.0
 *
 * Volumes without an empty voxel, as simulations and noisy scans are: turbulence and noise.
 */
#include <math.h>
#include <stdlib.h>

#include "data/volume/procedural.h"

static uint64_t mix(uint64_t z) { /* the output function of Steele et al., SplitMix64 */
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return z ^ z >> 31;
}

/* Turbulence.
 * A periodic scalar field: a sum u of waves with random directions and phases, whose amplitudes
 * fall as k^(-11/6), which gives Kolmogorov's spectrum. The value is (1 + sin u)/2. Every size
 * shows the same waves.
 */
enum { OCTAVES = 4, WAVES_PER_OCTAVE = 12, WAVES = OCTAVES * WAVES_PER_OCTAVE };

struct wave {
    int k[3]; /* cycles per edge */
    double phase, amplitude;
};
/* The waves and cos, sin of their phase along x: (cos, sin)[wave][i]. */
struct turbulence {
    struct wave waves[WAVES];
    float along_x[]; /* 2 · WAVES · n */
};

static double draw(uint64_t *state) { /* [0, 1) */
    return (double)(mix(*state += UINT64_C(0x9e3779b97f4a7c15)) >> 11) * 0x1p-53;
}

static void *prepare_turbulence(const uint32_t dims[3]) {
    const double root_mean_square = 0.8;
    uint32_t n = dims[0];
    struct turbulence *t = malloc(sizeof *t + 2 * WAVES * n * sizeof *t->along_x);
    uint64_t seed = 7;
    double squares = 0;
    for (int w = 0; t && w < WAVES; w++) {
        struct wave *wave = &t->waves[w];
        double length = 2 << w / WAVES_PER_OCTAVE, k2 = 0;
        double up = 2 * draw(&seed) - 1, around = 2 * M_PI * draw(&seed), flat = sqrt(1 - up * up);
        const double direction[3] = { flat * cos(around), flat * sin(around), up };
        length *= 1 + draw(&seed);
        for (int a = 0; a < 3; a++) {
            wave->k[a] = (int)lrint(length * direction[a]);
            k2 += wave->k[a] * wave->k[a];
        }
        wave->phase = 2 * M_PI * draw(&seed);
        wave->amplitude = pow(k2, -11.0 / 12);
        squares += 0.5 * wave->amplitude * wave->amplitude;
    }
    for (int w = 0; t && w < WAVES; w++) {
        t->waves[w].amplitude *= root_mean_square / sqrt(squares);
        float *row = t->along_x + (size_t)2 * w * n;
        for (uint32_t i = 0; i < n; i++) {
            double angle = 2 * M_PI * t->waves[w].k[0] * i / n;
            row[i] = (float)cos(angle);
            row[n + i] = (float)sin(angle);
        }
    }
    return t;
}

static void fill_turbulence(const void *prepared, const uint32_t dims[3], size_t begin, size_t end,
                            void *voxels) {
    const struct turbulence *t = prepared;
    uint32_t n = dims[0];
    for (size_t k = begin; k < end; k++)
        for (uint32_t j = 0; j < n; j++) {
            float *row = (float *)voxels + (k * n + j) * n;
            for (uint32_t i = 0; i < n; i++)
                row[i] = 0;
            for (int w = 0; w < WAVES; w++) {
                const struct wave *wave = &t->waves[w];
                const float *c = t->along_x + (size_t)2 * w * n, *s = c + n;
                double turns = (wave->k[1] * (double)j + wave->k[2] * (double)k) / n;
                double angle = 2 * M_PI * turns + wave->phase;
                float of_cos = (float)(wave->amplitude * cos(angle));
                float of_sin = (float)(wave->amplitude * sin(angle));
                for (uint32_t i = 0; i < n; i++)
                    row[i] += of_cos * c[i] - of_sin * s[i];
            }
            for (uint32_t i = 0; i < n; i++)
                row[i] = 0.5f + 0.5f * sinf(row[i]);
        }
}

const struct sp_demo_maker sp_demo_turbulence = {
    .demo = { "turbulence", "a turbulent scalar without an empty voxel, values in [0,1]", 128 },
    .type = SP_FLOAT32,
    .prepare = prepare_turbulence,
    .fill = fill_turbulence,
};

/* Noise.
 * A ball in a cube, both with independent noise of ±40 in each voxel: 60 outside, 150 inside.
 */
enum { NOISE = 40, OUTSIDE = 60, INSIDE = 150 };

static void fill_noise(const void *prepared, const uint32_t dims[3], size_t begin, size_t end,
                       void *voxels) {
    (void)prepared;
    uint32_t n = dims[0];
    float centre = 0.5f * (float)(n - 1), radius = 0.4f * (float)n;
    for (size_t k = begin; k < end; k++)
        for (uint32_t j = 0; j < n; j++) {
            uint8_t *row = (uint8_t *)voxels + (k * n + j) * n;
            float z = (float)k - centre, y = (float)j - centre, flat = y * y + z * z;
            for (uint32_t i = 0; i < n; i++) {
                float x = (float)i - centre;
                float share = sp_demo_coverage(sqrtf(x * x + flat) - radius);
                uint64_t random = mix(((k * n + j) * n + i) * UINT64_C(0x9e3779b97f4a7c15));
                int noise = (int)((random >> 32) * (2 * NOISE + 1) >> 32) - NOISE;
                row[i] = (uint8_t)(OUTSIDE + (int)(share * (INSIDE - OUTSIDE) + 0.5f) + noise);
            }
        }
}

const struct sp_demo_maker sp_demo_noise = {
    .demo = { "noise", "a ball in a cube, both of noise, without an empty voxel", 128 },
    .type = SP_UINT8,
    .fill = fill_noise,
};
