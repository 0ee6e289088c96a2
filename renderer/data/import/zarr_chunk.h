/* SPDX-License-Identifier: Apache-2.0
 *
 * Reads one chunk of a Zarr array: key ─► object, or part of a shard ─► unpacked ─► numbers. Needs
 * memory for one chunk, unpacked and packed.
 */
#ifndef SP_IMPORT_ZARR_CHUNK_H
#define SP_IMPORT_ZARR_CHUNK_H

#include "data/import/zarr_array.h"
#include "data/import/zarr_bridge.h"

struct zarr_chunks { /* a reader of chunks, for one thread and any number of arrays */
    const struct zarr_store *store;
    const struct zarr_bridge_functions *call; /* NULL = not loaded yet */
    const struct import_file *file;           /* whose errors name the missing library */
    char *buffers[2];                         /* owned */
    size_t capacities[2];
    uint64_t *index; /* owned: offset and size of the chunks of the last shard */
    size_t index_count;
    char shard_key[ZARR_KEY_BYTES]; /* of the last shard; "" = none */
};

void zarr_chunks_init(struct zarr_chunks *chunks, const struct zarr_store *store,
                      const struct import_file *file);
void zarr_chunks_finish(struct zarr_chunks *chunks);

/* Reads chunk `at`, a number per dimension below zarr_array_chunks(), into array->chunk_bytes: the
 * numbers in native byte order, the last dimension fastest. The part of a chunk that lies beyond
 * the shape holds any numbers. A chunk that is missing (ZARR_MISSING) is filled with the array's
 * fill value. ZARR_FAILED with *err set if it is damaged or cannot be read. */
enum zarr_found zarr_chunk_read(struct zarr_chunks *chunks, const struct zarr_array *array,
                                const uint64_t at[ZARR_RANK_MAX], void *out, struct sp_error *err);

#endif
