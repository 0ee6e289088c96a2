/* SPDX-License-Identifier: Apache-2.0
 *
 * An array of numbers in a VTK file of either kind, wherever and however it is written:
 *
 *   words ──────────────────────────────────────────────► numbers     "ascii", ASCII
 *   bytes ──┬─────────────► [length] values ────────────► numbers     "raw" appended, BINARY
 *   base64 ─┘  └► [blocks, block, last, sizes…] zlib … ─┘             "binary", "base64" appended
 *
 * Lengths stand before the values in XML files alone.
 */
#ifndef SP_IMPORT_VTK_ARRAY_H
#define SP_IMPORT_VTK_ARRAY_H

#include "import/format.h"

struct vtk_type {
    const char *legacy, *xml; /* what files call it; NULL = no such name */
    enum { VTK_SIGNED, VTK_UNSIGNED, VTK_FLOAT } kind;
    size_t size; /* bytes a value */
    int sample;  /* enum sp_type, or -1: no volume has such samples */
};

/* By its name in XML files, or in legacy ones (any case); NULL = there is none. */
const struct vtk_type *vtk_find_type(const char *name, bool xml);

enum vtk_form { VTK_WORDS, VTK_BYTES, VTK_BASE64 };

struct vtk_array {
    char name[96]; /* how errors call it */
    const struct vtk_type *type;
    uint64_t count; /* values, [1, SP_VOXELS_MAX] */
    enum vtk_form form;
    bool big_endian;      /* values and lengths */
    bool zlib;            /* length_size is not 0 */
    unsigned length_size; /* 4 or 8 bytes each; 0 = no lengths */
    uint64_t begin, end;  /* bytes of the file that may belong to it */
};

/* Compares sizes, so that a lying header is refused before memory is asked for. */
bool vtk_array_check(const struct import_file *file, const struct vtk_array *array,
                     struct sp_error *err);

/* All values into count · type->size bytes, in native byte order. `progress` may be NULL. What
 * unpacks stops at the first byte beyond that size. */
bool vtk_array_read(const struct import_file *file, const struct vtk_array *array, void *out,
                    const struct import_progress *progress, struct sp_error *err);

/* The values of a small array as doubles, malloc'ed; NULL with *err set. */
double *vtk_array_read_numbers(const struct import_file *file, const struct vtk_array *array,
                               struct sp_error *err);

#endif
