/* SPDX-License-Identifier: Apache-2.0 */
#include "http/gzip.h"

#include <limits.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

enum { SIZE_MIN = 1024, WINDOW_BITS = 15, GZIP_FORMAT = 16, MEMORY_LEVEL = 8 };

bool srv_gzip_is_for(const char *mime, size_t size) {
    static const char *const kinds[] = { "text/", "application/json", "application/yaml",
                                         "image/svg+xml" };
    if (!mime || size < SIZE_MIN || size > UINT_MAX)
        return false;
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
        if (strncmp(mime, kinds[i], strlen(kinds[i])) == 0)
            return true;
    return false;
}

void *srv_gzip(const void *bytes, size_t size, enum srv_gzip_level level, size_t *gzip_size) {
    z_stream z = { .next_in = (Bytef *)(uintptr_t)bytes, .avail_in = (uInt)size };
    void *out = malloc(size);
    if (!out)
        return NULL;
    z.next_out = out;
    z.avail_out = (uInt)size;
    bool ok = deflateInit2(&z, (int)level, Z_DEFLATED, WINDOW_BITS + GZIP_FORMAT, MEMORY_LEVEL,
                           Z_DEFAULT_STRATEGY) == Z_OK;
    if (ok) {
        ok = deflate(&z, Z_FINISH) == Z_STREAM_END;
        *gzip_size = size - z.avail_out;
        deflateEnd(&z);
    }
    if (!ok) {
        free(out);
        return NULL;
    }
    return out;
}
