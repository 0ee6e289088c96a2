/* SPDX-License-Identifier: Apache-2.0
 *
 * The bytes of an array of a VTK file, decoded from base64 if necessary.
 */
#ifndef SP_IMPORT_VTK_SOURCE_H
#define SP_IMPORT_VTK_SOURCE_H

#include "data/import/vtk_array.h"

enum { VTK_CHUNK = 1 << 16 }; /* bytes */

struct vtk_source {
    const struct import_file *file;
    const struct vtk_array *array;
    uint64_t at, end; /* the next byte of the file to read */
    uint8_t raw[VTK_CHUNK], out[VTK_CHUNK];
    size_t ready, used; /* decoded bytes in out */
    uint32_t bits;      /* of the current base64 group */
    unsigned digits, pads;
    bool ended; /* base64: the encoded text has ended */
};

/* Starts at the begin of the array. The caller frees it. NULL with *err set when out of memory. */
struct vtk_source *vtk_source_open(const struct import_file *file, const struct vtk_array *array,
                                   struct sp_error *err);

/* Reads the next n bytes. */
bool vtk_source_pull(struct vtk_source *source, void *out, size_t n, struct sp_error *err);

/* Reads one of the lengths before the values. */
bool vtk_source_pull_length(struct vtk_source *source, uint64_t *length, struct sp_error *err);

#endif
