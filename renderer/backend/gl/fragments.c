/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/fragments.h"

#include <epoxy/gl.h>
#include <stddef.h>
#include <string.h>

enum {
    COUNT_BITS = 5, /* of a pixel's word: how many fragments it has; the rest: where they begin */
    COUNT_MOST = 1 << (32 - COUNT_BITS),
    WORD_OF_FOUR = 16 /* bytes */
};
#define PER_PIXEL_LEAST 2.0 /* fragments per pixel that surfaces make */
_Static_assert(SP_FRAGMENTS_MAX < 1 << COUNT_BITS, "the count of a pixel fits its bits");
_Static_assert(sizeof(struct sp_fragment) == 5 * sizeof(uint32_t), "five words in a shader");

bool gl_fragments_open(struct gl_state *s, struct sp_error *err) {
    struct sp_error why = { .text = "it failed before; the log has the reason" };
    if (!s->fragments.program && !s->fragments.is_refused)
        s->fragments.program = gl_program_open("fragments 31_fragments", "", &why);
    s->fragments.is_refused = !s->fragments.program;
    return s->fragments.program || sp_fail(err, SP_ERR_UNSUPPORTED, "",
                                           "%s has no program for layers: %s", s->device, why.text);
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
    const double thickness = f->thickness * gl_frame_ewa(f)->unit;
    fragments->insert = (struct sp_insert){ .camera = &f->camera,
                                            .nearest = (double)s->partition.nearest * thickness,
                                            .thickness = thickness };
    return f->compositing != SP_COMPOSITE_SHEET ||
           sp_insert_init_sheets(&fragments->insert, f->grid, f->axis, &s->arena) ||
           sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the frame's %s", s->arena.failed);
}

/* The fragments of row y of the image in a column of tiles; *first: of its pixels, in the list. */
static const struct sp_fragment *find_row(const struct sp_fragments *all, int column, uint32_t y,
                                          const uint32_t **first, uint32_t *count) {
    int tile = (int)y / SP_FRAGMENT_TILE * all->columns + column;
    *count = 0;
    if (!all->first[tile])
        return NULL;
    *first = all->first[tile] + y % SP_FRAGMENT_TILE * SP_FRAGMENT_TILE;
    *count = (*first)[SP_FRAGMENT_TILE] - (*first)[0];
    return all->list[tile] + (*first)[0];
}

static uint32_t count_pixels(const struct gl_fragments_part *part) {
    return part->width * (part->end - part->y);
}

/* Fragments that the processor has made of the part. */
static uint64_t count_made(const struct gl_fragments_part *part) {
    const struct gl_layers_made *made = &part->fragments->made;
    const uint32_t *first;
    uint64_t count = 0;
    for (uint32_t y = part->y; made->has_shell && y < part->end; y++)
        for (int c = 0; c < made->fragments.columns; c++) {
            uint32_t own;
            find_row(&made->fragments, c, y, &first, &own);
            count += own;
        }
    return count;
}

/* Bytes before the fragments. */
static uint64_t head_bytes(const struct gl_fragments_part *part) {
    return (part->fragments->insert.slices + (uint64_t)count_pixels(part)) * sizeof(uint32_t);
}

bool gl_fragments_reserve(const struct gl_fragments_part *part, struct sp_error *err) {
    struct gl_state *s = part->state;
    const struct gl_fragments *f = part->fragments;
    if (!f)
        return true;
    s->surfaces.per_pixel =
        s->surfaces.per_pixel > PER_PIXEL_LEAST ? s->surfaces.per_pixel : PER_PIXEL_LEAST;
    uint64_t count = count_made(part), pixels = count_pixels(part);
    count += f->grows ? (uint64_t)(s->surfaces.per_pixel * (double)pixels) : 0;
    if (count >= COUNT_MOST)
        return sp_fail(err, SP_ERR_BUDGET, "", "a band has %llu fragments and at most %d fit",
                       (unsigned long long)count, COUNT_MOST);
    return gl_buffer_reserve(&s->buffers.fragments, "fragments",
                             head_bytes(part) + count * sizeof(struct sp_fragment), s->block_bytes,
                             GL_USE_SCRATCH, err) &&
           (!f->sheet_words || gl_buffer_reserve(&s->buffers.sheets, "sheets of surfaces",
                                                 pixels * f->sheet_words * WORD_OF_FOUR,
                                                 s->block_bytes, GL_USE_SCRATCH, err));
}

bool gl_fragments_fit(struct gl_state *s, uint32_t stored, uint32_t most, uint64_t pixels) {
    const double more = 1.25;
    if (stored <= most)
        return true;
    s->surfaces.per_pixel = more * stored / (double)pixels;
    return false;
}

