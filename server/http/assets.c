/* SPDX-License-Identifier: Apache-2.0 */
#include "http/assets.h"

#include <inttypes.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include "http/gzip.h"

static uint64_t hash(const struct srv_asset *asset) {
    uint64_t h = UINT64_C(0xcbf29ce484222325); /* FNV-1a */
    for (const unsigned char *c = asset->begin; c < asset->end; c++)
        h = (h ^ *c) * UINT64_C(0x100000001b3);
    return h;
}

struct srv_packed_asset *srv_assets_pack(struct sp_error *err) {
    struct srv_packed_asset *packed = calloc(srv_asset_count + 1, sizeof *packed);
    if (!packed) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the page");
        return NULL;
    }
    for (size_t i = 0; i < srv_asset_count; i++) {
        const struct srv_asset *asset = &srv_assets[i];
        size_t size = (size_t)(asset->end - asset->begin);
        snprintf(packed[i].etag, sizeof packed[i].etag, "\"%016" PRIx64 "\"", hash(asset));
        if (srv_gzip_is_for(asset->mime, size))
            packed[i].gzip = srv_gzip(asset->begin, size, SRV_GZIP_SMALL, &packed[i].gzip_size);
    }
    return packed;
}

void srv_assets_release(struct srv_packed_asset **packed) {
    for (size_t i = 0; *packed && i < srv_asset_count; i++)
        free((*packed)[i].gzip);
    free(*packed);
    *packed = NULL;
}
