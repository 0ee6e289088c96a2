/* SPDX-License-Identifier: Apache-2.0
 *
 * Why this parser is our own: parsers.md.
 */
#include "data/import/text.h"

#include <inttypes.h>
#include <string.h>
#include <unistd.h>

void import_text_init(struct import_text *text, const struct import_file *file, uint64_t begin,
                      uint64_t end) {
    text->file = file;
    text->at = begin;
    text->end = end;
    text->buffer_at = 0;
    text->buffer_size = 0;
}

static bool is_space(int c) {
    return c == ' ' || (c >= '\t' && c <= '\r');
}

int import_text_fill(struct import_text *t, struct sp_error *err) {
    if (t->at >= t->end)
        return -1;
    if (t->at < t->buffer_at || t->at - t->buffer_at >= t->buffer_size) {
        if (!import_read(t->file, t->buffer, sizeof t->buffer, t->at, &t->buffer_size, err)) {
            t->buffer_size = 0;
            return -2;
        }
        t->buffer_at = t->at;
        if (t->buffer_size == 0)
            return -1;
    }
    return t->buffer[t->at - t->buffer_at];
}

bool import_text_word(struct import_text *t, char word[IMPORT_WORD_MAX + 1], uint64_t *byte,
                      struct sp_error *err) {
    size_t n = 0;
    int c;
    while (is_space(c = import_text_peek(t, err)))
        t->at++;
    *byte = t->at;
    for (; c >= 0 && !is_space(c); c = import_text_peek(t, err)) {
        if (n == IMPORT_WORD_MAX)
            return import_fail(err, SP_ERR_FORMAT, t->file->title, *byte, NULL,
                               "a word is longer than %d bytes", IMPORT_WORD_MAX);
        word[n++] = c ? (char)c : '?'; /* a byte 0 must not end the string */
        t->at++;
    }
    word[n] = 0;
    return c != -2;
}

bool import_text_line(struct import_text *t, char *line, size_t capacity, struct sp_error *err) {
    size_t n = 0;
    int c;
    for (; (c = import_text_peek(t, err)) >= 0; t->at++) {
        if (c == '\n') {
            t->at++;
            break;
        }
        if (n + 1 < capacity && c != '\r')
            line[n++] = c ? (char)c : '?';
    }
    line[n] = 0;
    return c != -2;
}

bool import_text_skip(struct import_text *t, uint64_t words, const char *field,
                      struct sp_error *err) {
    for (uint64_t i = 0; i < words; i++) {
        int c;
        while (is_space(c = import_text_peek(t, err)))
            t->at++;
        if (c == -1)
            return import_fail(err, SP_ERR_FORMAT, t->file->title, t->at, field,
                               "the file is cut off: %" PRIu64 " more values are expected",
                               words - i);
        for (; c >= 0 && !is_space(c); c = import_text_peek(t, err))
            t->at++;
        if (c == -2)
            return false;
    }
    return true;
}
