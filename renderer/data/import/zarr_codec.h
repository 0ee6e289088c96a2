/* SPDX-License-Identifier: Apache-2.0
 *
 * The codecs and filters of Zarr chunks: how one step of packing is undone. Blosc and Zstandard are
 * in a module (zarr_bridge.h).
 */
#ifndef SP_IMPORT_ZARR_CODEC_H
#define SP_IMPORT_ZARR_CODEC_H

#include <jansson.h>

#include "data/import/number.h"

enum zarr_codec {
    ZARR_BLOSC,
    ZARR_ZSTD,
    ZARR_GZIP,
    ZARR_ZLIB,
    ZARR_LZ4,
    ZARR_BZ2,
    ZARR_LZMA,
    ZARR_CRC32C, /* checksum at the end */
    ZARR_CRC32,  /* at the start */
    ZARR_ADLER32,
    ZARR_SHUFFLE,
    /* These change numbers. */
    ZARR_DELTA,
    ZARR_SCALE, /* decoded = encoded / scale + offset */
    ZARR_CAST,  /* another type only */
};

struct zarr_step {
    enum zarr_codec codec;
    size_t element; /* of SHUFFLE: bytes of a number */
    /* Of codecs that change numbers: the types before and after packing, and their byte order. */
    struct import_number decoded, encoded;
    bool is_decoded_big, is_encoded_big;
    double scale, offset;
};

/* Reads the description of a codec by its name in v2 ("id") or v3; "numcodecs." may stand before
 * it. `number`: the type of the array. A filter that loses digits only when it packs has no step:
 * *is_nothing is set. False: SP_ERR_UNSUPPORTED; the caller sets err->place. */
bool zarr_step_parse(struct zarr_step *step, const char *name, const json_t *settings,
                     bool *is_nothing, struct sp_error *err);

/* The type of v2 and of numpy, "<f8". False if it is none of numbers. */
bool zarr_number_parse(const char *text, struct import_number *number, bool *is_big_endian);

/* Undoes a step other than BLOSC and ZSTD. *got is at most `capacity`. False: SP_ERR_FORMAT or
 * SP_ERR_MEMORY; the caller sets err->place. */
bool zarr_step_undo(const struct zarr_step *step, const void *in, size_t size, void *out,
                    size_t capacity, size_t *got, struct sp_error *err);

/* True if a checksum CRC32C follows the first size − 4 bytes. */
bool zarr_is_sound(const void *bytes, size_t size);

/* Reads a number of `count` bytes, the lowest first. */
uint64_t zarr_little(const uint8_t *bytes, unsigned count);

#endif
