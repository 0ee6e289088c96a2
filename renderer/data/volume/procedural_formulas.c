/* SPDX-License-Identifier: Apache-2.0
 *
 * Built-in volumes that a formula or a table gives.
 */
#include <math.h>
#include <stdlib.h>

#include "data/volume/procedural.h"

/* Phantom.
 * The 3-D Shepp-Logan head in [-1,1]³: ellipsoids whose values add up. Geometry and the
 * high-contrast values of the "modified" phantom (Toft 1996, in three dimensions by Schabel 2006).
 * Each ellipsoid turns about the z axis through its own centre, as in Kak & Slaney, section 3.3.
 * Schabel's third Euler angle, 10 degrees for the two ventricles, is left out: as the second one is
 * zero it would only add to the first and make the pair lopsided.
 */
struct ellipsoid {
    float value, axes[3], centre[3], degrees;
};
static const struct ellipsoid shepp_logan[] = {
    { 1.0f, { 0.69f, 0.92f, 0.81f }, { 0, 0, 0 }, 0 },
    { -0.8f, { 0.6624f, 0.874f, 0.78f }, { 0, -0.0184f, 0 }, 0 },
    { -0.2f, { 0.11f, 0.31f, 0.22f }, { 0.22f, 0, 0 }, -18 },
    { -0.2f, { 0.16f, 0.41f, 0.28f }, { -0.22f, 0, 0 }, 18 },
    { 0.1f, { 0.21f, 0.25f, 0.41f }, { 0, 0.35f, -0.15f }, 0 },
    { 0.1f, { 0.046f, 0.046f, 0.05f }, { 0, 0.1f, 0.25f }, 0 },
    { 0.1f, { 0.046f, 0.046f, 0.05f }, { 0, -0.1f, 0.25f }, 0 },
    { 0.1f, { 0.046f, 0.023f, 0.05f }, { -0.08f, -0.605f, 0 }, 0 },
    { 0.1f, { 0.023f, 0.023f, 0.02f }, { 0, -0.606f, 0 }, 0 },
    { 0.1f, { 0.023f, 0.046f, 0.02f }, { 0.06f, -0.605f, 0 }, 0 },
};
enum { ELLIPSOIDS = sizeof shepp_logan / sizeof shepp_logan[0] };

/* World → unit ball, by rows: q = m·(p − centre). */
struct ball {
    float m[3][3], value, thin; /* thin: smallest semi-axis */
};

static void *prepare_phantom(const uint32_t dims[3]) {
    (void)dims;
    struct ball *balls = malloc(ELLIPSOIDS * sizeof *balls);
    for (int e = 0; balls && e < ELLIPSOIDS; e++) {
        const struct ellipsoid *s = &shepp_logan[e];
        float angle = s->degrees * (float)(M_PI / 180), c = cosf(angle), n = sinf(angle);
        balls[e] = (struct ball){ .m = { { c / s->axes[0], n / s->axes[0], 0 },
                                         { -n / s->axes[1], c / s->axes[1], 0 },
                                         { 0, 0, 1 / s->axes[2] } },
                                  .value = s->value,
                                  .thin = fminf(fminf(s->axes[0], s->axes[1]), s->axes[2]) };
    }
    return balls;
}

/* Adds one ellipsoid to a row of samples x = (2i + 1)/n − 1. Along the row |q|² is a quadratic, so
 * the voxels near the surface are found without testing the others. */
static void add_ball_to_row(const struct ball *b, const float centre[3], float y, float z,
                            uint32_t n, float *row) {
    float h = 2.0f / (float)n, py = y - centre[1], pz = z - centre[2];
    /* q(x) = d·x + o */
    float d[3], o[3], dd = 0, od = 0, oo = 0;
    for (int i = 0; i < 3; i++) {
        d[i] = b->m[i][0];
        o[i] = b->m[i][0] * -centre[0] + b->m[i][1] * py + b->m[i][2] * pz;
        dd += d[i] * d[i];
        od += o[i] * d[i];
        oo += o[i] * o[i];
    }
    float reach = 1 + h / b->thin; /* |q| of a voxel that the surface may touch is below it */
    float root = od * od - dd * (oo - reach * reach);
    if (root <= 0)
        return;
    float half = sqrtf(root) / dd, middle = -od / dd;
    int first = (int)floorf((middle - half + 1) / h - 0.5f);
    int last = (int)ceilf((middle + half + 1) / h - 0.5f);
    first = first < 0 ? 0 : first;
    last = last >= (int)n ? (int)n - 1 : last;
    float inner = fmaxf(0, 1 - h / b->thin);
    for (int i = first; i <= last; i++) {
        float x = ((float)i + 0.5f) * h - 1;
        float q[3] = { d[0] * x + o[0], d[1] * x + o[1], d[2] * x + o[2] };
        float length = sqrtf(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]), share = 1;
        if (length > inner) { /* distance to the surface, to first order: (|q| − 1)/|∇|q|| */
            float g = 0;
            for (int j = 0; j < 3; j++) {
                float gj = b->m[0][j] * q[0] + b->m[1][j] * q[1] + b->m[2][j] * q[2];
                g += gj * gj;
            }
            share = g > 0 ? sp_demo_coverage((length - 1) * length / (sqrtf(g) * h)) : 1;
        }
        row[i] += b->value * share;
    }
}

