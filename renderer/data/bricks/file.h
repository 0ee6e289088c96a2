/* SPDX-License-Identifier: Apache-2.0
 *
 * Reads a brick file (format.h). Opening reads the header and the indices; bricks are read when
 * they are asked for, by pread(), from any thread. The file comes from outside: everything is
 * checked, and a damaged brick is an error of that brick alone.
 */
#ifndef SP_BRICKS_FILE_H
#define SP_BRICKS_FILE_H

#include "data/bricks/chunks.h"
#include "data/bricks/learned.h"

struct sp_brick_file;

/* True if the file begins with the magic bytes of a brick file. */
bool sp_brick_file_is(int fd);

/* Takes over the descriptor, also on failure. `title` is the name in errors. SP_ERR_FORMAT,
 * SP_ERR_UNSUPPORTED, SP_ERR_IO, SP_ERR_MEMORY. */
struct sp_brick_file *sp_brick_file_open(int fd, const char *title, struct sp_error *err);
/* Makes a brick file from chunks: no file is behind it. Takes over the source, also on failure. The
 * ranges of its entries are infinite until they are learned, and their `bytes` and `at` are 0.
 * SP_ERR_MEMORY. */
struct sp_brick_file *sp_brick_file_of_chunks(const struct sp_chunk_source *source,
                                              const char *title, struct sp_error *err);
/* Returns the chunks of which it is made; NULL = it is read from a file. */
const struct sp_chunk_source *sp_brick_file_chunks(const struct sp_brick_file *file);
/* Stores the ranges of a brick that was cut from chunks. Thread-safe. */
void sp_brick_file_learn(struct sp_brick_file *file, unsigned level, uint64_t number,
                         const struct sp_brick_ranges *ranges);

/* Accepts NULL; nulls *file. */
void sp_brick_file_close(struct sp_brick_file **file);

const struct sp_brick_header *sp_brick_file_header(const struct sp_brick_file *file);
/* sp_brick_file_entries() returns the entries of a level, in the order of the bricks. Entries of
 * chunks change when another thread learns a range, but not between sp_brick_file_begin() and
 * sp_brick_file_end(). */
void sp_brick_file_begin(const struct sp_brick_file *file);
void sp_brick_file_end(const struct sp_brick_file *file);
const struct sp_brick_entry *sp_brick_file_entries(const struct sp_brick_file *file,
                                                   unsigned level);
/* Returns the bytes of the indices and axes in memory, and of the readers of chunks. */
uint64_t sp_brick_file_bytes(const struct sp_brick_file *file);

/* Scratch memory of one thread. */
struct sp_brick_scratch;
struct sp_brick_scratch *sp_brick_scratch_create(struct sp_error *err);
void sp_brick_scratch_destroy(struct sp_brick_scratch **scratch);

/* Not for chunks: reads the samples of a brick into `out`, size[0] · size[1] · size[2] of them
 * (sp_brick_box()), i0 fastest. SP_ERR_IO; SP_ERR_FORMAT if it is damaged: its checksum or its size
 * is wrong. */
bool sp_brick_file_read(const struct sp_brick_file *file, unsigned level, uint64_t number,
                        struct sp_brick_scratch *scratch, void *out, struct sp_error *err);
/* Reads the vectors of a brick in the same way. The file must have vectors: vector_bytes of its
 * info is not 0. */
bool sp_brick_file_read_vectors(const struct sp_brick_file *file, unsigned level, uint64_t number,
                                struct sp_brick_scratch *scratch, float (*out)[3],
                                struct sp_error *err);

#endif
