/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/zarr_codec.h"

#include <bzlib.h>
#include <lz4.h>
#include <lzma.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

enum { LZMA_MEMORY = 256 << 20 };

/* Descriptions. */

bool zarr_number_parse(const char *text, struct import_number *number, bool *is_big_endian) {
    static const struct {
        char letter;
        const char *name;
    } kinds[] = {
        { 'b', "uint" }, { 'u', "uint" }, { 'i', "int" }, { 'f', "float" }, { 'c', "complex" }
    };
    char name[32] = "";
    *is_big_endian = text[0] == '>';
    if (strlen(text) < 3 || !strchr("<>|", text[0]))
        return import_number_named(text, number);
    const unsigned long size = strtoul(text + 2, NULL, 10);
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
        if (text[1] == kinds[i].letter && size <= IMPORT_NUMBER_BYTES &&
            (size == 1 || text[1] != 'b'))
            snprintf(name, sizeof name, "%s%lu", kinds[i].name, 8 * size);
    return import_number_named(name, number);
}

/* Reads the two types of a filter. Without the second, it is the first. */
static bool parse_types(struct zarr_step *step, const json_t *settings, const char *decoded,
                        const char *encoded) {
    const char *one = json_string_value(json_object_get(settings, decoded));
    const char *two = json_string_value(json_object_get(settings, encoded));
    two = two ? two : one;
    return one && zarr_number_parse(one, &step->decoded, &step->is_decoded_big) &&
           zarr_number_parse(two, &step->encoded, &step->is_encoded_big) &&
           !import_number_is_complex(step->decoded) && !import_number_is_complex(step->encoded);
}

static const struct {
    const char *name;
    enum zarr_codec codec;
} known[] = {
    { "blosc", ZARR_BLOSC },
    { "zstd", ZARR_ZSTD },
    { "gzip", ZARR_GZIP },
    { "zlib", ZARR_ZLIB },
    { "lz4", ZARR_LZ4 },
    { "bz2", ZARR_BZ2 },
    { "lzma", ZARR_LZMA },
    { "crc32c", ZARR_CRC32C },
    { "crc32", ZARR_CRC32 },
    { "adler32", ZARR_ADLER32 },
    { "shuffle", ZARR_SHUFFLE },
    { "delta", ZARR_DELTA },
    { "fixedscaleoffset", ZARR_SCALE },
    { "astype", ZARR_CAST },
    { "quantize", ZARR_CAST },
};

/* False if the settings of a codec are wrong or not supported. */
static bool parse_settings(struct zarr_step *step, const json_t *settings) {
    const json_t *format = json_object_get(settings, "format");
    const char *location = json_string_value(json_object_get(settings, "location"));
    switch (step->codec) {
    case ZARR_LZMA: /* 1: xz. The others need settings of the compressor. */
        return !format || json_integer_value(format) == 1;
    case ZARR_CRC32C:
        return !location || strcmp(location, "end") == 0;
    case ZARR_CRC32:
    case ZARR_ADLER32:
        return !location || strcmp(location, "start") == 0;
    case ZARR_SHUFFLE: {
        const json_t *size = json_object_get(settings, "elementsize");
        const json_int_t bytes = size ? json_integer_value(size) : 4;
        step->element = (size_t)bytes;
        return bytes >= 1 && bytes <= 256;
    }
    case ZARR_DELTA:
        return parse_types(step, settings, "dtype", "astype");
    case ZARR_SCALE:
        step->scale = json_number_value(json_object_get(settings, "scale"));
        step->offset = json_number_value(json_object_get(settings, "offset"));
        return parse_types(step, settings, "dtype", "astype") && step->scale != 0;
    case ZARR_CAST:
        return parse_types(step, settings,
                           json_object_get(settings, "decode_dtype") ? "decode_dtype" : "dtype",
                           json_object_get(settings, "encode_dtype") ? "encode_dtype" : "astype");
    default:
        return true;
    }
}

bool zarr_step_parse(struct zarr_step *step, const char *name, const json_t *settings,
                     bool *is_nothing, struct sp_error *err) {
    *step = (struct zarr_step){ .codec = ZARR_BLOSC };
    const char *own = name && strncmp(name, "numcodecs.", 10) == 0 ? name + 10 : name;
    *is_nothing = own && strcmp(own, "bitround") == 0;
    if (*is_nothing)
        return true;
    for (size_t i = 0; own && i < sizeof known / sizeof *known; i++)
        if (strcmp(own, known[i].name) == 0) {
            step->codec = known[i].codec;
            return parse_settings(step, settings) ||
                   sp_fail(err, SP_ERR_UNSUPPORTED, "",
                           "the settings of the codec \"%.40s\" are not supported here", name);
        }
    return sp_fail(
        err, SP_ERR_UNSUPPORTED, "",
        "the codec or filter \"%.40s\" is not supported here; write the array with blosc, "
        "zstd, gzip, zlib, lz4, bz2 or lzma",
        name ? name : "?");
}

