/* SPDX-License-Identifier: Apache-2.0
 *
 * Built-in volumes of elements: a curvilinear grid, points, Gaussians, and triangles.
 */
#include <math.h>

#include "data/volume/curvilinear.h"
#include "data/volume/factor.h"
#include "data/volume/procedural.h"

/* A number in [0, 1) that depends on nothing but i and the stream. */
static double random_at(uint32_t i, uint32_t stream) {
    uint32_t h = i * UINT32_C(0x9e3779b1) ^ stream * UINT32_C(0x85ebca6b);
    h = (h ^ h >> 16) * UINT32_C(0x7feb352d);
    h = (h ^ h >> 15) * UINT32_C(0x846ca68b);
    return (h ^ h >> 16) / 4294967296.0;
}

/* Polar.
 * A ring of sound: a standing wave between two cylinders. Nodes lie along the radius, the angle and
 * the height. The first angle is not repeated at the end.
 */

/* The size is the number of angles. */
static void shape_polar(uint32_t size, uint32_t dims[3]) {
    dims[0] = size / 2;
    dims[1] = size;
    dims[2] = size / 4;
}

static void count_polar(uint32_t size, struct sp_elements_shape *shape) {
    uint32_t dims[3];
    shape_polar(size, dims);
    *shape =
        (struct sp_elements_shape){ .kind = SP_KIND_POINTS, .count = dims[0] * dims[1] * dims[2] };
}

static void place_polar(uint32_t size, const struct sp_elements *e, size_t begin, size_t end) {
    uint32_t dims[3];
    shape_polar(size, dims);
    for (size_t i = begin; i < end; i++) {
        double r = 0.4 + 0.6 * ((double)(i % dims[0]) + 0.5) / dims[0];
        double angle = 2 * M_PI * (double)(i / dims[0] % dims[1]) / dims[1];
        double z = 0.5 * ((double)(i / dims[0] / dims[1]) + 0.5) / dims[2];
        e->positions[i][0] = (float)(r * cos(angle));
        e->positions[i][1] = (float)(r * sin(angle));
        e->positions[i][2] = (float)z;
        e->values[i] = (float)(0.5 + 0.5 * cos(5 * angle) * cos(2 * M_PI * (r - 0.4) / 0.6) *
                                         cos(2 * M_PI * z));
    }
}

static void finish_polar(uint32_t size, const struct sp_elements *e) {
    uint32_t dims[3];
    shape_polar(size, dims);
    (void)sp_curvilinear_finish(e, 0, dims);
}

const struct sp_demo_maker sp_demo_polar = {
    .demo = { "polar", "points of a curvilinear grid: a standing wave in a ring", 96 },
    .count = count_polar,
    .place = place_polar,
    .finish = finish_polar,
};

/* Points.
 * Stars of a barred galaxy, brighter in its middle: the disc is exponential in the radius and in
 * the height, which gives the space around each star.
 */
static void count_points(uint32_t size, struct sp_elements_shape *shape) {
    *shape = (struct sp_elements_shape){ .kind = SP_KIND_POINTS, .count = 10 * size * size };
}

static void place_points(uint32_t size, const struct sp_elements *e, size_t begin, size_t end) {
    const double scale = 0.3, height = 0.04, count = 10.0 * size * size;
    for (size_t i = begin; i < end; i++) {
        const uint32_t at = (uint32_t)i;
        /* The sum of two exponentials has the density r·exp(−r/scale) of a disc. */
        double r = -scale * log((1 - random_at(at, 0)) * (1 - random_at(at, 1)));
        double z = -height * log(1 - random_at(at, 2));
        double even = 2 * M_PI * random_at(at, 3), wave = 2 * even - 4 * log(r + 0.1);
        double angle = even + 0.35 * sin(wave); /* gathers stars in two arms */
        double density = count * exp(-r / scale - z / height) /
                         (4 * M_PI * scale * scale * height * (1 + 0.7 * cos(wave)));
        double gap = fmin(cbrt(1 / density), 0.1);
        e->positions[i][0] = (float)(r * cos(angle));
        e->positions[i][1] = (float)(r * sin(angle));
        e->positions[i][2] = (float)(random_at(at, 4) < 0.5 ? -z : z);
        e->values[i] = (float)((0.3 + 0.7 * random_at(at, 5)) * exp(-0.5 * r / scale));
        e->volumes[i] = (float)(gap * gap * gap);
        e->factors[i][0] = e->factors[i][2] = e->factors[i][5] =
            (float)(SP_CURVILINEAR_SIGMA * gap);
    }
}

const struct sp_demo_maker sp_demo_points = {
    .demo = { "points", "10·N² points: stars of a galaxy with two arms", 100 },
    .count = count_points,
    .place = place_points,
};

/* Gaussians.
 * A striped ring of flat Gaussians that shines: its colour depends on the angle γ between the eye
 * and the surface like a sum of Legendre polynomials in cos γ, which the addition theorem turns
 * into spherical harmonics.
 */
static void count_gaussians(uint32_t size, struct sp_elements_shape *shape) {
    *shape = (struct sp_elements_shape){ .kind = SP_KIND_GAUSSIANS,
                                         .count = 2 * size * size,
                                         .degree = 3 };
}

