/* SPDX-License-Identifier: Apache-2.0
 *
 * Files that are part of the binary: the web page and the contract. CMake generates the table from
 * explicit lists (embed.cmake).
 */
#ifndef SRV_HTTP_ASSETS_H
#define SRV_HTTP_ASSETS_H

#include <stddef.h>

#include "sp/status.h"

struct srv_asset {
    const char *path; /* below the root: "/app/main.js" */
    const char *mime;
    const unsigned char *begin, *end; /* constant memory */
};

extern const struct srv_asset srv_assets[];
extern const size_t srv_asset_count;

/* ETag and compressed bytes of each asset, computed once: an array beside srv_assets. */
struct srv_packed_asset {
    char etag[20]; /* of its bytes, in quotes */
    void *gzip;    /* NULL = served uncompressed */
    size_t gzip_size;
};
/* NULL with *err set. */
struct srv_packed_asset *srv_assets_pack(struct sp_error *err);
void srv_assets_release(struct srv_packed_asset **packed);

#endif