/* Writes row y; returns how many fragments precede the next one. */
static uint32_t write_row(const struct gl_fragments_part *part, uint32_t y, uint32_t before,
                          uint32_t *pixels, struct sp_fragment *list) {
    const struct sp_fragments *all = &part->fragments->made.fragments;
    const uint32_t width = part->width;
    for (int c = 0; c < all->columns; c++) {
        const uint32_t *first, x = (uint32_t)c * SP_FRAGMENT_TILE;
        uint32_t n, left = width - x < SP_FRAGMENT_TILE ? width - x : SP_FRAGMENT_TILE;
        const struct sp_fragment *from = find_row(all, c, y, &first, &n);
        for (uint32_t i = 0; i < left; i++)
            pixels[x + i] =
                from ? (before + first[i] - first[0]) << COUNT_BITS | (first[i + 1] - first[i]) : 0;
        if (n)
            memcpy(list + before, from, n * sizeof *list);
        before += n;
    }
    return before;
}

/* Uploads the fragments of a shell. */
static bool upload_made(const struct gl_fragments_part *part, uint64_t count,
                        struct sp_error *err) {
    const struct gl_buffer *buffer = &part->state->buffers.fragments;
    const struct sp_insert *insert = &part->fragments->insert;
    uint64_t bytes = head_bytes(part) + count * sizeof(struct sp_fragment);
    float *planes = gl_buffer_map(buffer, bytes, err);
    if (!planes)
        return false;
    for (uint32_t i = 0; i < insert->slices; i++)
        planes[i] = (float)insert->offset[i];
    uint32_t *pixels = (uint32_t *)(void *)(planes + insert->slices), before = 0;
    struct sp_fragment *list = (struct sp_fragment *)(void *)(pixels + count_pixels(part));
    for (uint32_t y = part->y; y < part->end; y++)
        before = write_row(part, y, before, pixels + (size_t)(y - part->y) * part->width, list);
    part->state->upload.bytes += bytes;
    return gl_buffer_unmap(buffer, err);
}

/* Empties all pixels. */
static bool upload_none(const struct gl_fragments_part *part, struct sp_error *err) {
    const struct gl_buffer *buffer = &part->state->buffers.fragments;
    const struct sp_insert *insert = &part->fragments->insert;
    const uint64_t planes = insert->slices * sizeof(float);
    float *offsets = sp_arena_alloc(&part->state->arena, "planes of sheets", insert->slices + 1,
                                    sizeof *offsets);
    if (!offsets)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the frame's planes of sheets");
    for (uint32_t i = 0; i < insert->slices; i++)
        offsets[i] = (float)insert->offset[i];
    if (planes)
        gl_buffer_update(buffer, 0, offsets, planes);
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, buffer->name);
    glClearBufferSubData(GL_SHADER_STORAGE_BUFFER, GL_R32UI, (GLintptr)planes,
                         (GLsizeiptr)(head_bytes(part) - planes), GL_RED_INTEGER, GL_UNSIGNED_INT,
                         &(GLuint){ 0 });
    return true;
}

bool gl_fragments_upload(const struct gl_fragments_part *part, uint32_t *most,
                         struct sp_error *err) {
    const struct gl_state *s = part->state;
    *most = 0;
    if (!part->fragments)
        return true;
    uint64_t fit = (s->buffers.fragments.bytes - head_bytes(part)) / sizeof(struct sp_fragment);
    uint32_t count = (uint32_t)count_made(part);
    *most = fit < COUNT_MOST ? (uint32_t)fit : COUNT_MOST;
    gl_buffer_update(&s->bins.counts, offsetof(struct gl_bins_head, stored), &count, sizeof count);
    return part->fragments->made.has_shell ? upload_made(part, count, err) : upload_none(part, err);
}

void gl_fragments_use(const struct gl_fragments_part *part) {
    if (!part->fragments)
        return;
    const struct sp_insert *insert = &part->fragments->insert;
    gl_buffer_bind(&part->state->buffers.fragments, GL_FRAGMENTS);
    glUniform4f(6, (float)insert->normal[0], (float)insert->normal[1], (float)insert->normal[2],
                (float)insert->slices);
    glUniform2f(7, (float)insert->nearest, (float)insert->thickness);
}

void gl_fragments_finish(const struct gl_fragments_part *part) {
    struct gl_state *s = part->state;
    if (!part->fragments)
        return;
    glUseProgram(s->fragments.program);
    glUniform2ui(0, count_pixels(part), part->fragments->insert.slices);
    gl_buffer_bind(&s->buffers.image, 4);
    gl_buffer_bind(&s->buffers.fragments, GL_FRAGMENTS);
    glDispatchCompute(gl_divide_up(count_pixels(part), GL_GROUP), 1, 1);
}
