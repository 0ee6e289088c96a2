/* SPDX-License-Identifier: Apache-2.0
 *
 * A thousand balls that fill a twentieth of a cube: an example of a large volume that is mostly
 * empty. Each ball lies inside its own cell of a lattice of 10 × 10 × 10, so none overlap. A
 * random generator with a fixed seed chooses radius, position and value. Lengths are in half edges,
 * so every size shows the same balls.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/volume/procedural.h"

enum { CELLS = 10, BALLS = CELLS * CELLS * CELLS, SKIN = 100 };

struct floating_ball {
    float centre[3], radius; /* in [-1,1]³ */
    float core;              /* value in the middle; SKIN at the surface */
};

static float draw(uint64_t *state) { /* [0, 1), Steele et al., SplitMix64 */
    uint64_t z = (*state += UINT64_C(0x9e3779b97f4a7c15));
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    z ^= z >> 31;
    return (float)(z >> 40) * 0x1p-24f;
}

/* The cubes of the radii are uniformly distributed; their mean fills the requested share of space.
 */
static void *prepare_sparse(const uint32_t dims[3]) {
    (void)dims;
    const double share = 0.05, cell = 2.0 / CELLS;
    struct floating_ball *balls = malloc(BALLS * sizeof *balls);
    uint64_t seed = 5;
    for (int n = 0; balls && n < BALLS; n++) {
        struct floating_ball *b = &balls[n];
        const int at[3] = { n % CELLS, n / CELLS % CELLS, n / (CELLS * CELLS) };
        double cubed = share * cell * cell * cell * 3 / (4 * M_PI) * (0.25 + 1.5 * draw(&seed));
        b->radius = (float)cbrt(cubed);
        b->core = 160 + 95 * draw(&seed);
        for (int i = 0; i < 3; i++) {
            float slack = (float)(cell / 2) - b->radius;
            float middle = (float)((at[i] + 0.5) * cell - 1);
            b->centre[i] = middle + slack * (2 * draw(&seed) - 1);
        }
    }
    return balls;
}

static uint32_t index_within(float x, uint32_t n) {
    float i = floorf((x + 1) * 0.5f * (float)n - 0.5f);
    return i < 0 ? 0 : i >= (float)n ? n - 1 : (uint32_t)i;
}

static void add_ball_to_slice(const struct floating_ball *b, uint32_t n, float z, uint8_t *slice) {
    float h = 2.0f / (float)n, reach = b->radius + h, dz = z - b->centre[2];
    if (fabsf(dz) > reach)
        return;
    uint32_t low[2], high[2];
    for (int i = 0; i < 2; i++) {
        low[i] = index_within(b->centre[i] - reach, n);
        high[i] = index_within(b->centre[i] + reach + h, n);
    }
    for (uint32_t j = low[1]; j <= high[1]; j++) {
        float dy = ((float)j + 0.5f) * h - 1 - b->centre[1];
        for (uint32_t i = low[0]; i <= high[0]; i++) {
            float dx = ((float)i + 0.5f) * h - 1 - b->centre[0];
            float square = dx * dx + dy * dy + dz * dz;
            float share = sp_demo_coverage((sqrtf(square) - b->radius) / h);
            float deep = fmaxf(1 - square / (b->radius * b->radius), 0);
            if (share > 0)
                slice[(size_t)j * n + i] =
                    (uint8_t)(share * (SKIN + (b->core - SKIN) * deep) + 0.5f);
        }
    }
}

static void fill_sparse(const void *prepared, const uint32_t dims[3], size_t begin, size_t end,
                        void *voxels) {
    const struct floating_ball *balls = prepared;
    size_t area = (size_t)dims[0] * dims[1];
    for (size_t k = begin; k < end; k++) {
        uint8_t *slice = (uint8_t *)voxels + k * area;
        memset(slice, 0, area);
        for (int n = 0; n < BALLS; n++)
            add_ball_to_slice(&balls[n], dims[0], (2 * (float)k + 1) / (float)dims[2] - 1, slice);
    }
}

const struct sp_demo_maker sp_demo_sparse = {
    .demo = { "sparse", "a thousand balls in a twentieth of the space: a mostly empty volume",
              256 },
    .type = SP_UINT8,
    .prepare = prepare_sparse,
    .fill = fill_sparse,
};