/* Checksums. */

uint64_t zarr_little(const uint8_t *bytes, unsigned count) {
    uint64_t value = 0;
    for (unsigned i = count; i-- > 0;)
        value = value << 8 | bytes[i];
    return value;
}

static uint32_t crc32c(const uint8_t *bytes, size_t size) {
    uint32_t crc = ~UINT32_C(0);
    for (size_t i = 0; i < size; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++)
            crc = crc >> 1 ^ (crc & 1 ? UINT32_C(0x82f63b78) : 0);
    }
    return ~crc;
}

bool zarr_is_sound(const void *bytes, size_t size) {
    return size >= 4 &&
           zarr_little((const uint8_t *)bytes + size - 4, 4) == crc32c(bytes, size - 4);
}

/* Takes the bytes without their checksum. */
static bool strip_checksum(enum zarr_codec codec, const uint8_t *in, size_t size, void *out,
                           size_t capacity, size_t *got, struct sp_error *err) {
    const bool is_end = codec == ZARR_CRC32C;
    bool ok = size >= 4 && size - 4 <= capacity;
    if (ok && codec == ZARR_CRC32C)
        ok = zarr_is_sound(in, size);
    else if (ok)
        ok = zarr_little(in, 4) == (codec == ZARR_CRC32 ? crc32(0, in + 4, (uInt)(size - 4))
                                                        : adler32(1, in + 4, (uInt)(size - 4)));
    if (ok) {
        *got = size - 4;
        memcpy(out, in + (is_end ? 0 : 4), *got);
    }
    return ok || sp_fail(err, SP_ERR_FORMAT, "", "the checksum is wrong: the data is damaged");
}

/* Compressors. */

static bool fail_memory(struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, "", "out of memory while unpacking");
}

static bool inflate_all(const void *in, size_t size, void *out, size_t capacity, size_t *got,
                        struct sp_error *err) {
    z_stream z = { .next_in = (Bytef *)(uintptr_t)in, .avail_in = (uInt)size };
    if (inflateInit2(&z, 15 + 32) != Z_OK) /* 32 allows the wrappers of gzip and zlib */
        return fail_memory(err);
    z.next_out = out;
    z.avail_out = (uInt)capacity;
    const int status = inflate(&z, Z_FINISH);
    *got = z.total_out;
    inflateEnd(&z);
    if (status == Z_MEM_ERROR)
        return fail_memory(err);
    return status == Z_STREAM_END ||
           sp_fail(err, SP_ERR_FORMAT, "", "the gzip or zlib data is %s",
                   status == Z_BUF_ERROR && z.avail_out == 0 ? "longer than its chunk"
                   : status == Z_BUF_ERROR                   ? "cut off"
                   : z.msg                                   ? z.msg
                                                             : "damaged");
}

/* numcodecs writes the size before the block. */
static bool unpack_lz4(const uint8_t *in, size_t size, void *out, size_t capacity, size_t *got,
                       struct sp_error *err) {
    const int n =
        size > 4 && capacity <= LZ4_MAX_INPUT_SIZE
            ? LZ4_decompress_safe((const char *)in + 4, out, (int)(size - 4), (int)capacity)
            : -1;
    *got = n < 0 ? 0 : (size_t)n;
    return (n >= 0 && zarr_little(in, 4) == *got) ||
           sp_fail(err, SP_ERR_FORMAT, "", "the LZ4 data is damaged or longer than its chunk");
}

static bool unpack_bz2(const void *in, size_t size, void *out, size_t capacity, size_t *got,
                       struct sp_error *err) {
    unsigned length = (unsigned)capacity;
    const int status =
        BZ2_bzBuffToBuffDecompress(out, &length, (char *)(uintptr_t)in, (unsigned)size, 0, 0);
    *got = length;
    if (status == BZ_MEM_ERROR)
        return fail_memory(err);
    return status == BZ_OK ||
           sp_fail(err, SP_ERR_FORMAT, "", "the bzip2 data is damaged or longer than its chunk");
}

static bool unpack_lzma(const void *in, size_t size, void *out, size_t capacity, size_t *got,
                        struct sp_error *err) {
    uint64_t limit = LZMA_MEMORY;
    size_t at = 0;
    *got = 0;
    const lzma_ret status =
        lzma_stream_buffer_decode(&limit, 0, NULL, in, &at, size, out, got, capacity);
    if (status == LZMA_MEM_ERROR)
        return fail_memory(err);
    return status == LZMA_OK ||
           sp_fail(err, SP_ERR_FORMAT, "", "the LZMA data is damaged or longer than its chunk");
}