static void fill_phantom(const void *prepared, const uint32_t dims[3], size_t begin, size_t end,
                         void *voxels) {
    const struct ball *balls = prepared;
    uint32_t n = dims[0];
    for (size_t k = begin; k < end; k++)
        for (uint32_t j = 0; j < dims[1]; j++) {
            float *row = (float *)voxels + (k * dims[1] + j) * n;
            float y = (2 * (float)j + 1) / (float)n - 1, z = (2 * (float)k + 1) / (float)n - 1;
            for (uint32_t i = 0; i < n; i++)
                row[i] = 0;
            for (int e = 0; e < ELLIPSOIDS; e++)
                add_ball_to_row(&balls[e], shepp_logan[e].centre, y, z, n, row);
            /* Rounds values that cancel out in the table to 0; the sum may be −3e-8. */
            for (uint32_t i = 0; i < n; i++)
                row[i] = rintf(row[i] * 0x1p20f) * 0x1p-20f + 0.0f;
        }
}

const struct sp_demo_maker sp_demo_phantom = {
    .demo = { "phantom", "3-D Shepp-Logan head: ten ellipsoids, values in [0,1]", 128 },
    .type = SP_FLOAT32,
    .prepare = prepare_phantom,
    .fill = fill_phantom,
};

/* Marschner-Lobb.
 * Marschner & Lobb, An evaluation of reconstruction filters for volume rendering, 1994, eq. 9 and
 * 10, in [-1,1]³ with the corners sampled:
 *   ρ = (1 − sin(πz/2) + α(1 + ρr(√(x²+y²)))) / (2(1 + α)),  ρr(r) = cos(2π fM cos(πr/2))
 */
static const double ml_alpha = 0.25, ml_frequency = 6;

static double ml_position(size_t i, uint32_t n) {
    return 2.0 * (double)i / (n - 1) - 1;
}

static void *
prepare_marschner_lobb(const uint32_t dims[3]) { /* the part that depends on x and y only */
    float *plane = malloc((size_t)dims[0] * dims[1] * sizeof *plane);
    for (uint32_t j = 0; plane && j < dims[1]; j++)
        for (uint32_t i = 0; i < dims[0]; i++) {
            double r = hypot(ml_position(i, dims[0]), ml_position(j, dims[1]));
            double wave = cos(2 * M_PI * ml_frequency * cos(M_PI * r / 2));
            plane[(size_t)j * dims[0] + i] = (float)(ml_alpha * (1 + wave) / (2 * (1 + ml_alpha)));
        }
    return plane;
}

static void fill_marschner_lobb(const void *prepared, const uint32_t dims[3], size_t begin,
                                size_t end, void *voxels) {
    const float *plane = prepared;
    size_t area = (size_t)dims[0] * dims[1];
    for (size_t k = begin; k < end; k++) {
        float *slice = (float *)voxels + k * area;
        double z = ml_position(k, dims[2]);
        float rest = (float)((1 - sin(M_PI * z / 2)) / (2 * (1 + ml_alpha)));
        for (size_t i = 0; i < area; i++)
            slice[i] = plane[i] + rest;
    }
}

const struct sp_demo_maker sp_demo_marschner_lobb = {
    .demo = { "marschner-lobb", "the reconstruction test signal, frequency 6, amplitude 0.25", 41 },
    .type = SP_FLOAT32,
    .prepare = prepare_marschner_lobb,
    .fill = fill_marschner_lobb,
};

/* Checkerboard.
 * Chen et al., Adaptive EWA volume splatting, section 6: 512×512×3 voxels, none of them empty.
 * 32 squares per side with the values 64 and 192.
 */
static void shape_checkerboard(uint32_t size, uint32_t dims[3]) {
    dims[0] = dims[1] = size;
    dims[2] = 3;
}

static void fill_checkerboard(const void *prepared, const uint32_t dims[3], size_t begin,
                              size_t end, void *voxels) {
    (void)prepared;
    uint32_t square = dims[0] < 32 ? 1 : dims[0] / 32;
    for (size_t k = begin; k < end; k++)
        for (uint32_t j = 0; j < dims[1]; j++) {
            uint8_t *row = (uint8_t *)voxels + (k * dims[1] + j) * dims[0];
            for (uint32_t i = 0; i < dims[0]; i++)
                row[i] = (i / square + j / square) % 2 ? 64 : 192;
        }
}

const struct sp_demo_maker sp_demo_checkerboard = {
    .demo = { "checkerboard", "three layers of squares, for filters far away and close up", 512 },
    .type = SP_UINT8,
    .shape = shape_checkerboard,
    .fill = fill_checkerboard,
};

/* Hydrogen.
 * Probability density of the 3d (m = 0) orbital: |ψ|² ∝ (3z² − r²)² e^{−2r/3}, lengths in Bohr
 * radii, in a cube of half side 22. Its largest value lies on the z axis at r = 6 and becomes 255.
 */
static void fill_hydrogen(const void *prepared, const uint32_t dims[3], size_t begin, size_t end,
                          void *voxels) {
    (void)prepared;
    const double half_side = 22, peak = 4 * 6 * 6 * 6 * 6 * exp(-4.0);
    double step = 2 * half_side / dims[0];
    for (size_t k = begin; k < end; k++) {
        double z = ((double)k + 0.5) * step - half_side;
        for (uint32_t j = 0; j < dims[1]; j++) {
            uint8_t *row = (uint8_t *)voxels + (k * dims[1] + j) * dims[0];
            double y = (j + 0.5) * step - half_side;
            for (uint32_t i = 0; i < dims[0]; i++) {
                double x = (i + 0.5) * step - half_side, rr = x * x + y * y + z * z;
                double lobe = 3 * z * z - rr;
                row[i] = (uint8_t)(lobe * lobe * exp(sqrt(rr) * (-2.0 / 3)) / peak * 255 + 0.5);
            }
        }
    }
}

const struct sp_demo_maker sp_demo_hydrogen = {
    .demo = { "hydrogen", "electron density of a hydrogen atom's 3d orbital", 128 },
    .type = SP_UINT8,
    .fill = fill_hydrogen,
};
