/* SPDX-License-Identifier: Apache-2.0
 *
 * Compressed arrays of XML VTK files: blocks of zlib, LZ4 or LZMA data, behind their lengths:
 *
 *   count of blocks │ bytes of a block │ bytes of the last │ packed bytes of each │ blocks
 */
#ifndef SP_IMPORT_VTK_UNPACK_H
#define SP_IMPORT_VTK_UNPACK_H

#include "data/import/vtk_source.h"

struct vtk_unpacker;

/* Reads the lengths before `need` bytes of values and checks them against the rest of the file,
 * before memory is allocated. *least: bytes that the file must have. */
bool vtk_unpack_check(struct vtk_source *source, uint64_t need, uint64_t *least,
                      struct sp_error *err);

/* Reads the header: the number of blocks and their lengths. NULL with *err set on failure. */
struct vtk_unpacker *vtk_unpack_open(struct vtk_source *source, uint64_t need,
                                     struct sp_error *err);

/* Unpacks the next n bytes. Stops at the first byte beyond the declared size of a block. */
bool vtk_unpack(struct vtk_unpacker *unpacker, char *out, size_t n, struct sp_error *err);

/* NULL is allowed. */
void vtk_unpack_close(struct vtk_unpacker *unpacker);

#endif
