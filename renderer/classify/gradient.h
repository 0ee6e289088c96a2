/* SPDX-License-Identifier: Apache-2.0
 *
 * Gradients of the scalar field in world space, by central differences (one-sided at the borders
 * and beside samples that are not finite), quantised to 32 bits:
 *
 *   | 10 bits magnitude | 11 bits v | 11 bits u |
 *
 * The direction is an octahedral map of the unit sphere (Cigolle et al. 2014) with an odd number of
 * steps, so that the axes are exact; it is off by at most an eighth of a degree. The magnitude is
 * stored as the square root of its share of the grid's bound; 0 means a gradient of zero length and
 * no direction.
 *
 * Where the magnitude does not matter, 16 bits keep the direction: 8 bits v, 8 bits u, at most 1.1
 * degrees off; 0 means no direction here as well.
 */
#ifndef SP_CLASSIFY_GRADIENT_H
#define SP_CLASSIFY_GRADIENT_H

#include <math.h>
#include <stdint.h>

#include "data/volume/grid.h"

enum { SP_GRADIENT_STEPS = 1023, SP_GRADIENT_MAGNITUDES = 1023, SP_DIRECTION_STEPS = 127 };

/* The constants of all gradients of one volume. */
struct sp_gradient_grid {
    const void *voxels;
    enum sp_type type;
    const struct sp_grid *grid;
    double to_world[3][3]; /* (direction · spacing)⁻ᵀ: turns differences per spacing into a world
                              gradient */
    double scale;          /* brings samples to order 1 before they are subtracted */
    double bound;          /* largest magnitude possible, scaled; > 0 */
    double unit;           /* magnitude in data units per world unit = unit · stored fraction² */
};

/* Fills all fields but the samples. */
void sp_gradient_units_init(struct sp_gradient_grid *grid, const struct sp_volume_info *info);

/* Borrows the volume's samples. */
void sp_gradient_grid_init(struct sp_gradient_grid *grid, const struct sp_volume *volume);

/* Computes the world gradient at voxel i, times grid->scale, not quantised. */
void sp_gradient_at(const struct sp_gradient_grid *grid, const uint32_t i[3], double gradient[3]);

/* Packs a gradient that is multiplied by grid->scale. */
uint32_t sp_gradient_pack(const struct sp_gradient_grid *grid, const double gradient[3]);

/* Packs the direction of a gradient of any scale into 16 bits. */
uint16_t sp_gradient_pack_direction(const double gradient[3]);

/* Packs the directions of `count` voxels of one brick of an 8- or 16-bit volume. The result is
 * bit-equal to sp_gradient_pack_direction() of sp_gradient_at(). local: i0 | i1 << 4 | i2 << 8,
 * relative to the brick's corner. */
void sp_gradient_pack_directions(const struct sp_gradient_grid *grid, const uint32_t corner[3],
                                 const uint16_t *local, uint32_t count, uint16_t *packed);

/* Converts a 16-bit direction to a packed gradient of the largest magnitude. */
static inline uint32_t sp_gradient_widen(uint16_t direction) {
    /* 1031/128 is SP_GRADIENT_STEPS over SP_DIRECTION_STEPS, rounded to the nearest step. */
    int u = ((direction & 255) - SP_DIRECTION_STEPS) * 1031 + 64;
    int v = ((direction >> 8) - SP_DIRECTION_STEPS) * 1031 + 64;
    uint32_t packed =
        (uint32_t)((u >> 7) + SP_GRADIENT_STEPS) | (uint32_t)((v >> 7) + SP_GRADIENT_STEPS) << 11;
    return direction ? packed | (uint32_t)SP_GRADIENT_MAGNITUDES << 22 : 0;
}

/* Unit direction; (0,0,0) for a packed gradient of zero length. */
static inline void sp_gradient_unpack(uint32_t packed, float direction[3]) {
    const float step = 1.0f / SP_GRADIENT_STEPS;
    float u = (float)((int)(packed & 2047) - SP_GRADIENT_STEPS) * step;
    float v = (float)((int)(packed >> 11 & 2047) - SP_GRADIENT_STEPS) * step;
    float w = 1 - fabsf(u) - fabsf(v);
    float fold = w < 0 ? -w : 0;
    u += u < 0 ? fold : -fold;
    v += v < 0 ? fold : -fold;
    float scale = packed >> 22 ? 1 / sqrtf(u * u + v * v + w * w) : 0;
    direction[0] = u * scale;
    direction[1] = v * scale;
    direction[2] = w * scale;
}

/* Magnitude over grid->unit, in [0, 1]. */
static inline float sp_gradient_share(uint32_t packed) {
    float f = (float)(packed >> 22) * (1.0f / SP_GRADIENT_MAGNITUDES);
    return f * f;
}

/* Magnitude in data units per world unit. */
static inline double sp_gradient_magnitude(const struct sp_gradient_grid *grid, uint32_t packed) {
    double f = (double)(packed >> 22) / SP_GRADIENT_MAGNITUDES;
    return grid->unit * f * f;
}

#endif
