/* SPDX-License-Identifier: Apache-2.0
 *
 * A four-cylinder engine block, by constructive solid geometry on signed distances (in units of
 * half the length; x along the crankshaft, z up):
 *
 *        bolts  ║ liners  ║        block of cast aluminium, steel liners and bolts, a water jacket
 *      ┌──╨─┬──┬─┬──┬─╨──┐         around each bore, oil gallery, crankcase with bearing webs,
 *      │  ║ │  │ │  │ ║  │▌        flange with bolt holes at one end
 *      │    └──┘ └──┘    │▌
 *      └──╮  ╭─┬─╮  ╭────┘▌
 */
#include <math.h>

#include "base/minmax.h"
#include "data/volume/procedural.h"

enum { AIR = 0, ALUMINIUM = 110, STEEL = 190, BOLT = 235 };
static const float pitch = 0.38f; /* between bores */

/* Distance to the nearest of the places first, first + pitch, … along x. */
static float fold(float x, float first, int count) {
    float i = sp_clampf(rintf((x - first) / pitch), 0, (float)(count - 1));
    return x - first - i * pitch;
}

static float box(float x, float y, float z, float hx, float hy, float hz, float radius) {
    float dx = fabsf(x) - hx + radius, dy = fabsf(y) - hy + radius, dz = fabsf(z) - hz + radius;
    float ox = fmaxf(dx, 0), oy = fmaxf(dy, 0), oz = fmaxf(dz, 0);
    return sqrtf(ox * ox + oy * oy + oz * oz) + fminf(fmaxf(dx, fmaxf(dy, dz)), 0) - radius;
}

/* Cylinder of a radius, along the third coordinate from `low` to `high`. */
static float cylinder(float a, float b, float c, float radius, float low, float high) {
    float side = sqrtf(a * a + b * b) - radius, end = fmaxf(low - c, c - high);
    return fmaxf(side, end);
}

static float hexagon(float a, float b, float c, float apothem, float low, float high) {
    a = fabsf(a);
    b = fabsf(b);
    return fmaxf(fmaxf(a * 0.8660254f + b * 0.5f, b) - apothem, fmaxf(low - c, c - high));
}

static float block_distance(float x, float y, float z) {
    float d = box(x, y, z, 0.84f, 0.40f, 0.44f, 0.05f);
    d = fminf(d, box(x - 0.88f, y, z + 0.05f, 0.05f, 0.50f, 0.45f, 0.04f));        /* flange */
    d = fminf(d, box(x, fabsf(y) - 0.43f, z + 0.42f, 0.84f, 0.07f, 0.05f, 0.02f)); /* feet */

    float bore = fold(x, -1.5f * pitch, 4);
    d = fmaxf(d, -cylinder(bore, y, z, 0.135f, -0.12f, 1));           /* bores */
    float jacket = fmaxf(cylinder(bore, y, z, 0.225f, -0.02f, 0.36f), /* water jacket */
                         -cylinder(bore, y, z, 0.185f, -1, 1));
    d = fmaxf(d, -jacket);
    float bay = fmaxf(cylinder(y, z + 0.40f, x, 0.30f, -0.75f, 0.75f), fabsf(bore) - 0.165f);
    d = fmaxf(d, -bay);                                             /* crankcase, with webs left */
    d = fmaxf(d, -cylinder(y, z + 0.40f, x, 0.11f, -1, 1));         /* main bearings */
    d = fmaxf(d, -cylinder(y - 0.33f, z + 0.12f, x, 0.03f, -1, 1)); /* oil gallery */
    d = fmaxf(d, -cylinder(y + 0.33f, z + 0.12f, x, 0.03f, -0.7f, 1));
    d = fmaxf(d, -cylinder(bore, z - 0.16f, fabsf(y), 0.05f, 0.20f, 1)); /* core plugs */
    float hole = fminf(cylinder(fabsf(y) - 0.42f, fabsf(z + 0.05f) - 0.36f, x, 0.03f, 0.8f, 1),
                       cylinder(fabsf(y) - 0.42f, z + 0.05f, x, 0.03f, 0.8f, 1));
    return fmaxf(d, -hole); /* flange bolts */
}

static float liner_distance(float x, float y, float z) {
    float bore = fold(x, -1.5f * pitch, 4);
    return fmaxf(cylinder(bore, y, z, 0.155f, -0.14f, 0.455f), -cylinder(bore, y, z, 0.13f, -1, 1));
}

static float bolt_distance(float x, float y, float z) {
    float bolt = fold(x, -2 * pitch, 5), side = fabsf(y) - 0.32f;
    return fminf(cylinder(bolt, side, z, 0.032f, 0.0f, 0.5f),
                 hexagon(bolt, side, z, 0.055f, 0.44f, 0.51f));
}

static void shape_engine(uint32_t size, uint32_t dims[3]) {
    dims[0] = size;
    dims[1] = dims[2] = (size * 9 + 15) / 16;
}

static void fill_engine(const void *prepared, const uint32_t dims[3], size_t begin, size_t end,
                        void *voxels) {
    (void)prepared;
    /* Flat faces and edges bear a steeper step than round ones. */
    float h = 2.0f / (float)dims[0], per_voxel = 1.6f / h;
    for (size_t k = begin; k < end; k++) {
        float z = ((float)k + 0.5f - 0.5f * (float)dims[2]) * h - 0.02f;
        for (uint32_t j = 0; j < dims[1]; j++) {
            uint8_t *row = (uint8_t *)voxels + (k * dims[1] + j) * dims[0];
            float y = ((float)j + 0.5f - 0.5f * (float)dims[1]) * h;
            for (uint32_t i = 0; i < dims[0]; i++) {
                float x = ((float)i + 0.5f - 0.5f * (float)dims[0]) * h;
                float value = AIR;
                value +=
                    (ALUMINIUM - value) * sp_demo_coverage(block_distance(x, y, z) * per_voxel);
                value += (STEEL - value) * sp_demo_coverage(liner_distance(x, y, z) * per_voxel);
                value += (BOLT - value) * sp_demo_coverage(bolt_distance(x, y, z) * per_voxel);
                row[i] = (uint8_t)(value + 0.5f);
            }
        }
    }
}

const struct sp_demo_maker sp_demo_engine = {
    .demo = { "engine", "a four-cylinder engine block: aluminium, steel liners, bolts", 160 },
    .type = SP_UINT8,
    .shape = shape_engine,
    .fill = fill_engine,
};
