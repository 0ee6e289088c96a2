/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/zarr_bridge.h"

#include <blosc.h>
#include <stdio.h>
#include <zstd.h>

static bool unpack_blosc(const void *in, size_t size, void *out, size_t capacity, size_t *got,
                         char *why, size_t why_size) {
    if (blosc_cbuffer_validate(in, size, got) < 0) {
        snprintf(why, why_size, "the Blosc data is damaged or cut off");
        return false;
    }
    if (*got > capacity) {
        snprintf(why, why_size, "the Blosc data unpacks to %zu bytes; the chunk has %zu", *got,
                 capacity);
        return false;
    }
    const int n = blosc_decompress_ctx(in, out, capacity, 1);
    if (n < 0 || (size_t)n != *got) {
        const char *name = blosc_cbuffer_complib(in);
        snprintf(why, why_size, "the Blosc data cannot be unpacked; its compressor is %s",
                 name ? name : "unknown");
        return false;
    }
    return true;
}

static bool unpack_zstd(const void *in, size_t size, void *out, size_t capacity, size_t *got,
                        char *why, size_t why_size) {
    *got = ZSTD_decompress(out, capacity, in, size);
    if (!ZSTD_isError(*got))
        return true;
    snprintf(why, why_size, "the Zstandard data is damaged: %s", ZSTD_getErrorName(*got));
    return false;
}

__attribute__((visibility("default")))
const struct zarr_bridge_functions splat_zarr_bridge = { unpack_blosc, unpack_zstd };
