/* SPDX-License-Identifier: Apache-2.0
 *
 * Why this parser is our own: parsers.md.
 */
#include "data/import/zarr_chunk.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/module.h"

#define NO_CHUNK UINT64_MAX /* in the index of a shard */

/* A run of bytes that moves between the two buffers. */
struct bytes {
    int buffer;
    size_t size;
};

void zarr_chunks_init(struct zarr_chunks *chunks, const struct zarr_store *store,
                      const struct import_file *file) {
    *chunks = (struct zarr_chunks){ .store = store, .file = file };
}

void zarr_chunks_finish(struct zarr_chunks *chunks) {
    free(chunks->buffers[0]);
    free(chunks->buffers[1]);
    free(chunks->index);
    *chunks = (struct zarr_chunks){ .store = NULL };
}

static bool reserve(struct zarr_chunks *c, int buffer, size_t size, const char *key,
                    struct sp_error *err) {
    if (size <= c->capacities[buffer])
        return true;
    free(c->buffers[buffer]);
    c->buffers[buffer] = malloc(size);
    c->capacities[buffer] = c->buffers[buffer] ? size : 0;
    return c->buffers[buffer] || zarr_fail(c->store, err, SP_ERR_MEMORY, key, "",
                                           "out of memory for a chunk of %zu bytes", size);
}

/* The largest number of bytes of a packed chunk: codecs enlarge little what they cannot pack, and
 * filters may make numbers of larger types. */
static size_t packed_max(const struct zarr_array *a) {
    size_t most = a->number.size;
    for (unsigned i = 0; i < a->codec_count; i++)
        most = a->codecs[i].encoded.size > most ? a->codecs[i].encoded.size : most;
    const size_t bytes = a->chunk_bytes / a->number.size * most;
    return bytes + bytes / 8 + (1 << 16);
}

/* Keys. */

static bool chunk_key(const struct zarr_array *a, const uint64_t at[], char key[ZARR_KEY_BYTES]) {
    char name[ZARR_RANK_MAX * 22 + 2];
    size_t used = 0;
    if (a->has_prefix)
        used += (size_t)snprintf(name, sizeof name, "c%c", a->separator);
    for (unsigned d = 0; d < a->rank; d++)
        used += (size_t)snprintf(name + used, sizeof name - used, "%" PRIu64 "%c",
                                 at[d] / a->shard[d], a->separator);
    name[used - 1] = 0;
    return zarr_key(key, a->path, name);
}

/* The place of a chunk in the index of its shard. */
static size_t index_of(const struct zarr_array *a, const uint64_t at[]) {
    uint64_t i = 0;
    for (unsigned d = 0; d < a->rank; d++)
        i = i * a->shard[d] + at[d] % a->shard[d];
    return (size_t)i;
}

/* Shards. */

/* Reads the index of a shard unless it is the last one. */
static enum zarr_found load_index(struct zarr_chunks *c, const struct zarr_array *a,
                                  const char *key, struct sp_error *err) {
    size_t count = 1, got = 0;
    uint64_t size = 0;
    if (strcmp(c->shard_key, key) == 0)
        return ZARR_FOUND;
    c->shard_key[0] = 0;
    for (unsigned d = 0; d < a->rank; d++)
        count *= (size_t)a->shard[d];
    const size_t bytes = 16 * count + (a->has_index_checksum ? 4 : 0);
    enum zarr_found found = c->store->size(c->store->user, key, &size, err);
    if (found != ZARR_FOUND)
        return found;
    if (size < bytes) {
        zarr_fail(c->store, err, SP_ERR_FORMAT, key, "",
                  "the shard has %" PRIu64 " bytes, its index needs %zu: it is cut off", size,
                  bytes);
        return ZARR_FAILED;
    }
    uint64_t *larger = realloc(c->index, count * 2 * sizeof *larger);
    if (!larger || !reserve(c, 0, bytes, key, err)) {
        c->index = larger ? larger : c->index;
        sp_fail(err, SP_ERR_MEMORY, c->store->title, "out of memory for a shard");
        return ZARR_FAILED;
    }
    c->index = larger;
    found = c->store->read(c->store->user, key, a->is_index_first ? 0 : size - bytes, c->buffers[0],
                           bytes, &got, err);
    if (found != ZARR_FOUND)
        return found;
    if (got < bytes || (a->has_index_checksum && !zarr_is_sound(c->buffers[0], bytes))) {
        zarr_fail(c->store, err, SP_ERR_FORMAT, key, "", "the index of the shard is damaged");
        return ZARR_FAILED;
    }
    for (size_t i = 0; i < 2 * count; i++)
        c->index[i] = zarr_little((const uint8_t *)c->buffers[0] + 8 * i, 8);
    snprintf(c->shard_key, sizeof c->shard_key, "%s", key);
    return ZARR_FOUND;
}

/* Reads the packed bytes of a chunk into buffer 0. */
static enum zarr_found load(struct zarr_chunks *c, const struct zarr_array *a, const uint64_t at[],
                            const char *key, struct bytes *bytes, struct sp_error *err) {
    const size_t most = packed_max(a);
    uint64_t offset = 0, size = 0;
    enum zarr_found found = a->is_sharded ? load_index(c, a, key, err)
                                          : c->store->size(c->store->user, key, &size, err);
    if (found != ZARR_FOUND)
        return found;
    if (a->is_sharded) {
        offset = c->index[2 * index_of(a, at)];
        size = c->index[2 * index_of(a, at) + 1];
        if (offset == NO_CHUNK && size == NO_CHUNK)
            return ZARR_MISSING;
    }
    if (size > most) {
        zarr_fail(c->store, err, SP_ERR_FORMAT, key, "",
                  "the chunk has %" PRIu64 " bytes; %zu are the most for its numbers", size, most);
        return ZARR_FAILED;
    }
    if (!reserve(c, 0, (size_t)size, key, err))
        return ZARR_FAILED;
    *bytes = (struct bytes){ .buffer = 0 };
    found =
        c->store->read(c->store->user, key, offset, c->buffers[0], (size_t)size, &bytes->size, err);
    if (found == ZARR_FOUND && bytes->size < size) {
        zarr_fail(c->store, err, SP_ERR_FORMAT, key, "",
                  "the chunk has %zu of %" PRIu64 " bytes: its object is cut off", bytes->size,
                  size);
        return ZARR_FAILED;
    }
    return found;
}

