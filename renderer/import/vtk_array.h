/* SPDX-License-Identifier: Apache-2.0
 *
 * An array of numbers in a legacy or XML VTK file, in each of its encodings:
 *
 *   words ──────────────────────────────────────────────► numbers     "ascii", ASCII
 *   bytes ──┬─────────────► [length] values ────────────► numbers     "raw" appended, BINARY
 *   base64 ─┘  └► [blocks, block, last, sizes…] zlib … ─┘             "binary", "base64" appended
 *
 * Only XML files have lengths before the values.
 */
#ifndef SP_IMPORT_VTK_ARRAY_H
#define SP_IMPORT_VTK_ARRAY_H

#include "import/format.h"

struct vtk_type {
    const char *legacy, *xml; /* the name in files; NULL = none */
    struct import_number number;
    int sample; /* enum sp_type, or -1 if no volume has such samples; vectors may have any type */
};

/* Finds a type by its name in XML files or in legacy files (any case); NULL if there is none. */
const struct vtk_type *vtk_find_type(const char *name, bool xml);

enum vtk_form { VTK_WORDS, VTK_BYTES, VTK_BASE64 };

struct vtk_array {
    char name[96]; /* the name in errors */
    const struct vtk_type *type;
    uint64_t count; /* values, [1, 3 · SP_VOXELS_MAX] */
    enum vtk_form form;
    bool big_endian;      /* values and lengths */
    bool zlib;            /* length_size is not 0 */
    unsigned length_size; /* 4 or 8 bytes each; 0 = no lengths */
    uint64_t begin, end;  /* range of the file that may hold it */
};

/* Compares sizes, so that a wrong header is refused before memory is allocated. */
bool vtk_array_check(const struct import_file *file, const struct vtk_array *array,
                     struct sp_error *err);

/* Reads all values into count · type->number.size bytes, in native byte order. `progress` may be
 * NULL. Unpacking stops at the first byte beyond that size. */
bool vtk_array_read(const struct import_file *file, const struct vtk_array *array, void *out,
                    const struct import_progress *progress, struct sp_error *err);

/* Reads all values as float32. */
bool vtk_array_read_floats(const struct import_file *file, const struct vtk_array *array,
                           float *out, const struct import_progress *progress,
                           struct sp_error *err);

/* Reads a small array as doubles into malloc'ed memory of the caller. NULL with *err set on
 * failure. */
double *vtk_array_read_numbers(const struct import_file *file, const struct vtk_array *array,
                               struct sp_error *err);

#endif
