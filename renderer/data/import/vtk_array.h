/* SPDX-License-Identifier: Apache-2.0
 *
 * An array of numbers in a legacy or XML VTK file, in each of its encodings:
 *
 *   words ──────────────────────────────────────────────► numbers     "ascii", ASCII
 *   bytes ──┬─────────────► [length] values ────────────► numbers     "raw" appended, BINARY
 *   base64 ─┘  └► [blocks, block, last, sizes…] packed … ─┘             "binary", "base64" appended
 *
 * Only XML files have lengths before the values. vtk_values.c has the functions.
 */
#ifndef SP_IMPORT_VTK_ARRAY_H
#define SP_IMPORT_VTK_ARRAY_H

#include "data/import/format.h"

struct vtk_type {
    const char *legacy, *xml; /* the name in files; NULL = none */
    struct import_number number;
    bool are_bits; /* eight values per byte, the first in the highest bit; in memory a byte each */
};

/* Finds a type by its name in XML files or in legacy files (any case); NULL if there is none. */
const struct vtk_type *vtk_find_type(const char *name, bool xml);

/* Bytes that `count` values take in a file that is not ASCII. */
uint64_t vtk_type_bytes(const struct vtk_type *type, uint64_t count);

enum vtk_form { VTK_WORDS, VTK_BYTES, VTK_BASE64 };
enum vtk_packing { VTK_PLAIN, VTK_ZLIB, VTK_LZ4, VTK_LZMA };

enum { VTK_COMPONENTS_MAX = 1 << 14 };
#define VTK_VALUES_MAX (VTK_COMPONENTS_MAX * SP_VOXELS_MAX)

struct vtk_array {
    char name[96]; /* the name in errors */
    const struct vtk_type *type;
    uint64_t count; /* values, [1, VTK_VALUES_MAX] */
    unsigned tuple; /* values that vtk_array_read() does not part; 0 = 1 */
    enum vtk_form form;
    bool big_endian;          /* values and lengths */
    enum vtk_packing packing; /* then length_size is not 0 */
    unsigned length_size;     /* 4 or 8 bytes each; 0 = no lengths */
    uint64_t begin, end;      /* range of the file that may hold it */
};

/* Compares sizes, so that a wrong header is refused before memory is allocated. */
bool vtk_array_check(const struct import_file *file, const struct vtk_array *array,
                     struct sp_error *err);

/* Takes `n` values in native byte order, before which `first` ones came. */
struct vtk_sink {
    void (*receive)(void *user, uint64_t first, const void *values, size_t n);
    void *user;
};

/* Reads all values, in runs of whole tuples. Unpacking stops at the first byte beyond their size.
 */
bool vtk_array_read(const struct import_file *file, const struct vtk_array *array,
                    const struct vtk_sink *sink, struct sp_error *err);

/* Reads all values into count · type->number.size bytes. `report` gets no values, only how many
 * are there; NULL = none. */
bool vtk_array_copy(const struct import_file *file, const struct vtk_array *array, void *out,
                    const struct vtk_sink *report, struct sp_error *err);

/* Reads all values as float32. `shift`: of positions; NULL = none. */
bool vtk_array_read_floats(const struct import_file *file, const struct vtk_array *array,
                           float *out, struct import_shift *shift, struct sp_error *err);

/* Reads a small array as doubles into malloc'ed memory of the caller. NULL with *err set on
 * failure. */
double *vtk_array_read_numbers(const struct import_file *file, const struct vtk_array *array,
                               struct sp_error *err);

#endif
