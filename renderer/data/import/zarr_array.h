/* SPDX-License-Identifier: Apache-2.0
 *
 * One array of Zarr v2 or v3: its shape, its chunks, and how their bytes become numbers. With
 * sharding, a chunk here is an inner chunk, and a shard an object with several of them.
 */
#ifndef SP_IMPORT_ZARR_ARRAY_H
#define SP_IMPORT_ZARR_ARRAY_H

#include "data/import/zarr_codec.h"
#include "data/import/zarr_node.h"

enum {
    ZARR_RANK_MAX = 8,
    ZARR_CODECS_MAX = 8,
    ZARR_CHUNK_MAX = 256 << 20, /* bytes of one chunk, unpacked */
    ZARR_NAME_BYTES = 48,
};

struct zarr_array {
    char path[ZARR_KEY_BYTES];
    unsigned rank; /* in [1, ZARR_RANK_MAX] */
    uint64_t shape[ZARR_RANK_MAX];
    uint64_t chunk[ZARR_RANK_MAX]; /* numbers of a chunk along each dimension, at least 1 */
    size_t chunk_bytes;            /* of a chunk, unpacked; at most ZARR_CHUNK_MAX */
    char names[ZARR_RANK_MAX][ZARR_NAME_BYTES]; /* of the dimensions; "" = not known */
    struct import_number number;
    bool is_big_endian;
    uint8_t fill[IMPORT_NUMBER_BYTES]; /* one number in native order, for missing chunks */
    unsigned order[ZARR_RANK_MAX];     /* dimensions of a chunk in memory, the slowest first */
    struct zarr_step codecs[ZARR_CODECS_MAX]; /* in the order of packing */
    unsigned codec_count;
    bool has_prefix; /* keys begin with "c" */
    char separator;  /* of the numbers in a key */
    bool is_sharded, is_index_first, has_index_checksum;
    uint64_t shard[ZARR_RANK_MAX]; /* chunks of a shard along each dimension; 1 without sharding */
};

/* Reads the metadata of an array. All sizes are checked: the bytes of a chunk, and the chunks of a
 * shard (at most 2^20). */
bool zarr_array_parse(struct zarr_array *array, const struct zarr_node *node, struct sp_error *err);

/* Reads "NaN", "Infinity" and "-Infinity", and how zarr_node.c writes them. */
bool zarr_special_number(const char *text, double *value);

/* How many chunks there are along a dimension. */
uint64_t zarr_array_chunks(const struct zarr_array *array, unsigned dimension);

#endif
