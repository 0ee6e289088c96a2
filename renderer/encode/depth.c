/* SPDX-License-Identifier: Apache-2.0
 *
 * The depth of a frame as a small PNG (sp/encode.h).
 */
#include <assert.h>
#include <math.h>

#include "encode/encoder.h"

/* Two surfaces lie in a cell if its depths differ by more than this part of the frame's range. */
#define STEP_PART (1.0f / 16)

/* What is quantised: rises towards the eye, and is affine on the image of a plane. */
static float value_of(float depth, enum sp_projection projection) {
    return projection == SP_PERSPECTIVE ? 1 / depth : -depth;
}

struct range { /* of values */
    float farthest, nearest;
};

static const float *row_of(const struct sp_frame *frame, const float *plane, uint32_t y) {
    return (const float *)((const char *)plane + y * frame->depth_stride_bytes);
}

/* False: the frame shows nothing. */
static bool range_of(const struct sp_frame *frame, enum sp_projection projection,
                     struct range *range) {
    float least = INFINITY, most = -INFINITY;
    for (uint32_t y = 0; y < frame->height; y++) {
        const float *depths = row_of(frame, frame->depth, y);
        for (uint32_t x = 0; x < frame->width; x++) {
            least = depths[x] < least ? depths[x] : least;
            most = depths[x] < INFINITY && depths[x] > most ? depths[x] : most;
        }
    }
    *range = (struct range){ .farthest = value_of(most, projection),
                             .nearest = value_of(least, projection) };
    return least < INFINITY;
}

struct cell { /* means over the nearest surface */
    float value, spread;
    uint32_t count; /* of pixels; 0 = the cell shows nothing */
};

static struct cell cell_of(const struct sp_frame *frame, enum sp_projection projection, float step,
                           uint32_t column, uint32_t row) {
    const uint32_t from[2] = { column * SP_DEPTH_CELL, row * SP_DEPTH_CELL };
    const uint32_t ends[2] = { from[0] + SP_DEPTH_CELL, from[1] + SP_DEPTH_CELL };
    const uint32_t to[2] = { ends[0] < frame->width ? ends[0] : frame->width,
                             ends[1] < frame->height ? ends[1] : frame->height };
    float nearest = INFINITY;
    for (uint32_t y = from[1]; y < to[1]; y++) {
        const float *depths = row_of(frame, frame->depth, y);
        for (uint32_t x = from[0]; x < to[0]; x++)
            nearest = depths[x] < nearest ? depths[x] : nearest;
    }
    struct cell cell = { .count = 0 };
    if (nearest == INFINITY)
        return cell;
    const float least = value_of(nearest, projection) - step;
    for (uint32_t y = from[1]; y < to[1]; y++) {
        const float *depths = row_of(frame, frame->depth, y);
        const float *spreads = row_of(frame, frame->spread, y);
        for (uint32_t x = from[0]; x < to[0]; x++) {
            const float value = value_of(depths[x], projection);
            if (depths[x] == INFINITY || value < least)
                continue;
            cell.value += value;
            cell.spread += spreads[x];
            cell.count++;
        }
    }
    cell.value /= (float)cell.count;
    cell.spread /= (float)cell.count;
    return cell;
}

/* Writes the depth of a cell to pixel[0], and its spread to pixel[spread_at]: see sp/encode.h. */
static void quantise(const struct cell *cell, const struct range *range, float spread_scale,
                     uint8_t *pixel, size_t spread_at) {
    const float extent = range->nearest - range->farthest;
    const float part = extent > 0 ? (cell->value - range->farthest) / extent : 1;
    const uint8_t spread = (uint8_t)fminf(255, cell->spread * spread_scale);
    pixel[0] = cell->count ? (uint8_t)(1.5f + 254 * fminf(fmaxf(part, 0), 1)) : 0;
    pixel[spread_at] = (uint8_t)(spread / SP_DEPTH_SPREAD_STEP * SP_DEPTH_SPREAD_STEP);
}

bool sp_encode_depth(struct sp_encoder *encoder, const struct sp_frame *frame,
                     enum sp_projection projection, struct sp_depth_image *image,
                     struct sp_error *err) {
    assert(frame->depth && frame->spread);
    const uint32_t columns = (frame->width + SP_DEPTH_CELL - 1) / SP_DEPTH_CELL;
    const uint32_t rows = (frame->height + SP_DEPTH_CELL - 1) / SP_DEPTH_CELL;
    const size_t count = (size_t)columns * rows;
    struct range range;
    *image = (struct sp_depth_image){ .byte_count = 0 };
    if (!range_of(frame, projection, &range))
        return true;
    if (!sp_buffer_reserve(&encoder->pixels, 2 * count, err))
        return false;
    const bool is_perspective = projection == SP_PERSPECTIVE;
    const float near = is_perspective ? 1 / range.nearest : -range.nearest;
    const float far = is_perspective ? 1 / range.farthest : -range.farthest;
    const float step = STEP_PART * (range.nearest - range.farthest);
    const float spread_scale = far > near ? 255 / (far - near) : 0;
    for (uint32_t y = 0; y < rows; y++) {
        for (uint32_t x = 0; x < columns; x++) {
            const struct cell cell = cell_of(frame, projection, step, x, y);
            quantise(&cell, &range, spread_scale, encoder->pixels.bytes + y * (size_t)columns + x,
                     count);
        }
    }
    const struct sp_raster raster = { .pixels = encoder->pixels.bytes,
                                      .width = columns,
                                      .height = 2 * rows,
                                      .stride = columns,
                                      .is_grey = true };
    if (!sp_encode_png(encoder, &raster, err))
        return false;
    *image = (struct sp_depth_image){ .cells = { columns, rows },
                                      .near = near,
                                      .far = far,
                                      .bytes = encoder->output.bytes,
                                      .byte_count = encoder->output.size };
    return true;
}
