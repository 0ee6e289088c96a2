/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/fragments.h"

#include <epoxy/gl.h>
#include <string.h>

enum {
    COUNT_BITS = 5, /* of a pixel's word: how many fragments it has; the rest: where they begin */
    COUNT_MOST = 1 << (32 - COUNT_BITS)
};
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

/* Words of the part, and how many fragments it has. */
static uint64_t count_words(const struct gl_fragments_part *part, uint64_t *count) {
    const struct gl_fragments *f = part->fragments;
    const uint32_t *first;
    *count = 0;
    for (uint32_t y = part->y; y < part->end; y++)
        for (int c = 0; c < f->made.fragments.columns; c++) {
            uint32_t own;
            find_row(&f->made.fragments, c, y, &first, &own);
            *count += own;
        }
    return f->insert.slices + (uint64_t)count_pixels(part) +
           *count * sizeof(struct sp_fragment) / sizeof(uint32_t);
}

bool gl_fragments_reserve(const struct gl_fragments_part *part, struct sp_error *err) {
    struct gl_state *s = part->state;
    uint64_t count, words;
    if (!part->fragments)
        return true;
    words = count_words(part, &count);
    if (count >= COUNT_MOST)
        return sp_fail(err, SP_ERR_BUDGET, "", "a band has %llu fragments and at most %d fit",
                       (unsigned long long)count, COUNT_MOST);
    return gl_buffer_reserve(&s->buffers.fragments, "fragments", words * sizeof(uint32_t),
                             s->block_bytes, GL_USE_STREAM, err);
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

bool gl_fragments_upload(const struct gl_fragments_part *part, struct sp_error *err) {
    const struct gl_buffer *buffer = &part->state->buffers.fragments;
    const uint32_t width = part->width;
    uint64_t count, bytes;
    if (!part->fragments)
        return true;
    const struct sp_insert *insert = &part->fragments->insert;
    bytes = count_words(part, &count) * sizeof(uint32_t);
    float *planes = gl_buffer_map(buffer, bytes, err);
    if (!planes)
        return false;
    for (uint32_t i = 0; i < insert->slices; i++)
        planes[i] = (float)insert->offset[i];
    uint32_t *pixels = (uint32_t *)(void *)(planes + insert->slices), before = 0;
    struct sp_fragment *list = (struct sp_fragment *)(void *)(pixels + count_pixels(part));
    for (uint32_t y = part->y; y < part->end; y++)
        before = write_row(part, y, before, pixels + (size_t)(y - part->y) * width, list);
    part->state->upload.bytes += bytes;
    return gl_buffer_unmap(buffer, err);
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