/* Filters. */

static bool unshuffle(size_t element, const uint8_t *in, size_t size, uint8_t *out, size_t capacity,
                      size_t *got, struct sp_error *err) {
    const size_t count = size / element;
    if (size % element != 0 || size > capacity)
        return sp_fail(err, SP_ERR_FORMAT, "",
                       "the shuffled bytes are no whole numbers, or longer than their chunk");
    for (size_t i = 0; i < count; i++)
        for (size_t b = 0; b < element; b++)
            out[i * element + b] = in[b * count + i];
    *got = size;
    return true;
}

/* A number of any byte order. */
static void load(const uint8_t *at, struct import_number number, bool is_big, void *out) {
    memcpy(out, at, number.size);
    if (is_big != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__))
        import_swap_numbers(out, number, 1);
}

/* All bits of a whole number, extended by its sign. */
static uint64_t bits_of(const uint8_t *at, struct import_number number) {
    uint64_t bits = 0;
    for (size_t i = 0; i < number.size; i++)
        bits |= (uint64_t)at[__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__ ? number.size - 1 - i : i]
                << 8 * i;
    if (number.kind == IMPORT_SIGNED && number.size < 8 && bits >> (8 * number.size - 1))
        bits |= ~UINT64_C(0) << 8 * number.size;
    return bits;
}

static void set_bits(uint64_t bits, struct import_number number, uint8_t *out) {
    for (size_t i = 0; i < number.size; i++)
        out[__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__ ? number.size - 1 - i : i] =
            (uint8_t)(bits >> 8 * i);
}

/* A value as numpy casts it: towards 0. Beyond the type it is the nearest number. */
static void set_value(double value, struct import_number number, uint8_t *out) {
    double least, most;
    if (import_number_is_whole(number)) {
        import_number_range(number, &least, &most);
        most = number.size == 8 ? nextafter(most, 0) : most;
        value = isnan(value) ? 0 : fmin(fmax(trunc(value), least), most);
    }
    import_narrow(value, number, out);
}

static bool undo_numbers(const struct zarr_step *s, const uint8_t *in, size_t size, uint8_t *out,
                         size_t capacity, size_t *got, struct sp_error *err) {
    const size_t count = size / s->encoded.size;
    const bool are_whole = import_number_is_whole(s->decoded) && import_number_is_whole(s->encoded);
    uint8_t one[IMPORT_NUMBER_BYTES], sum[IMPORT_NUMBER_BYTES] = { 0 };
    uint64_t total = 0;
    if (size % s->encoded.size != 0 || count > capacity / s->decoded.size)
        return sp_fail(err, SP_ERR_FORMAT, "", "the filtered numbers do not fill their chunk");
    *got = count * s->decoded.size;
    for (size_t i = 0; i < count; i++, out += s->decoded.size) {
        load(in + i * s->encoded.size, s->encoded, s->is_encoded_big, one);
        if (are_whole && s->codec != ZARR_SCALE) {
            total = bits_of(one, s->encoded) + (s->codec == ZARR_DELTA ? total : 0);
            set_bits(total, s->decoded, out);
        } else if (s->codec == ZARR_DELTA) { /* rounded after each sum, as numpy does */
            set_value(import_widen(sum, s->decoded) + import_widen(one, s->encoded), s->decoded,
                      sum);
            memcpy(out, sum, s->decoded.size);
        } else {
            const double value = import_widen(one, s->encoded);
            set_value(s->codec == ZARR_SCALE ? value / s->scale + s->offset : value, s->decoded,
                      out);
        }
        if (s->is_decoded_big != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__))
            import_swap_numbers(out, s->decoded, 1);
    }
    return true;
}

bool zarr_step_undo(const struct zarr_step *step, const void *in, size_t size, void *out,
                    size_t capacity, size_t *got, struct sp_error *err) {
    switch (step->codec) {
    case ZARR_LZ4:
        return unpack_lz4(in, size, out, capacity, got, err);
    case ZARR_BZ2:
        return unpack_bz2(in, size, out, capacity, got, err);
    case ZARR_LZMA:
        return unpack_lzma(in, size, out, capacity, got, err);
    case ZARR_CRC32C:
    case ZARR_CRC32:
    case ZARR_ADLER32:
        return strip_checksum(step->codec, in, size, out, capacity, got, err);
    case ZARR_SHUFFLE:
        return unshuffle(step->element, in, size, out, capacity, got, err);
    case ZARR_DELTA:
    case ZARR_SCALE:
    case ZARR_CAST:
        return undo_numbers(step, in, size, out, capacity, got, err);
    default:
        return inflate_all(in, size, out, capacity, got, err);
    }
}
