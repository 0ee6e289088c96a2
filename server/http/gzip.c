/* SPDX-License-Identifier: Apache-2.0 */
#include "http/gzip.h"

#include <libdeflate.h>
#include <stdlib.h>
#include <string.h>

enum { SIZE_MIN = 1024 };

bool srv_gzip_is_for(const char *mime, size_t size) {
    static const char *const kinds[] = { "text/", "application/json", "application/yaml",
                                         "image/svg+xml" };
    if (!mime || size < SIZE_MIN)
        return false;
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
        if (strncmp(mime, kinds[i], strlen(kinds[i])) == 0)
            return true;
    return false;
}

void *srv_gzip(const void *bytes, size_t size, enum srv_gzip_level level, size_t *gzip_size) {
    struct libdeflate_compressor *compressor = libdeflate_alloc_compressor((int)level);
    if (!compressor)
        return NULL;
    void *out = malloc(size);
    *gzip_size = out ? libdeflate_gzip_compress(compressor, bytes, size, out, size) : 0;
    libdeflate_free_compressor(compressor);
    if (*gzip_size == 0) { /* out of memory, or no shorter than `bytes` */
        free(out);
        return NULL;
    }
    return out;
}
