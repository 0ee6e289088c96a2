/* SPDX-License-Identifier: Apache-2.0 */
#include "frame/antialias.h"

#include <string.h>

enum { CHANNELS = 4, RING = 3 };

/* Rows [begin, end), which one worker filters. Other workers change the rows beside them, so both
 * are copied first. */
struct band {
    uint32_t begin, end;
    const void *above, *below; /* rows begin − 1 and end */
    float *line;               /* a row with a pixel more at each end */
    float *ring[RING];         /* rows that are filtered across: row y is at y % RING */
};

struct filter {
    struct sp_frame *frame;
    float weight; /* a of the header */
    struct band *bands;
};

static void *row_at(const struct sp_frame *frame, uint32_t y) {
    return (char *)frame->pixels + (size_t)y * frame->stride_bytes;
}

/* Reads `count` pixels as premultiplied floats, bytes from 0 to 255. */
static void read_pixels(const struct sp_frame *frame, const void *row, float *to) {
    const size_t count = frame->width;
    const unsigned char *bytes = row;
    if (frame->format == SP_RGBAF32) {
        memcpy(to, row, count * CHANNELS * sizeof *to);
        return;
    }
    for (size_t i = 0; i < count * CHANNELS; i++)
        to[i] = (float)bytes[i];
    for (size_t i = 0; !frame->is_opaque && i < count; i++)
        for (int c = 0; c < 3; c++)
            to[CHANNELS * i + c] *= to[CHANNELS * i + 3] * (1 / 255.0f);
}

static void write_pixels(const struct sp_frame *frame, float *from, void *row) {
    const size_t count = frame->width;
    unsigned char *bytes = row;
    if (frame->format == SP_RGBAF32) {
        memcpy(row, from, count * CHANNELS * sizeof *from);
        return;
    }
    for (size_t i = 0; !frame->is_opaque && i < count; i++)
        for (int c = 0; c < 3; c++) {
            const float alpha = from[CHANNELS * i + 3], *color = &from[CHANNELS * i + c];
            from[CHANNELS * i + c] = alpha > 0 ? *color * 255 / alpha : 0;
        }
    for (size_t i = 0; i < count * CHANNELS; i++)
        bytes[i] = (unsigned char)(int)(from[i] + 0.5f);
}

/* Filters a row across, into its place in the ring. */
static void filter_across(const struct filter *f, const struct band *band, const void *row,
                          uint32_t y) {
    const size_t width = f->frame->width;
    const float a = f->weight, rest = 1 - 2 * a;
    float *restrict line = band->line, *restrict to = band->ring[y % RING];
    read_pixels(f->frame, row, line + CHANNELS);
    memcpy(line, line + CHANNELS, CHANNELS * sizeof *line);
    memcpy(line + (width + 1) * CHANNELS, line + width * CHANNELS, CHANNELS * sizeof *line);
    for (size_t i = 0; i < width * CHANNELS; i++)
        to[i] = a * (line[i] + line[i + 2 * CHANNELS]) + rest * line[i + CHANNELS];
}

static void filter_down(const struct filter *f, const struct band *band, uint32_t y) {
    const size_t count = (size_t)f->frame->width * CHANNELS;
    const float a = f->weight, rest = 1 - 2 * a;
    const float *restrict above = band->ring[(y + RING - 1) % RING],
                          *restrict here = band->ring[y % RING],
                          *restrict below = band->ring[(y + 1) % RING];
    float *restrict line = band->line;
    for (size_t i = 0; i < count; i++)
        line[i] = a * (above[i] + below[i]) + rest * here[i];
    write_pixels(f->frame, line, row_at(f->frame, y));
}

static void filter_band(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct filter *f = user;
    for (size_t i = begin; i < end; i++) {
        const struct band *band = &f->bands[i];
        filter_across(f, band, band->above, band->begin + RING - 1);
        filter_across(f, band, row_at(f->frame, band->begin), band->begin);
        for (uint32_t y = band->begin; y < band->end; y++) {
            const bool is_last = y + 1 == band->end;
            filter_across(f, band, is_last ? band->below : row_at(f->frame, y + 1), y + 1);
            filter_down(f, band, y);
        }
    }
}

/* Gives the band its rows and its memory; false without memory. */
static bool open_band(const struct sp_frame *frame, struct sp_arena *arena, struct band *band) {
    const size_t bytes = frame->stride_bytes, floats = ((size_t)frame->width + 2) * CHANNELS;
    const uint32_t last = frame->height - 1;
    char *beside = sp_arena_alloc(arena, "antialiasing", 2, bytes);
    float *rows = sp_arena_alloc(arena, "antialiasing", (1 + RING) * floats, sizeof *rows);
    if (!beside || !rows)
        return false;
    memcpy(beside, row_at(frame, band->begin ? band->begin - 1 : 0), bytes);
    memcpy(beside + bytes, row_at(frame, band->end < last ? band->end : last), bytes);
    band->above = beside;
    band->below = beside + bytes;
    band->line = rows;
    for (int i = 0; i < RING; i++)
        band->ring[i] = rows + (1 + (size_t)i) * floats;
    return true;
}

bool sp_antialias(struct sp_frame *frame, float strength, struct sp_arena *arena,
                  struct sp_pool *pool, struct sp_error *err) {
    const uint32_t threads = sp_pool_threads(pool), height = frame->height;
    const uint32_t count = threads < height ? threads : height;
    struct filter f = { .frame = frame, .weight = strength * ANTIALIAS_WEIGHT };
    f.bands = sp_arena_alloc(arena, "antialiasing", count, sizeof *f.bands);
    if (!f.bands)
        return sp_arena_fail(arena, "antialiasing", err);
    for (uint32_t i = 0; i < count; i++) {
        f.bands[i] = (struct band){ .begin = (uint32_t)((uint64_t)height * i / count),
                                    .end = (uint32_t)((uint64_t)height * (i + 1) / count) };
        if (!open_band(frame, arena, &f.bands[i]))
            return sp_arena_fail(arena, "antialiasing", err);
    }
    sp_parallel_for(pool, count, 1, filter_band, &f);
    return true;
}
