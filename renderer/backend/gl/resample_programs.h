/* SPDX-License-Identifier: Apache-2.0
 *
 * The programs and buffers of resampled sheets (resample.h) that persist from frame to frame,
 * besides the data of volumes.
 */
#ifndef GL_RESAMPLE_PROGRAMS_H
#define GL_RESAMPLE_PROGRAMS_H

#include "backend/gl/buffer.h"

/* The programs of shaders/passes/draw_sheets.glsl by the samples that they read. GL_SAMPLES_CODES:
 * codes that the processor has made from 64-bit reals, or from numbers that a float cannot hold. */
enum gl_samples_kind {
    GL_SAMPLES_UINT8,
    GL_SAMPLES_INT8,
    GL_SAMPLES_UINT16,
    GL_SAMPLES_INT16,
    GL_SAMPLES_INT32,
    GL_SAMPLES_FLOAT32,
    GL_SAMPLES_CODES,
    GL_SAMPLES_KINDS
};

/* Most intervals per dispatch: shared memory has a bit for each. */
enum { GL_RESAMPLE_INTERVALS = 512 };

enum gl_resample_use {
    GL_RESAMPLE_PLAIN,
    GL_RESAMPLE_GRADIENTS,
    GL_RESAMPLE_PROJECTION,
    GL_RESAMPLE_USES
};

struct gl_resample {
    struct gl_resample_program {
        unsigned program;                                    /* 0 = not compiled */
        bool is_refused;                                     /* by the driver: not compiled again */
    } programs[GL_SAMPLES_KINDS][GL_RESAMPLE_USES][2][2][2]; /* by kind, use, with other layers,
                                                               evenly spaced, with depth */
    struct gl_resample_uploads {
        struct gl_buffer constants[3], squares[3]; /* by axis of the slices */
        struct gl_buffer colors;                   /* of the last projection */
    } uploads, before; /* of this frame; of the previous one, which may still read them */
    uint32_t work;     /* blocks times intervals per dispatch */
};

/* Returns the program, which is compiled at the first use; 0 with *err set (SP_ERR_UNSUPPORTED). A
 * context must be current, here and below. */
unsigned gl_resample_open(struct gl_resample *resample, enum gl_samples_kind kind,
                          enum gl_resample_use use, bool has_layers, bool is_even, bool has_depth,
                          const char *device, struct sp_error *err);

/* Adapts the size of dispatches to the longest one of a band. limit_ms: a longer one is too long;
 * INFINITY = none is. */
void gl_resample_adapt(struct gl_resample *resample, double longest_ms, double limit_ms);

/* Begins a frame: its uploads do not overwrite what the previous frame may still read. */
void gl_resample_next(struct gl_resample *resample);

/* Returns the size of the buffers into which frames upload constants [bytes]. */
uint64_t gl_resample_bytes(const struct gl_resample *resample);

void gl_resample_init(struct gl_resample *resample);
void gl_resample_finish(struct gl_resample *resample);

#endif
