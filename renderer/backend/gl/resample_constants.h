/* SPDX-License-Identifier: Apache-2.0
 *
 * The constants of a frame of resampled sheets, and its squares: the image's tiles of 64 × 64 px,
 * each with the rays of its own (draw/resample/rays.h). A square whose rays differ too much has
 * four parts instead.
 */
#ifndef GL_RESAMPLE_CONSTANTS_H
#define GL_RESAMPLE_CONSTANTS_H

#include "backend/gl/buffer.h"
#include "base/arena.h"
#include "draw/resample/prepare.h"

/* shaders/resample.glsl: std140, which has the same layout as std430 here. */
struct gl_resample_constants {
    float to_world[3][4], metric[2][4], depths[3][4], steep[4], smoothing[4];
    float code_scale[4], bin_scale[4], above_bins[4];
    float numbers[2][4]; /* of a projection */
    int32_t choices[4];
    int32_t base[4];
    uint32_t regions[4], size[4];
    struct gl_resample_axis {
        float scale[4];
        uint32_t rows[4];
    } axes[3];
    float halves[RESAMPLE_HALVES_MAX][4], gaps[RESAMPLE_HALVES_MAX][4];
    float faces[RESAMPLE_HALVES_MAX][4];
    float magnitudes[SP_GRADIENT_POINTS_MAX][4];
    float sides[RESAMPLE_SIDES_MAX][4];
};

struct gl_resample_square {
    int32_t kind[4];
    float at[4], turn[4], fall[4], centre[4];
};

struct gl_resample_squares {
    struct gl_resample_square *squares; /* squares of the tiles, row by row, then their parts */
    uint32_t count;
    int slices; /* most slices that a square crosses */
    int sheets; /* sheets that some squares need, as in sp_resample_rays */
};

void gl_resample_constants_init(struct gl_resample_constants *constants,
                                const struct sp_resample *resample);

/* False if the arena is out of memory. */
bool gl_resample_squares_init(struct gl_resample_squares *squares,
                              const struct sp_resample *resample, struct sp_arena *arena);

#endif
