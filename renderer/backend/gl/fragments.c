/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/fragments.h"

#include <epoxy/gl.h>

enum {
    COUNT_BITS = 5, /* of a pixel's word: how many fragments it has; the rest: where they begin */
    COUNT_MAX = 1 << (32 - COUNT_BITS),
    WORD_OF_FOUR = 16 /* bytes */
};
#define PER_PIXEL_LEAST 2.0 /* fragments per pixel that surfaces make */
_Static_assert(SP_FRAGMENTS_MAX < 1 << COUNT_BITS, "the count of a pixel fits its bits");
_Static_assert(sizeof(struct sp_fragment) == 5 * sizeof(uint32_t), "five words in a shader");

bool gl_fragments_open(struct gl_state *s, struct sp_error *err) {
    return gl_program_late(&s->fragments, "fragments draw_fragments", "", s->device, "layers", err);
}

void gl_fragments_close(struct gl_state *s) {
    glDeleteProgram(s->fragments.program);
    s->fragments = (struct gl_late_program){ 0 };
}

bool gl_fragments_make(struct gl_fragments *fragments, struct gl_state *s,
                       const struct sp_backend_job *job, struct sp_error *err) {
    uint64_t used = sp_samples_bytes(&s->samples, NULL) + sp_classify_cache_bytes(&s->cache, NULL);
    const struct gl_layers_job own = { .job = job,
                                       .bytes_max =
                                           used < s->memory_bytes ? s->memory_bytes - used : 0,
                                       .pool = s->pool,
                                       .arena = &s->arena };
    return gl_layers_make(&s->layers, &own, &fragments->made, err);
}

bool gl_fragments_relate(struct gl_fragments *fragments, const struct gl_frame *f,
                         struct gl_state *s, struct sp_error *err) {
    const double unit = gl_frame_ewa(f)->unit, thickness = f->thickness * unit;
    fragments->insert = (struct sp_insert){ .camera = &f->camera,
                                            .has_splats = f->compositing == SP_COMPOSITE_SPLAT,
                                            .nearest = (double)s->partition.nearest * thickness,
                                            .thickness = thickness,
                                            .reach = f->reach * unit,
                                            .unit = unit };
    return f->compositing != SP_COMPOSITE_SHEET ||
           sp_insert_init_sheets(&fragments->insert, f->grid, f->axis, &s->arena) ||
           sp_arena_fail(&s->arena, "data", err);
}

static uint32_t count_pixels(const struct gl_fragments_band *band) {
    return band->width * (band->end - band->y);
}

/* Bytes before the fragments. */
static uint64_t head_bytes(const struct gl_fragments_band *band) {
    return (band->fragments->insert.planes + (uint64_t)count_pixels(band)) * sizeof(uint32_t);
}

bool gl_fragments_reserve(const struct gl_fragments_band *band, struct sp_error *err) {
    struct gl_state *s = band->state;
    const struct gl_fragments *f = band->fragments;
    if (!f)
        return true;
    s->surfaces.per_pixel =
        s->surfaces.per_pixel > PER_PIXEL_LEAST ? s->surfaces.per_pixel : PER_PIXEL_LEAST;
    uint64_t pixels = count_pixels(band);
    uint64_t count = f->grows ? (uint64_t)(s->surfaces.per_pixel * (double)pixels) : 0;
    if (count >= COUNT_MAX)
        return sp_fail(err, SP_ERR_BUDGET, "", "a band has %llu fragments and at most %d fit",
                       (unsigned long long)count, COUNT_MAX);
    return gl_buffer_reserve(&s->buffers.fragments, "fragments",
                             head_bytes(band) + count * sizeof(struct sp_fragment), s->block_bytes,
                             GL_USE_SCRATCH, err) &&
           (!f->state_words || gl_buffer_reserve(&s->buffers.sheets, "sheets of surfaces",
                                                 pixels * f->state_words * WORD_OF_FOUR,
                                                 s->block_bytes, GL_USE_SCRATCH, err));
}

bool gl_fragments_fit(struct gl_state *s, uint32_t stored, uint32_t most, uint64_t pixels) {
    const double more = 1.25;
    if (stored <= most)
        return true;
    s->surfaces.per_pixel = more * stored / (double)pixels;
    return false;
}

/* Uploads the planes of sheets. */
static bool upload_planes(const struct gl_fragments_band *band, struct sp_error *err) {
    const struct sp_insert *insert = &band->fragments->insert;
    struct sp_arena *arena = &band->state->arena;
    if (!insert->planes)
        return true;
    float *offset = sp_arena_alloc(arena, "planes of sheets", insert->planes, sizeof *offset);
    if (!offset)
        return sp_arena_fail(arena, "planes of sheets", err);
    for (uint32_t i = 0; i < insert->planes; i++)
        offset[i] = (float)insert->offset[i];
    glFinish(); /* the previous frame may still read them */
    gl_buffer_update(&band->state->buffers.fragments, 0, offset, insert->planes * sizeof *offset);
    return true;
}

bool gl_fragments_start(const struct gl_fragments_band *band, uint32_t *most,
                        struct sp_error *err) {
    const uint64_t planes = band->fragments ? band->fragments->insert.planes * sizeof(float) : 0;
    *most = 0;
    if (!band->fragments)
        return true;
    const struct gl_buffer *buffer = &band->state->buffers.fragments;
    uint64_t fit = (buffer->bytes - head_bytes(band)) / sizeof(struct sp_fragment);
    *most = fit < COUNT_MAX ? (uint32_t)fit : COUNT_MAX;
    if (!upload_planes(band, err))
        return false;
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, buffer->name);
    glClearBufferSubData(GL_SHADER_STORAGE_BUFFER, GL_R32UI, (GLintptr)planes,
                         (GLsizeiptr)(head_bytes(band) - planes), GL_RED_INTEGER, GL_UNSIGNED_INT,
                         &(GLuint){ 0 });
    return true;
}

void gl_fragments_use(const struct gl_fragments_band *band) {
    if (!band->fragments)
        return;
    const struct sp_insert *insert = &band->fragments->insert;
    gl_buffer_bind(&band->state->buffers.fragments, GL_FRAGMENTS);
    glUniform4f(6, (float)insert->normal[0], (float)insert->normal[1], (float)insert->normal[2],
                (float)insert->planes);
    glUniform4f(7, (float)insert->nearest, (float)insert->thickness, (float)insert->reach,
                (float)insert->unit);
}

void gl_fragments_finish(const struct gl_fragments_band *band) {
    struct gl_state *s = band->state;
    if (!band->fragments)
        return;
    glUseProgram(s->fragments.program);
    glUniform2ui(0, count_pixels(band), band->fragments->insert.planes);
    gl_buffer_bind(&s->buffers.image, 4);
    gl_buffer_bind(&s->buffers.fragments, GL_FRAGMENTS);
    glDispatchCompute(gl_divide_up(count_pixels(band), GL_GROUP), 1, 1);
}
