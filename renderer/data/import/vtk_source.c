/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/vtk_source.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static bool cut_off(const struct vtk_source *s, struct sp_error *err) {
    return import_fail(err, SP_ERR_FORMAT, s->file->title, s->at, s->array->name,
                       "the data ends before the %" PRIu64 " values", s->array->count);
}

static bool fetch(struct vtk_source *s, void *out, size_t n, size_t *got, struct sp_error *err) {
    if (n > s->end - s->at)
        n = (size_t)(s->end - s->at);
    const bool ok = import_read(s->file, out, n, s->at, got, err);
    s->at += *got;
    return ok;
}

static int base64_digit(int c) {
    return c >= 'A' && c <= 'Z'   ? c - 'A'
           : c >= 'a' && c <= 'z' ? c - 'a' + 26
           : c >= '0' && c <= '9' ? c - '0' + 52
           : c == '+'             ? 62
           : c == '/'             ? 63
                                  : -1;
}

/* Decodes one character. Each group of four is independent, so that a second text may follow the
 * padding of the first, as after the lengths. False if the character is not base64. */
static bool decode_base64(struct vtk_source *s, int c) {
    if (c == ' ' || (c >= '\t' && c <= '\r'))
        return true;
    int digit = base64_digit(c);
    if (c == '=' && s->digits + s->pads >= 2)
        s->pads++;
    else if (digit >= 0 && s->pads == 0)
        s->bits = s->bits << 6 | (uint32_t)digit, s->digits++;
    else
        return false;
    if (s->digits + s->pads == 4) {
        uint32_t group = s->bits << 6 * s->pads;
        for (unsigned i = 0; i < 3 - s->pads; i++)
            s->out[s->ready++] = (uint8_t)(group >> (16 - 8 * i));
        s->bits = s->digits = s->pads = 0;
    }
    return true;
}

/* Decodes more bytes. A character that is not base64 ends the data; the caller reports an error if
 * bytes are missing. */
static bool decode_more(struct vtk_source *s, struct sp_error *err) {
    s->ready = s->used = 0;
    while (s->ready == 0 && !s->ended) {
        size_t got;
        if (!fetch(s, s->raw, VTK_CHUNK, &got, err))
            return false;
        s->ended = got == 0;
        for (size_t i = 0; i < got && !s->ended; i++)
            if (!decode_base64(s, s->raw[i])) {
                s->at -= got - i;
                s->ended = true;
            }
    }
    return true;
}

/* Reads the next n bytes. */
bool vtk_source_pull(struct vtk_source *s, void *out, size_t n, struct sp_error *err) {
    size_t got;
    if (s->array->form == VTK_BYTES)
        return fetch(s, out, n, &got, err) && (got == n || cut_off(s, err));
    for (size_t done = 0; done < n; done += got) {
        if (s->used == s->ready && !decode_more(s, err))
            return false;
        got = s->ready - s->used < n - done ? s->ready - s->used : n - done;
        if (got == 0 && s->at < s->end)
            return import_fail(err, SP_ERR_FORMAT, s->file->title, s->at, s->array->name,
                               "the data is not base64 text, or ends too early");
        if (got == 0)
            return cut_off(s, err);
        memcpy((char *)out + done, s->out + s->used, got);
        s->used += got;
    }
    return true;
}

bool vtk_source_pull_length(struct vtk_source *s, uint64_t *length, struct sp_error *err) {
    uint8_t b[8];
    unsigned n = s->array->length_size;
    if (!vtk_source_pull(s, b, n, err))
        return false;
    *length = 0;
    for (unsigned i = 0; i < n; i++)
        *length |= (uint64_t)b[i] << 8 * (s->array->big_endian ? n - 1 - i : i);
    return true;
}

struct vtk_source *vtk_source_open(const struct import_file *file, const struct vtk_array *array,
                                   struct sp_error *err) {
    struct vtk_source *s = malloc(sizeof *s);
    if (!s) {
        sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory while reading %s", array->name);
        return NULL;
    }
    memset(s, 0, offsetof(struct vtk_source, raw));
    s->ready = s->used = 0;
    s->bits = s->digits = s->pads = 0;
    s->ended = false;
    s->file = file;
    s->array = array;
    s->at = array->begin;
    s->end = array->end < file->size ? array->end : file->size;
    return s;
}
