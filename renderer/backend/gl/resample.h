/* SPDX-License-Identifier: Apache-2.0
 *
 * Sheets of interpolated values (draw/resample/README.md) on the GPU:
 * shaders/passes/draw_sheets.glsl draws a block of 8 × 8 px from sheet to sheet. The processor
 * chooses the mip level, marks the intervals between slices that may be visible, and computes the
 * rays of squares of pixels in double precision.
 *
 *   begin   samples, codes, visible intervals and the transfer function's integral are uploaded
 *           unless they are resident; constants and squares always
 *   draw    passes × rows of blocks × ranges of intervals, front to back; a dispatch continues with
 *           the pixels of the previous one
 */
#ifndef GL_RESAMPLE_H
#define GL_RESAMPLE_H

#include "backend/gl/band.h"
#include "backend/gl/resample_data.h"

/* A pass: the image of the slices of one axis, with one or two sheets per slice. Most frames have
 * one pass. The images of several passes are added with their shares (draw/resample/axes.h,
 * draw/resample/rays.h). */
struct gl_resample_pass {
    const struct gl_buffer *constants, *squares, *visible;
    float share;   /* share of the axis in the image */
    int sheets;    /* per slice */
    int intervals; /* most intervals between sheets of a square */
};

enum { GL_RESAMPLE_PASSES = 6 };

/* One frame. */
struct gl_resample_frame {
    struct sp_camera_transform camera;
    struct sp_shade shade;
    struct sp_resample resample;
    struct gl_resample_data data;
    unsigned program;
    struct gl_resample_pass passes[GL_RESAMPLE_PASSES];
    int pass_count;
    uint32_t dispatches;   /* of the band */
    uint32_t rows;         /* of blocks per dispatch */
    int intervals_at_once; /* per dispatch */
};

/* Prepares the frame in the state's arena and uploads what it needs. SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED, SP_ERR_UNSUPPORTED, SP_ERR_BACKEND. A context must be current, here and below.
 */
bool gl_resample_begin(struct gl_resample_frame *frame, const struct gl_band *band,
                       struct sp_error *err);

/* Chooses the rows of the band that begins at band->y and reserves its memory. SP_ERR_MEMORY,
 * SP_ERR_BUDGET. */
bool gl_resample_plan(struct gl_resample_frame *frame, struct gl_band *band, struct sp_error *err);

/* Draws a band that was started. SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_resample_draw(const struct gl_resample_frame *frame, struct gl_band *band,
                      struct sp_error *err);

#endif
