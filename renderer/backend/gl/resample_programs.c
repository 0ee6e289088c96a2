/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/resample_programs.h"

#include <epoxy/gl.h>
#include <stdio.h>

#include "backend/gl/program.h"
#include "draw/resample/resample.h"

enum { WORK_FIRST = 1 << 17, WORK_LEAST = 1 << 12, WORK_MAX = 1 << 24 };

/* Short: below 1/5 of the limit, so that twice as much is not long. */
static const double shortness = 5;

unsigned gl_resample_open(struct gl_resample *resample, enum gl_samples_kind kind,
                          enum gl_resample_use use, bool has_layers, bool is_even, bool has_depth,
                          const char *device, struct sp_error *err) {
    static const struct {
        int samples, bytes, is_signed; /* samples: 0 integer, 1 real, 2 codes */
    } kinds[GL_SAMPLES_KINDS] = {
        [GL_SAMPLES_UINT8] = { 0, 1, 0 },  [GL_SAMPLES_INT8] = { 0, 1, 1 },
        [GL_SAMPLES_UINT16] = { 0, 2, 0 }, [GL_SAMPLES_INT16] = { 0, 2, 1 },
        [GL_SAMPLES_INT32] = { 0, 4, 1 },  [GL_SAMPLES_FLOAT32] = { 1, 4, 0 },
        [GL_SAMPLES_CODES] = { 2, 4, 0 },
    };
    struct gl_resample_program *own =
        &resample->programs[kind][use][has_layers][is_even][has_depth];
    struct sp_error why = { .text = "it failed before; the log has the reason" };
    char defines[384];
    snprintf(defines, sizeof defines,
             "#define SAMPLES_INTEGER 0\n#define SAMPLES_REAL 1\n#define SAMPLES %d\n"
             "#define BYTES %du\n#define SIGNED %d\n#define GRADIENT %d\n#define PROJECTION %d\n"
             "#define SQUARE %du\n#define HALVES %d\n#define SIDES %d\n#define MAGNITUDES "
             "%d\n#define INTERVALS %d\n"
             "#define LAYERS %d\n#define EVEN %d\n#define DEPTH %d\n",
             kinds[kind].samples, kinds[kind].bytes, kinds[kind].is_signed,
             use == GL_RESAMPLE_GRADIENTS, use == GL_RESAMPLE_PROJECTION, (unsigned)RESAMPLE_TILE,
             RESAMPLE_HALVES_MAX, RESAMPLE_SIDES_MAX, SP_GRADIENT_POINTS_MAX, GL_RESAMPLE_INTERVALS,
             has_layers, is_even, has_depth);
    if (!own->program && !own->is_refused)
        own->program = gl_program_open(
            has_layers ? "frame shade resample cover seen smooth fragments ordinal draw_sheets"
                       : "frame shade resample cover seen smooth ordinal draw_sheets",
            defines, &why);
    own->is_refused = !own->program;
    if (own->is_refused)
        sp_fail(err, SP_ERR_UNSUPPORTED, "", "%s has no program for this view: %s", device,
                why.text);
    return own->program;
}

void gl_resample_adapt(struct gl_resample *resample, double longest_ms, double limit_ms) {
    uint32_t work = resample->work;
    if (longest_ms > limit_ms)
        work /= 2;
    else if (longest_ms < limit_ms / shortness)
        work *= 2;
    resample->work = work < WORK_LEAST ? WORK_LEAST : work < WORK_MAX ? work : WORK_MAX;
}

void gl_resample_next(struct gl_resample *resample) {
    const struct gl_resample_uploads before = resample->before;
    resample->before = resample->uploads;
    resample->uploads = before;
}

/* Buffers in `uploads` and `before`. */
#define UPLOADS (2 * sizeof(struct gl_resample_uploads) / sizeof(struct gl_buffer))

uint64_t gl_resample_bytes(const struct gl_resample *resample) {
    const struct gl_buffer *buffers = (const struct gl_buffer *)&resample->uploads;
    uint64_t bytes = 0;
    for (size_t i = 0; i < UPLOADS; i++)
        bytes += buffers[i].bytes;
    return bytes;
}

void gl_resample_init(struct gl_resample *resample) {
    resample->work = WORK_FIRST;
}

void gl_resample_finish(struct gl_resample *resample) {
    struct gl_resample_program *programs = &resample->programs[0][0][0][0][0];
    for (size_t i = 0; i < sizeof resample->programs / sizeof *programs; i++)
        glDeleteProgram(programs[i].program);
    struct gl_buffer *buffers = (struct gl_buffer *)&resample->uploads;
    for (size_t i = 0; i < UPLOADS; i++)
        gl_buffer_finish(&buffers[i]);
    *resample = (struct gl_resample){ .work = resample->work };
}
