/* SPDX-License-Identifier: Apache-2.0
 *
 * The text in a range of a file's bytes, word by word or line by line, through a window that is
 * read as it goes.
 */
#ifndef SP_IMPORT_VTK_TEXT_H
#define SP_IMPORT_VTK_TEXT_H

#include "import/format.h"

enum { VTK_WORD_MAX = 255, VTK_WINDOW = 1 << 16 }; /* bytes */

struct vtk_text {
    const struct import_file *file;
    uint64_t at, end;   /* the next byte of the file, and the first one beyond the range */
    uint64_t window_at; /* what the window holds: file bytes [window_at, + window_size) */
    size_t window_size;
    uint8_t window[VTK_WINDOW];
};

void vtk_text_init(struct vtk_text *text, const struct import_file *file, uint64_t begin,
                   uint64_t end);

/* The next byte, without taking it: in [0,255]; -1 at the end of the range; -2 when the file cannot
 * be read, with *err set. */
int vtk_text_peek(struct vtk_text *text, struct sp_error *err);

/* The next word between white space, "" at the end; *byte is where it starts. False with *err set
 * when it is longer than VTK_WORD_MAX or cannot be read. */
bool vtk_text_word(struct vtk_text *text, char word[VTK_WORD_MAX + 1], uint64_t *byte,
                   struct sp_error *err);

/* The rest of the line, without its end, cut to `room`; the next byte is the first of the line
 * after it. False with *err set when it cannot be read. */
bool vtk_text_line(struct vtk_text *text, char *line, size_t room, struct sp_error *err);

/* Passes over words, without looking at them. False with *err set when there are fewer. */
bool vtk_text_skip(struct vtk_text *text, uint64_t words, const char *field, struct sp_error *err);

#endif