/* Codecs. */

static bool load_bridge(struct zarr_chunks *c, enum zarr_codec codec, struct sp_error *err) {
    const bool is_blosc = codec == ZARR_BLOSC;
    if (!c->call)
        c->call = import_module_load(c->file, ZARR_BRIDGE_MODULE, ZARR_BRIDGE_SYMBOL,
                                     is_blosc ? "Blosc" : "Zstandard",
                                     is_blosc ? "libblosc1" : "libzstd1", err);
    return c->call != NULL;
}

/* Undoes one codec: from one buffer into the other. */
static bool unpack(struct zarr_chunks *c, const struct zarr_step *step, size_t capacity,
                   const char *key, struct bytes *bytes, struct sp_error *err) {
    struct sp_error why;
    const enum zarr_codec codec = step->codec;
    const void *in = c->buffers[bytes->buffer];
    const int to = 1 - bytes->buffer;
    size_t got = 0;
    bool ok;
    if ((codec == ZARR_BLOSC || codec == ZARR_ZSTD) && !load_bridge(c, codec, err))
        return false;
    if (!reserve(c, to, capacity, key, err))
        return false;
    if (codec == ZARR_BLOSC)
        ok = c->call->blosc(in, bytes->size, c->buffers[to], capacity, &got, &why);
    else if (codec == ZARR_ZSTD)
        ok = c->call->zstd(in, bytes->size, c->buffers[to], capacity, &got, &why);
    else
        ok = zarr_step_undo(step, in, bytes->size, c->buffers[to], capacity, &got, &why);
    *bytes = (struct bytes){ .buffer = to, .size = got };
    return ok || zarr_fail(c->store, err, why.code, key, "", "%s", why.text);
}

/* Numbers. */

/* Copies numbers from their order in a chunk to the order of the dimensions. */
static void arrange(const struct zarr_array *a, const char *from, char *out) {
    const size_t size = a->number.size;
    size_t strides[ZARR_RANK_MAX], step = size;
    uint64_t at[ZARR_RANK_MAX] = { 0 };
    const size_t count = a->chunk_bytes / size;
    const unsigned last = a->rank - 1;
    for (unsigned i = a->rank; i-- > 0;) {
        strides[a->order[i]] = step;
        step *= (size_t)a->chunk[a->order[i]];
    }
    size_t offset = 0;
    for (size_t i = 0; i < count; i++) {
        memcpy(out + i * size, from + offset, size);
        offset += strides[last];
        for (unsigned d = last; ++at[d] == a->chunk[d] && d > 0; d--) {
            at[d] = 0;
            offset += strides[d - 1] - (size_t)a->chunk[d] * strides[d];
        }
    }
}

static void copy_numbers(const struct zarr_array *a, char *from, char *out) {
    bool is_ordered = true;
    if (a->is_big_endian != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__))
        import_swap_numbers(from, a->number, a->chunk_bytes / a->number.size);
    for (unsigned d = 0; d < a->rank; d++)
        is_ordered &= a->order[d] == d;
    if (is_ordered)
        memcpy(out, from, a->chunk_bytes);
    else
        arrange(a, from, out);
}

static void fill(const struct zarr_array *a, char *out) {
    const size_t size = a->number.size;
    bool is_even = true;
    for (size_t i = 1; i < size; i++)
        is_even &= a->fill[i] == a->fill[0];
    if (is_even)
        memset(out, a->fill[0], a->chunk_bytes);
    else
        for (size_t i = 0; i < a->chunk_bytes; i += size)
            memcpy(out + i, a->fill, size);
}

enum zarr_found zarr_chunk_read(struct zarr_chunks *c, const struct zarr_array *a,
                                const uint64_t at[ZARR_RANK_MAX], void *out, struct sp_error *err) {
    char key[ZARR_KEY_BYTES];
    struct bytes bytes = { .buffer = 0 };
    if (!chunk_key(a, at, key)) {
        zarr_fail(c->store, err, SP_ERR_INVALID, a->path, "",
                  "the key of a chunk is longer than a path may be");
        return ZARR_FAILED;
    }
    const enum zarr_found found = load(c, a, at, key, &bytes, err);
    if (found == ZARR_MISSING)
        fill(a, out);
    if (found != ZARR_FOUND)
        return found;
    for (unsigned i = a->codec_count; i-- > 0;)
        if (!unpack(c, &a->codecs[i], i == 0 ? a->chunk_bytes : packed_max(a), key, &bytes, err))
            return ZARR_FAILED;
    if (bytes.size != a->chunk_bytes) {
        zarr_fail(c->store, err, SP_ERR_FORMAT, key, "",
                  "the chunk has %zu bytes and needs %zu: it is cut off, or its metadata is wrong",
                  bytes.size, a->chunk_bytes);
        return ZARR_FAILED;
    }
    copy_numbers(a, c->buffers[bytes.buffer], out);
    return ZARR_FOUND;
}
