/* SPDX-License-Identifier: Apache-2.0
 *
 * A tree of blood vessels with an aneurysm, as contrast agent shows it. A trunk splits in two,
 * again and again, by Murray's law (r³ = r1³ + r2³); each branch is a chain of round cones that
 * wanders a little. A generator with a fixed seed decides, so the tree is always the same.
 */
#include <math.h>
#include <stdlib.h>

#include "data/volume/procedural.h"

enum { LEVELS = 7, STEPS = 6, CONES = ((1 << LEVELS) - 1) * STEPS + 2 };

struct cone { /* a segment whose radius goes from a to b; positions in [-1,1]³ */
    float a[3], b[3], radius_a, radius_b;
};

struct tree {
    int count;
    struct cone cones[CONES];
};

static float draw(uint64_t *state) { /* [-1, 1), Steele et al., SplitMix64 */
    uint64_t z = (*state += UINT64_C(0x9e3779b97f4a7c15));
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    z ^= z >> 31;
    return (float)(z >> 40) * 0x1p-23f - 1;
}

static void normalize(float v[3]) {
    float l = sqrtf(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int i = 0; i < 3; i++)
        v[i] /= l;
}

static void grow(struct tree *tree, uint64_t *seed, const float start[3], const float toward[3],
                 float radius, float length, int level) {
    float at[3] = { start[0], start[1], start[2] },
          heading[3] = { toward[0], toward[1], toward[2] };
    for (int s = 0; s < STEPS; s++) {
        struct cone *c = &tree->cones[tree->count++];
        for (int i = 0; i < 3; i++) {
            heading[i] += 0.16f * draw(seed);
            /* Turns back to the middle before the branch reaches the border of the volume. */
            heading[i] -= 0.45f * at[i] * fabsf(at[i]) * fabsf(at[i]);
        }
        normalize(heading);
        float step = length / STEPS, taper = 0.2f / STEPS;
        c->radius_a = radius * (1 - taper * (float)s);
        c->radius_b = radius * (1 - taper * (float)(s + 1));
        for (int i = 0; i < 3; i++) {
            c->a[i] = at[i];
            at[i] += step * heading[i];
            c->b[i] = at[i];
        }
    }
    if (level + 1 >= LEVELS)
        return;
    /* Two children to both sides of the heading, in a plane that turns from level to level. */
    float other[3] = { draw(seed), draw(seed), draw(seed) }, side[3];
    for (int i = 0; i < 3; i++)
        side[i] =
            heading[(i + 1) % 3] * other[(i + 2) % 3] - heading[(i + 2) % 3] * other[(i + 1) % 3];
    normalize(side);
    float share = 0.5f + 0.18f * draw(seed), end = radius * 0.8f;
    float radii[2] = { end * cbrtf(share), end * cbrtf(1 - share) };
    for (int child = 0; child < 2; child++) {
        float spread = (child ? -1.0f : 1.0f) * (1.05f - 0.5f * radii[child] / end), next[3];
        for (int i = 0; i < 3; i++)
            next[i] = heading[i] + spread * side[i];
        normalize(next);
        grow(tree, seed, at, next, fmaxf(radii[child], 0.009f),
             length * (0.8f + 0.06f * draw(seed)), level + 1);
    }
}

static void *prepare_vessels(const uint32_t dims[3]) {
    (void)dims;
    struct tree *tree = malloc(sizeof *tree);
    if (!tree)
        return NULL;
    tree->count = 0;
    uint64_t seed = 20;
    const float start[3] = { 0, 0, -0.95f }, up[3] = { 0, 0, 1 };
    grow(tree, &seed, start, up, 0.085f, 0.62f, 0);
    /* The aneurysm: a sac on a short neck beside the end of the trunk. */
    const struct cone *end = &tree->cones[STEPS - 1];
    struct cone sac = { .radius_a = 0.07f, .radius_b = 0.15f };
    const float out[3] = { 0.19f, -0.15f, -0.02f };
    for (int i = 0; i < 3; i++) {
        sac.a[i] = end->b[i];
        sac.b[i] = end->b[i] + out[i];
    }
    tree->cones[tree->count++] = sac;
    return tree;
}

/* Distance to a cone whose radius changes slowly along it. */
static float cone_distance(const struct cone *c, const float p[3]) {
    float ab[3], ap[3], along = 0, length = 0, rest = 0;
    for (int i = 0; i < 3; i++) {
        ab[i] = c->b[i] - c->a[i];
        ap[i] = p[i] - c->a[i];
        along += ab[i] * ap[i];
        length += ab[i] * ab[i];
    }
    float t = fminf(fmaxf(along / length, 0), 1);
    for (int i = 0; i < 3; i++) {
        float d = ap[i] - t * ab[i];
        rest += d * d;
    }
    return sqrtf(rest) - (c->radius_a + t * (c->radius_b - c->radius_a));
}

static int index_below(float x, uint32_t n) {
    return (int)floorf((x + 1) * 0.5f * (float)n - 0.5f);
}

/* The largest value wins where cones meet, so their order has no influence. */
static void add_cone_to_slice(const struct cone *c, const uint32_t dims[3], size_t k,
                              uint16_t *slice) {
    float h = 2.0f / (float)dims[0], reach = fmaxf(c->radius_a, c->radius_b) + h;
    int low[3], high[3];
    for (int i = 0; i < 3; i++) {
        int first = index_below(fminf(c->a[i], c->b[i]) - reach, dims[0]);
        int last = index_below(fmaxf(c->a[i], c->b[i]) + reach, dims[0]) + 1;
        low[i] = first < 0 ? 0 : first;
        high[i] = last >= (int)dims[i] ? (int)dims[i] - 1 : last;
    }
    if ((int)k < low[2] || (int)k > high[2])
        return;
    float p[3] = { 0, 0, ((float)k + 0.5f) * h - 1 };
    for (int j = low[1]; j <= high[1]; j++) {
        p[1] = ((float)j + 0.5f) * h - 1;
        for (int i = low[0]; i <= high[0]; i++) {
            p[0] = ((float)i + 0.5f) * h - 1;
            float share = sp_demo_coverage(cone_distance(c, p) / h);
            /* Contrast agent thins out in the small branches. */
            float value = share * (1700 + 1900 * fminf(c->radius_a * 12, 1));
            uint16_t *sample = &slice[(size_t)j * dims[0] + (size_t)i];
            if (value > (float)*sample)
                *sample = (uint16_t)(value + 0.5f);
        }
    }
}

static void fill_vessels(const void *prepared, const uint32_t dims[3], size_t begin, size_t end,
                         void *voxels) {
    const struct tree *tree = prepared;
    size_t area = (size_t)dims[0] * dims[1];
    for (size_t k = begin; k < end; k++) {
        uint16_t *slice = (uint16_t *)voxels + k * area;
        for (size_t i = 0; i < area; i++)
            slice[i] = 0;
        for (int c = 0; c < tree->count; c++)
            add_cone_to_slice(&tree->cones[c], dims, k, slice);
    }
}

const struct sp_demo_maker sp_demo_vessels = {
    .demo = { "vessels", "a branching vessel tree with an aneurysm, values to 3600", 160 },
    .type = SP_UINT16,
    .prepare = prepare_vessels,
    .fill = fill_vessels,
};
