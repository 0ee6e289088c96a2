/* SPDX-License-Identifier: Apache-2.0
 *
 * Draws a test card without reading the volume, for server tests and to measure overhead. The image
 * depends on the view alone, so that a test can tell views apart: a gradient in the background's
 * colour, and three bars at the bottom whose lengths show the azimuth, the elevation and the
 * distance of the eye, seen from the target.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "backend/backend.h"
#include "base/vec.h"

struct null_state {
    int unused;
};

static void *null_create(const struct sp_backend_options *options, struct sp_error *err) {
    (void)options;
    struct null_state *state = calloc(1, sizeof *state);
    if (!state)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the null backend");
    return state;
}

static void null_destroy(void *state) {
    free(state);
}

static void null_info(const void *state, struct sp_renderer_info *info) {
    (void)state;
    *info = (struct sp_renderer_info){
        .backend = "null", .device = "test card", .isa = "", .threads = 1
    };
}

/* Computes the lengths of the bars, in [0, 1]. */
static void read_camera(const struct sp_camera *camera, float bars[3]) {
    double e[3], largest = 0;
    for (int i = 0; i < 3; i++) {
        e[i] = camera->position[i] / 4 - camera->target[i] / 4;
        largest = fmax(largest, fabs(e[i]));
    }
    for (int i = 0; i < 3; i++)
        e[i] /= largest;
    double length = sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2]);
    bars[0] = (float)(0.5 + atan2(e[1], e[0]) / (2 * M_PI));
    bars[1] = (float)(0.5 + asin(fmax(-1, fmin(1, e[2] / length))) / M_PI);
    bars[2] = (float)(0.5 + atan(log10(length * largest * 4)) / M_PI);
}

/* Returns the gradient of channel c at fraction t of its axis: red rises to the right, green
 * downwards, blue to the left. */
static float gradient(const struct sp_view *view, int c, float t) {
    return 0.5f * (c == 2 ? 1 - t : t) + 0.5f * view->background[c];
}

static void write_pixel(const struct sp_frame *frame, unsigned char *row, uint32_t x,
                        const float rgb[3]) {
    if (frame->format == SP_RGBAF32) {
        memcpy(row + 16 * (size_t)x, (const float[4]){ rgb[0], rgb[1], rgb[2], 1 }, 16);
        return;
    }
    for (int c = 0; c < 3; c++)
        row[4 * (size_t)x + (unsigned)c] = (unsigned char)(rgb[c] * 255 + 0.5f);
    row[4 * (size_t)x + 3] = 255;
}

/* Red and blue are the same in every row. Therefore the first row is drawn, and every other row is
 * a copy of the row above with its own green. */
static void draw_gradient(const struct sp_view *view, const struct sp_frame *frame,
                          unsigned char *row, uint32_t y) {
    /* A local variable, because a store through `row` might change the member. */
    const size_t width = frame->width;
    float green = gradient(view, 1, ((float)y + 0.5f) / (float)view->size[1]);
    if (y == 0) {
        for (size_t x = 0; x < width; x++) {
            float u = ((float)x + 0.5f) / (float)view->size[0];
            write_pixel(frame, row, (uint32_t)x,
                        (const float[3]){ gradient(view, 0, u), green, gradient(view, 2, u) });
        }
    } else if (frame->format == SP_RGBAF32) {
        memcpy(row, row - frame->stride_bytes, 16 * width);
        float *pixels = (float *)(void *)row;
        for (size_t x = 0; x < width; x++)
            pixels[4 * x + 1] = green;
    } else {
        const unsigned char *above = row - frame->stride_bytes;
        uint32_t keep, add; /* masks as words, independent of the byte order */
        memcpy(&keep, (const unsigned char[4]){ 255, 0, 255, 255 }, sizeof keep);
        memcpy(&add, (const unsigned char[4]){ 0, (unsigned char)(green * 255 + 0.5f), 0, 0 },
               sizeof add);
        for (size_t x = 0; x < width; x++) {
            uint32_t pixel;
            memcpy(&pixel, above + 4 * x, sizeof pixel);
            pixel = (pixel & keep) | add;
            memcpy(row + 4 * x, &pixel, sizeof pixel);
        }
    }
}

/* Draws the bars in the lowest three tenths of the image, one below the other. The first row of
 * each bar is drawn, the other rows are copies of it. */
static void draw_bars(const struct sp_view *view, const struct sp_frame *frame,
                      const float bars[3]) {
    static const float colors[3][3] = { { 0.9f, 0.3f, 0.2f },
                                        { 0.3f, 0.8f, 0.3f },
                                        { 0.3f, 0.5f, 1.0f } };
    const size_t pixel = frame->format == SP_RGBAF32 ? 16 : 4;
    int drawn = -1;
    for (uint32_t y = 0; y < frame->height; y++) {
        float v = ((float)y + 0.5f) / (float)view->size[1];
        int bar = (int)((v - 0.7f) * 10);
        if (v < 0.7f || bar >= 3)
            continue;
        unsigned char *row = (unsigned char *)frame->pixels + y * frame->stride_bytes;
        uint32_t end = (uint32_t)ceilf(bars[bar] * (float)view->size[0] - 0.5f);
        if (bar == drawn)
            memcpy(row, row - frame->stride_bytes, end * pixel);
        for (uint32_t x = 0; x < end && bar != drawn; x++)
            write_pixel(frame, row, x, colors[bar]);
        drawn = bar;
    }
}

static bool null_render(void *state, const struct sp_backend_job *job, struct sp_error *err) {
    (void)state;
    struct sp_frame *frame = job->frame;
    float bars[3];
    read_camera(&job->view->camera, bars);
    for (uint32_t y = 0; y < frame->height; y++) {
        if (y % 16 == 0 && sp_job_is_cancelled(job))
            return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
        draw_gradient(job->view, frame, (unsigned char *)frame->pixels + y * frame->stride_bytes,
                      y);
    }
    draw_bars(job->view, frame, bars);
    frame->stats.stages[0] = (struct sp_stage_time){ .name = "resolve" };
    frame->stats.stage_count = 1;
    return true;
}

extern const struct sp_backend null_backend;
const struct sp_backend null_backend = {
    .entry = { "null", "a test card instead of the volume; no work" },
    .by_name_only = true,
    .capabilities = { .projections = SP_CAN_ALL,
                      .filters = SP_CAN_ALL,
                      .kernels = SP_CAN_ALL,
                      .compositings = SP_CAN_ALL,
                      .attenuations = SP_CAN_ALL,
                      .orders = SP_CAN_ALL,
                      .shadings = SP_CAN_ALL,
                      .levels_of_detail = SP_CAN_ALL,
                      .gradient_axis = true,
                      .interpolated_sheets = true,
                      .light = true,
                      .layers = SP_CAN_ALL,
                      .clip_box = true,
                      .clip_planes = true },
    .create = null_create,
    .destroy = null_destroy,
    .info = null_info,
    .render = null_render,
};
