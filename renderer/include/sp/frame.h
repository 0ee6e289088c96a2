/* SPDX-License-Identifier: Apache-2.0
 *
 * A frame: one finished image, reference-counted, its memory recycled through a pool.
 * Row 0 is the top row. Rows start at multiples of 64 bytes.
 */
#ifndef SP_FRAME_H
#define SP_FRAME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/status.h"

enum sp_pixel_format {
    SP_RGBA8,  /* 4 bytes, sRGB display values, NOT associated alpha, over the view's background */
    SP_RGBAF32 /* 4 floats, ASSOCIATED alpha, over the background (an opaque background gives alpha
                  1) */
};

enum { SP_STAGES_MAX = 8 };
struct sp_stage_time {
    const char *name;
    double ms;
}; /* name: constant string, "classify", "splat", "bin", "tile", "resolve"; of a GPU also "read" */

enum { SP_DEVICE_NAME = 128 };

struct sp_frame_stats {
    const char *backend;         /* constant: "cpu", "null", … */
    const char *isa;             /* constant: "scalar", … or "" */
    char device[SP_DEVICE_NAME]; /* the CPU's or GPU's name */
    uint32_t threads;
    uint32_t mip_level;       /* 0 = all voxels, n = 2^n × 2^n × 2^n averaged into one */
    uint64_t visible_voxels;  /* after classification */
    uint64_t splats;          /* drawn: not culled */
    uint64_t fragments;       /* pixels touched by footprints, before early termination */
    double render_ms, cpu_ms; /* wall, and the sum over all threads */
    uint32_t stage_count;
    struct sp_stage_time stages[SP_STAGES_MAX];
};

struct sp_frame {
    uint32_t width, height; /* px, [1, 8192] */
    enum sp_pixel_format format;
    size_t stride_bytes; /* multiple of 64 */
    void *pixels;        /* 64-byte aligned, height · stride_bytes, owned by the frame */
    bool is_opaque;      /* every alpha is 1, to 8 bits; false = that is not known */
    struct sp_frame_stats stats;
};

struct sp_frame_pool;

/* `cap_bytes` of idle memory are kept for reuse. NULL with *err set when out of memory. */
struct sp_frame_pool *sp_frame_pool_create(size_t cap_bytes, struct sp_error *err);
void sp_frame_pool_destroy(
    struct sp_frame_pool **pool); /* frames still referenced stay valid and free themselves later */

/* One reference to a frame whose pixels are not initialised; NULL with *err set. Thread-safe. */
struct sp_frame *sp_frame_create(struct sp_frame_pool *pool, uint32_t width, uint32_t height,
                                 enum sp_pixel_format format, struct sp_error *err);
struct sp_frame *sp_frame_ref(struct sp_frame *frame);
void sp_frame_unref(struct sp_frame **frame); /* accepts NULL, nulls; the last one gives the memory
                                                 back; thread-safe */

#endif
