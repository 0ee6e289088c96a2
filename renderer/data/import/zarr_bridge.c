/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/zarr_bridge.h"

#include <blosc.h>
#include <zstd.h>
#include <zstd_errors.h>

static bool unpack_blosc(const void *in, size_t size, void *out, size_t capacity, size_t *got,
                         struct sp_error *err) {
    if (blosc_cbuffer_validate(in, size, got) < 0)
        return sp_fail(err, SP_ERR_FORMAT, "", "the Blosc data is damaged or cut off");
    if (*got > capacity)
        return sp_fail(err, SP_ERR_FORMAT, "",
                       "the Blosc data unpacks to %zu bytes; the chunk has %zu", *got, capacity);
    const int n = blosc_decompress_ctx(in, out, capacity, 1);
    if (n < 0 || (size_t)n != *got) {
        const char *name = blosc_cbuffer_complib(in);
        return sp_fail(err, SP_ERR_FORMAT, "",
                       "the Blosc data cannot be unpacked; its compressor is %s",
                       name ? name : "unknown");
    }
    return true;
}

static bool unpack_zstd(const void *in, size_t size, void *out, size_t capacity, size_t *got,
                        struct sp_error *err) {
    *got = ZSTD_decompress(out, capacity, in, size);
    const bool is_short = ZSTD_getErrorCode(*got) == ZSTD_error_memory_allocation;
    return !ZSTD_isError(*got) ||
           sp_fail(err, is_short ? SP_ERR_MEMORY : SP_ERR_FORMAT, "",
                   "the Zstandard data is damaged: %s", ZSTD_getErrorName(*got));
}

__attribute__((visibility("default")))
const struct zarr_bridge_functions splat_zarr_bridge = { unpack_blosc, unpack_zstd };
