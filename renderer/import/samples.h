/* SPDX-License-Identifier: Apache-2.0
 *
 * Reads raw or gzip samples or vectors from one or several files into memory, in native byte order.
 */
#ifndef SP_IMPORT_SAMPLES_H
#define SP_IMPORT_SAMPLES_H

#include "import/conversion.h"

/* The limit of deflate: 258 bytes from two codes of one bit each. */
enum { DEFLATE_RATIO_MAX = 1032 };

struct import_samples {
    const struct import_file *file; /* for root and folder */
    char **names; /* owned: data files as the header names them, relative to file->folder */
    size_t count; /* 0 = the samples follow the header in file->fd itself */
    bool gzip, big_endian;
    bool rest_ignored; /* bytes may follow the samples: they are a part of a larger file */
    bool from_end;     /* raw only: the samples are the last ones of each file */
    uint64_t skip_bytes, skip_lines; /* in each file, lines first; gzip: bytes after unpacking */
    uint64_t after_bytes;            /* of later time steps, behind the samples; after unpacking */
    uint64_t start;                  /* count == 0: where the header ends */
    struct import_number number;
    bool is_vectors, is_planar;                 /* as in struct import_vectors */
    const struct import_conversion *conversion; /* of `number`; NULL = samples are the numbers */
    uint64_t bytes;                             /* of all numbers; a multiple of max(count, 1) */
    const char *field; /* the header field in errors about the size: "sizes", "dims" */
};

/* Frees names. */
void import_samples_finish(struct import_samples *samples);

/* Makes the samples those of one of `steps` time steps that follow one another in one file. Call it
 * when `bytes` and `skip_bytes` are known. */
void import_samples_choose_step(struct import_samples *samples, uint32_t steps, uint32_t step);

/* Adds a data file; false when out of memory. */
bool import_samples_add(struct import_samples *samples, const char *name, size_t length);

/* Opens every file once and compares sizes, so that a wrong header is refused before memory is
 * allocated. */
bool import_samples_check(const struct import_samples *samples, struct sp_error *err);

/* Reads the samples into `voxels`, which are 0 before, or if they are vectors, into `vectors`.
 * Holes of a file are not read. */
bool import_samples_read(const struct import_samples *samples, void *voxels, float (*vectors)[3],
                         const struct import_progress *progress, struct sp_error *err);

#endif
