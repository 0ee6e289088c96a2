/* SPDX-License-Identifier: Apache-2.0
 *
 * Vectors of a file on their way into memory:
 *
 *   numbers of any type ─► import_vectors_put() ─► float32 ─► import_vectors_finish() ─► world axes
 */
#ifndef SP_IMPORT_VECTORS_H
#define SP_IMPORT_VECTORS_H

#include "data/import/conversion.h"
#include "data/import/format.h"

struct import_vectors {
    struct import_number number;
    uint64_t count; /* vectors */
    bool planar;    /* all x come first, then all y, then all z; otherwise x, y and z alternate */
    float (*out)[3];
    struct import_shift *shift;            /* of positions; NULL = none */
    const struct import_conversion *scale; /* its slope and offset; NULL = none */
};

/* Converts `n` aligned numbers in native byte order, before which `first` numbers came. Only
 * `scale` changes their values. Numbers beyond the range of float32 become infinite. */
void import_vectors_put(const struct import_vectors *vectors, uint64_t first, const void *numbers,
                        size_t n);

/* Turns the vectors from the frame of the file to the axes of the world, and computes the samples
 * if they come from them. */
void import_vectors_finish(const struct import_header *header, float (*vectors)[3], void *voxels);

/* Warns if none of `count` vectors has a direction. */
void import_vectors_warn(const struct import_file *file, const float (*vectors)[3], uint64_t count);

#endif
