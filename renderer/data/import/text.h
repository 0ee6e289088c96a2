/* SPDX-License-Identifier: Apache-2.0
 *
 * Reads text from a range of a file, word by word or line by line, through a buffer.
 */
#ifndef SP_IMPORT_TEXT_H
#define SP_IMPORT_TEXT_H

#include "data/import/format.h"

enum { IMPORT_WORD_MAX = 255, IMPORT_BUFFER = 1 << 16 }; /* bytes */

struct import_text {
    const struct import_file *file;
    uint64_t at, end;   /* the next byte of the file; the first byte beyond the range */
    uint64_t buffer_at; /* the buffer holds the bytes [buffer_at, buffer_at + buffer_size) */
    size_t buffer_size;
    uint8_t buffer[IMPORT_BUFFER];
};

void import_text_init(struct import_text *text, const struct import_file *file, uint64_t begin,
                      uint64_t end);

/* import_text_peek() of a byte outside of the buffer. */
int import_text_fill(struct import_text *text, struct sp_error *err);

/* Returns the next byte without consuming it, in [0, 255]; -1 at the end of the range; -2 with *err
 * set if the file cannot be read. */
static inline int import_text_peek(struct import_text *text, struct sp_error *err) {
    const uint64_t at = text->at - text->buffer_at; /* large before the buffer */
    return text->at < text->end && at < text->buffer_size ? text->buffer[at]
                                                          : import_text_fill(text, err);
}

/* Reads the next word between white space, "" at the end; *byte is its offset. False with *err set
 * if it is longer than IMPORT_WORD_MAX or cannot be read. */
bool import_text_word(struct import_text *text, char word[IMPORT_WORD_MAX + 1], uint64_t *byte,
                      struct sp_error *err);

/* Reads the rest of the line without its end, cut to `capacity` bytes with the terminating 0. False
 * with *err set if it cannot be read. */
bool import_text_line(struct import_text *text, char *line, size_t capacity, struct sp_error *err);

/* Skips words. False with *err set if there are fewer. */
bool import_text_skip(struct import_text *text, uint64_t words, const char *field,
                      struct sp_error *err);

#endif
