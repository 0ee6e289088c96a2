/* SPDX-License-Identifier: Apache-2.0
 *
 * Built-in vector fields: winds in metres per second.
 */
#include <math.h>

#include "data/volume/procedural.h"

/* Tornado.
 * A vortex whose axis leans and bends and whose core widens with the height, as in figure 5 of
 * Crawfis & Max, Texture splats for 3D scalar and vector field visualization, 1993. Across the core
 * the rotation is q·exp((1 − q²)/2), q = distance / radius: at its fastest at q = 1. Air flows in
 * at the ground, up along the core, and outwards where it widens. x and y are in [-1, 1], the
 * height in [0, 1].
 */
struct funnel {               /* at one height */
    float axis[2], lean[2];   /* place of the axis; its derivative */
    float radius, widening;   /* of the core; its derivative */
    float spin, lift, inflow; /* largest speeds, m/s */
};

static struct funnel funnel_at(float h) {
    float speed = 95 * (1 - 0.5f * h);
    return (struct funnel){
        .axis = { 0.42f * h * h - 0.2f + 0.05f * sinf(7 * h), 0.14f * sinf(4.5f * h + 0.4f) },
        .lean = { 0.84f * h + 0.35f * cosf(7 * h), 0.63f * cosf(4.5f * h + 0.4f) },
        .radius = 0.05f + 0.1f * h + 0.22f * h * h * h,
        .widening = 0.1f + 0.66f * h * h,
        .spin = speed,
        .lift = 0.5f * speed * (1 - expf(-8 * h)),
        .inflow = 0.45f * speed * expf(-10 * h),
    };
}

static void blow_tornado(const uint32_t dims[3], size_t begin, size_t end, float (*vectors)[3]) {
    for (size_t k = begin; k < end; k++) {
        const struct funnel f = funnel_at(((float)k + 0.5f) / (float)dims[2]);
        for (uint32_t j = 0; j < dims[1]; j++) {
            float(*row)[3] = vectors + (k * dims[1] + j) * dims[0];
            float y = (2 * (float)j + 1) / (float)dims[1] - 1 - f.axis[1];
            for (uint32_t i = 0; i < dims[0]; i++) {
                float x = (2 * (float)i + 1) / (float)dims[0] - 1 - f.axis[0];
                float qq = (x * x + y * y) / (f.radius * f.radius);
                float core = expf(-0.5f * qq), up = f.lift * core;
                float around = f.spin * expf(0.5f * (1 - qq)) / f.radius;
                float out = (f.widening * up - f.inflow * expf(0.5f * (1 - qq))) / f.radius;
                row[i][0] = -around * y + out * x + f.lean[0] * up;
                row[i][1] = around * x + out * y + f.lean[1] * up;
                row[i][2] = up;
            }
        }
    }
}

const struct sp_demo_maker sp_demo_tornado = {
    .demo = { "tornado", "a vector field: wind that rotates around a leaning funnel and rises",
              96 },
    .type = SP_FLOAT32,
    .flow = blow_tornado,
};

/* Jet.
 * A jet stream in a flat layer: a band of west wind that meanders, with weak wind from the east on
 * both sides. At each height the stream function is −∫f dd, and d the distance from the middle of
 * the band in half widths, so the wind has no divergence. x is in [0, 2], y in [-0.5, 0.5] and z in
 * [-0.25, 0.25]. The band lies higher on its left than on its right.
 */
static const float half_width = 0.1f;

struct bend {            /* at one x */
    float middle, slope; /* y of the middle of the band; its derivative */
    float scale, growth; /* length along y of one half width; its derivative */
};

static struct bend bend_at(float x) {
    const float wave = (float)(2 * M_PI) * 0.9f, phase = 0.8f;
    float swing = 0.16f + 0.04f * x, s = sinf(wave * x - phase), c = cosf(wave * x - phase);
    float slope = swing * wave * c + 0.04f * s;
    float curvature = -swing * wave * wave * s + 0.08f * wave * c, steep = sqrtf(1 + slope * slope);
    return (struct bend){ swing * s, slope, half_width * steep,
                          half_width * slope * curvature / steep };
}

static float bell(float d) { /* sech² */
    float c = coshf(d);
    return 1 / (c * c);
}

static float layer(float z, float height, float thickness) {
    float q = (z - height) / thickness;
    return expf(-0.5f * q * q);
}

static void shape_jet(uint32_t size, uint32_t dims[3]) {
    dims[0] = size;
    dims[1] = size / 2;
    dims[2] = size / 4;
}

static void blow_jet(const uint32_t dims[3], size_t begin, size_t end, float (*vectors)[3]) {
    const float step = 2 / (float)dims[0], fastest = 75;
    for (uint32_t i = 0; i < dims[0]; i++) {
        const struct bend b = bend_at(((float)i + 0.5f) * step);
        for (uint32_t j = 0; j < dims[1]; j++) {
            float y = ((float)j + 0.5f) * step - 0.5f * (float)dims[1] * step;
            float d = (y - b.middle) / b.scale;
            float west = bell(d), east = 0.3f * (bell(0.9f * d - 2.2f) + bell(0.9f * d + 2.2f));
            float height = 0.04f * tanhf(d);
            for (size_t k = begin; k < end; k++) {
                float z = ((float)k + 0.5f) * step - 0.5f * (float)dims[2] * step;
                float f = west * layer(z, height, 0.06f) - east * layer(z, -height, 0.07f);
                float along = fastest * f * half_width / b.scale;
                float *v = vectors[(k * dims[1] + j) * dims[0] + i];
                v[0] = along;
                v[1] = along * (b.slope + d * b.growth);
                v[2] = 0;
            }
        }
    }
}

const struct sp_demo_maker sp_demo_jet = {
    .demo = { "jet", "a vector field: a band of wind that meanders in a flat layer", 128 },
    .type = SP_FLOAT32,
    .shape = shape_jet,
    .flow = blow_jet,
};
