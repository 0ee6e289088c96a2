/* SPDX-License-Identifier: Apache-2.0
 *
 * The words of a legacy VTK file, its numbers, and its cells.
 */
#ifndef SP_IMPORT_VTK_LEGACY_WORDS_H
#define SP_IMPORT_VTK_LEGACY_WORDS_H

#include "data/import/text.h"
#include "data/import/vtk.h"

/* Tuples of an array; the product with the components fits into 64 bits. */
#define VTK_COUNT_MAX (UINT64_C(1) << 40)

struct vtk_legacy { /* state while the file is read */
    const struct import_file *file;
    struct vtk_volume *volume;
    struct sp_error *err;
    struct import_text text;
    uint64_t byte;    /* offset of the keyword */
    uint64_t grid_at; /* offset of DIMENSIONS, or of POINTS without a grid; 0 = not seen */
    bool words;       /* ASCII */
    enum vtk_set set;
    bool new_cells; /* two arrays with a type each, since version 5 */
    enum { NOWHERE, POINTS, CELLS } section;
    bool has_scalars, has_vectors; /* SCALARS or VECTORS of points were found */
    uint64_t points, cells;        /* of the grid; no cells are known of other data sets */
    uint64_t tuples;               /* of each array in this section */
};

/* Fails at the keyword that was read last. */
#define VTK_LEGACY_REFUSE(l, code, field, ...)                                                     \
    import_fail((l)->err, code, (l)->file->title, (l)->byte, field, __VA_ARGS__)

bool vtk_legacy_read_word(struct vtk_legacy *l, char word[IMPORT_WORD_MAX + 1]);
bool vtk_legacy_count(struct vtk_legacy *l, const char *field, uint64_t limit, uint64_t *count);
bool vtk_legacy_type(struct vtk_legacy *l, const char *field, const struct vtk_type **type);

/* BINARY data begins on the next line. */
bool vtk_legacy_end_line(struct vtk_legacy *l);

/* Describes the array that begins here, without its count. */
struct vtk_array vtk_legacy_array(const struct vtk_legacy *l, const char *keyword, const char *name,
                                  const struct vtk_type *type);

/* The only piece. */
struct vtk_piece *vtk_legacy_piece(const struct vtk_legacy *l);

/* Skips `count` values. */
bool vtk_legacy_skip(struct vtk_legacy *l, const char *field, const struct vtk_type *type,
                     uint64_t count);

/* Skips `count` texts, each a line or, in BINARY data, a length and bytes. */
bool vtk_legacy_skip_strings(struct vtk_legacy *l, const char *field, uint64_t count);

/* Reads where the cells of a keyword are. */
bool vtk_legacy_cells(struct vtk_legacy *l, const char *keyword);

#endif
