/* SPDX-License-Identifier: Apache-2.0
 *
 * Reads raw or gzip samples or vectors from one or several files into memory, in native byte order.
 */
#ifndef SP_IMPORT_SAMPLES_H
#define SP_IMPORT_SAMPLES_H

#include "data/import/conversion.h"
#include "data/import/stream.h"

/* Bytes of a file after the samples. */
enum import_rest {
    IMPORT_REST_REFUSED, /* the header is wrong */
    IMPORT_REST_WARNED,
    IMPORT_REST_IGNORED, /* the samples are a part of a larger file */
};

struct import_samples {
    const struct import_file *file; /* for root and folder */
    char **names; /* owned: data files as the header names them, relative to file->folder */
    size_t count; /* 0 = the samples follow the header in file->fd itself */
    enum import_encoding encoding;
    bool big_endian;
    enum import_rest rest;
    bool from_end; /* raw only: the samples are the last ones of each file */
    /* In each file, lines first. Bytes count after unpacking for GZIP and BZIP2, else in the file.
     */
    uint64_t skip_bytes, skip_lines;
    uint64_t before_bytes, after_bytes; /* of other steps and components, decoded */
    uint64_t start;                     /* count == 0: where the header ends */
    struct import_number number;
    bool is_vectors, is_planar; /* as in struct import_vectors */
    /* Of `number`; of vectors only slope and offset. NULL = samples are the numbers. */
    const struct import_conversion *conversion;
    uint64_t bytes;    /* of all numbers; a multiple of max(count, 1) */
    const char *field; /* the header field in errors about the size: "sizes", "dims" */
};

/* Frees names. */
void import_samples_finish(struct import_samples *samples);

/* Restricts the samples to one of `blocks` equal blocks, such as time steps, that follow one
 * another in one file or in all files. Call it once, when the files are known and `bytes` is the
 * size of one block. False if a file holds neither whole blocks nor a whole part of one. */
bool import_samples_choose_block(struct import_samples *samples, uint64_t blocks, uint64_t block);

/* Adds a data file; false when out of memory. */
bool import_samples_add(struct import_samples *samples, const char *name, size_t length);

/* Opens every file once and compares sizes, so that a wrong header is refused before memory is
 * allocated. */
bool import_samples_check(const struct import_samples *samples, struct sp_error *err);

/* Reads the samples into `voxels`, which is zeroed, or vectors into `vectors`. Holes of a sparse
 * file are not read. */
bool import_samples_read(const struct import_samples *samples, void *voxels, float (*vectors)[3],
                         const struct import_progress *progress, struct sp_error *err);

/* A reader of a file with one array of samples, for struct import_format. */
struct import_sampled {
    struct import_samples samples;
    struct import_conversion conversion; /* which `samples` may refer to */
};

/* Describes samples as the header's grid and the reader's `number` and conversion say, which begin
 * after `skip` bytes of the file, unpacked if it is packed with gzip. Chooses the step and checks
 * all sizes. The caller sets the byte order, the rest and the field. */
bool import_sampled_use(struct import_sampled *reader, const struct import_file *file,
                        uint64_t skip, bool is_packed, struct import_header *header,
                        struct sp_error *err);

/* read() and close() of struct import_format, for readers that begin with such a one. */
bool import_sampled_read(void *reader, void *voxels, float (*vectors)[3],
                         const struct import_progress *progress, struct sp_error *err);
void import_sampled_close(void *reader);

#endif