/* The harmonics of trained scenes in a direction: the real ones, with the signs of their code. */
static void harmonics_at(const double n[3], double y[16]) {
    const double a = n[0], b = n[1], c = n[2], aa = a * a, bb = b * b, cc = c * c;
    const double values[16] = { 0.28209479177387814,
                                -0.4886025119029199 * b,
                                0.4886025119029199 * c,
                                -0.4886025119029199 * a,
                                1.0925484305920792 * a * b,
                                -1.0925484305920792 * b * c,
                                0.31539156525252005 * (2 * cc - aa - bb),
                                -1.0925484305920792 * a * c,
                                0.5462742152960396 * (aa - bb),
                                -0.5900435899266435 * b * (3 * aa - bb),
                                2.890611442640554 * a * b * c,
                                -0.4570457994644658 * b * (4 * cc - aa - bb),
                                0.3731763325901154 * c * (2 * cc - 3 * aa - 3 * bb),
                                -0.4570457994644658 * a * (4 * cc - aa - bb),
                                1.445305721320277 * c * (aa - bb),
                                -0.5900435899266435 * a * (aa - 3 * bb) };
    for (int k = 0; k < 16; k++)
        y[k] = values[k];
}

static void color_gaussian(const double normal[3], double stripe, float *harmonics) {
    static const double base[2][3] = { { 0.85, 0.3, 0.15 }, { 0.12, 0.4, 0.65 } };
    static const double weights[4] = { 0, -0.2, 0.1, -0.05 }; /* brightest towards the eye */
    double y[16];
    harmonics_at(normal, y);
    for (int k = 0; k < 16; k++) {
        int degree = k == 0 ? 0 : k < 4 ? 1 : k < 9 ? 2 : 3;
        for (int c = 0; c < 3; c++)
            harmonics[3 * k + c] = (float)(weights[degree] * 4 * M_PI / (2 * degree + 1) * y[k]);
    }
    for (int c = 0; c < 3; c++) {
        double color = stripe * base[0][c] + (1 - stripe) * base[1][c];
        harmonics[c] = (float)((color - 0.5) / y[0]);
    }
}

static void place_gaussians(uint32_t size, const struct sp_elements *e, size_t begin, size_t end) {
    const double count = 2.0 * size * size, major = 1, minor = 0.4;
    const double gap = sqrt(4 * M_PI * M_PI * major * minor / count);
    for (size_t i = begin; i < end; i++) {
        /* Even in the area: the golden ratio spreads the angles around the ring. */
        double u = 2 * M_PI * fmod((double)i * 0.6180339887498949, 1);
        double share = 2 * M_PI * ((double)i + 0.5) / count, v = share;
        for (int step = 0; step < 8; step++) /* v + (minor / major)·sin v = share */
            v -= (v + minor / major * sin(v) - share) / (1 + minor / major * cos(v));
        const double normal[3] = { cos(u) * cos(v), sin(u) * cos(v), sin(v) };
        const double outwards[3] = { cos(u), sin(u), 0 };
        const double around[3] = { -sin(u), cos(u), 0 };
        const double across[3] = { -cos(u) * sin(v), -sin(u) * sin(v), cos(v) };
        double m[3][3], wide = 0.5 + random_at((uint32_t)i, 0);
        for (int a = 0; a < 3; a++) {
            e->positions[i][a] = (float)(minor * normal[a] + major * outwards[a]);
            m[a][0] = gap * wide * around[a];
            m[a][1] = gap / wide * across[a];
            m[a][2] = 0.05 * gap * normal[a];
        }
        sp_factor((const double(*)[3])m, e->factors[i]);
        e->opacities[i] = (float)(0.5 + 0.49 * random_at((uint32_t)i, 1));
        color_gaussian(normal, sin(6 * u + 3 * v) > 0, e->harmonics + 48 * i);
    }
}

const struct sp_demo_maker sp_demo_gaussians = {
    .demo = { "gaussians", "2·N² Gaussians with spherical harmonics: a striped ring", 100 },
    .count = count_gaussians,
    .place = place_gaussians,
};

/* Torus.
 * A mesh of N·N quadrilaterals whose colour winds around it.
 */
static void count_torus(uint32_t size, struct sp_elements_shape *shape) {
    *shape = (struct sp_elements_shape){ .kind = SP_KIND_MESH,
                                         .count = 2 * size * size,
                                         .vertex_count = size * size };
}

static void place_corner(uint32_t size, const struct sp_elements *e, uint32_t i) {
    const double major = 1, minor = 0.4;
    const double u = 2 * M_PI * (i % size) / size, v = 2 * M_PI * (i / size) / size;
    const double normal[3] = { cos(u) * cos(v), sin(u) * cos(v), sin(v) };
    const double outwards[3] = { cos(u), sin(u), 0 };
    const double band = 0.5 + 0.5 * tanh(4 * sin(6 * u + 3 * v));
    static const double colors[2][3] = { { 0.85, 0.45, 0.15 }, { 0.15, 0.4, 0.6 } };
    for (int a = 0; a < 3; a++) {
        e->positions[i][a] = (float)(minor * normal[a] + major * outwards[a]);
        e->normals[i][a] = (float)normal[a];
        e->colors[i][a] = (float)(band * colors[0][a] + (1 - band) * colors[1][a]);
    }
    e->colors[i][3] = 1;
}

static void place_torus(uint32_t size, const struct sp_elements *e, size_t begin, size_t end) {
    for (size_t t = begin; t < end; t++) {
        const uint32_t i = (uint32_t)(t / 2), row = i / size * size, column = i % size;
        const uint32_t next = (column + 1) % size, below = (row + size) % (size * size);
        uint32_t *corners = e->triangles[t];
        corners[0] = i;
        corners[1] = t % 2 ? below + next : row + next;
        corners[2] = t % 2 ? below + column : below + next;
        if (t % 2 == 0)
            place_corner(size, e, i);
    }
}

const struct sp_demo_maker sp_demo_torus = {
    .demo = { "torus", "2·N² triangles: a torus of two colours", 256 },
    .count = count_torus,
    .place = place_torus,
};
