/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/hdf5_filters.h"

#include <string.h>
#include <zstd.h>
#ifdef SPLATD_HAS_BLOSC
#include <blosc.h>
#endif

enum { LZF = 32000, BLOSC = 32001, ZSTD = 32015, UNPACKED_MAX = 1 << 30 };

/* The fewest bytes that a filter may unpack; 0 = any. HDF5 tells a filter nothing about the array,
 * and a process reads one array at a time. */
static size_t least_bytes;

void hdf5_filters_expect(hid_t dataset) {
    enum { RANK_MAX = 32 };
    hsize_t chunk[RANK_MAX];
    const hid_t list = H5Dget_create_plist(dataset), type = H5Dget_type(dataset);
    const int rank = H5Pget_layout(list) == H5D_CHUNKED ? H5Pget_chunk(list, RANK_MAX, chunk) : 0;
    int packers = 0; /* filters that change the number of bytes: only the last one fills a chunk */
    for (int i = 0; i < H5Pget_nfilters(list); i++) {
        unsigned flags, config;
        size_t count = 0;
        const H5Z_filter_t id =
            H5Pget_filter2(list, (unsigned)i, &flags, &count, NULL, 0, NULL, &config);
        packers += id != H5Z_FILTER_SHUFFLE && id != H5Z_FILTER_FLETCHER32;
    }
    least_bytes = rank > 0 && rank <= RANK_MAX && packers == 1 ? H5Tget_size(type) : 0;
    for (int d = 0; d < rank && d < RANK_MAX; d++)
        least_bytes *= (size_t)chunk[d];
    H5Tclose(type);
    H5Pclose(list);
}

/* Replaces the buffer by the unpacked bytes, of memory of HDF5. Returns their number, or 0 and
 * frees them on failure. */
static size_t replace(void **buffer, size_t *buffer_size, void *unpacked, size_t capacity,
                      size_t size) {
    if (size < least_bytes)
        size = 0;
    H5free_memory(size > 0 ? *buffer : unpacked);
    if (size > 0) {
        *buffer = unpacked;
        *buffer_size = capacity;
    }
    return size;
}

/* LibLZF: a code below 32 begins a run of code + 1 bytes; another one holds 3 bits of the length of
 * a copy, less 2 (7 = a byte with more follows), and 5 bits of the distance, whose other 8 bits
 * follow. Returns the number of bytes, or 0 if the data is damaged or does not fit. */
static size_t unpack_lzf(const uint8_t *in, size_t size, uint8_t *out, size_t capacity) {
    size_t at = 0, done = 0;
    while (at < size) {
        const unsigned code = in[at++];
        if (code < 32) {
            const size_t n = code + 1U;
            if (n > size - at || n > capacity - done)
                return 0;
            memcpy(out + done, in + at, n);
            at += n;
            done += n;
            continue;
        }
        size_t n = code >> 5;
        if (n == 7 && at < size)
            n += in[at++];
        n += 2;
        if (at >= size)
            return 0;
        const size_t distance = ((size_t)(code & 31) << 8) + in[at++] + 1;
        if (distance > done || n > capacity - done)
            return 0;
        for (size_t i = 0; i < n; i++, done++) /* the copy may overlap */
            out[done] = out[done - distance];
    }
    return done;
}

/* h5py writes the size of a chunk into the third parameter. */
static size_t filter_lzf(unsigned flags, size_t count, const unsigned *parameters, size_t size,
                         size_t *buffer_size, void **buffer) {
    size_t capacity = count >= 3 && parameters[2] ? parameters[2] : *buffer_size * 4;
    if (!(flags & H5Z_FLAG_REVERSE))
        return 0;
    for (; capacity <= UNPACKED_MAX; capacity *= 2) {
        uint8_t *out = H5allocate_memory(capacity, 0);
        const size_t got = out ? unpack_lzf(*buffer, size, out, capacity) : 0;
        if (got || !out)
            return replace(buffer, buffer_size, out, capacity, got);
        H5free_memory(out);
        if (count >= 3 && parameters[2])
            break;
    }
    return 0;
}

static size_t filter_zstd(unsigned flags, size_t count, const unsigned *parameters, size_t size,
                          size_t *buffer_size, void **buffer) {
    const unsigned long long known = ZSTD_getFrameContentSize(*buffer, size);
    (void)count;
    (void)parameters;
    if (!(flags & H5Z_FLAG_REVERSE) || known == 0 || known > UNPACKED_MAX)
        return 0; /* also those whose size is not known */
    void *out = H5allocate_memory((size_t)known, 0);
    const size_t got = out ? ZSTD_decompress(out, (size_t)known, *buffer, size) : 0;
    return replace(buffer, buffer_size, out, (size_t)known, ZSTD_isError(got) ? 0 : got);
}

#ifdef SPLATD_HAS_BLOSC
static size_t filter_blosc(unsigned flags, size_t count, const unsigned *parameters, size_t size,
                           size_t *buffer_size, void **buffer) {
    size_t capacity = 0;
    (void)count;
    (void)parameters;
    if (!(flags & H5Z_FLAG_REVERSE) || blosc_cbuffer_validate(*buffer, size, &capacity) < 0 ||
        capacity == 0 || capacity > UNPACKED_MAX)
        return 0;
    void *out = H5allocate_memory(capacity, 0);
    const int got = out ? blosc_decompress_ctx(*buffer, out, capacity, 1) : 0;
    return replace(buffer, buffer_size, out, capacity, got > 0 ? (size_t)got : 0);
}
#endif

void hdf5_filters_register(void) {
    const H5Z_class2_t filters[] = {
        { H5Z_CLASS_T_VERS, LZF, 0, 1, "LZF", NULL, NULL, filter_lzf },
        { H5Z_CLASS_T_VERS, ZSTD, 0, 1, "Zstandard", NULL, NULL, filter_zstd },
#ifdef SPLATD_HAS_BLOSC
        { H5Z_CLASS_T_VERS, BLOSC, 0, 1, "Blosc", NULL, NULL, filter_blosc },
#endif
    };
    for (size_t i = 0; i < sizeof filters / sizeof *filters; i++)
        H5Zregister(&filters[i]);
}
