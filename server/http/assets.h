/* SPDX-License-Identifier: Apache-2.0
 *
 * Files that are part of the binary: the page, and the contract. The table is made by CMake
 * (embed.cmake) from explicit lists.
 */
#ifndef SRV_HTTP_ASSETS_H
#define SRV_HTTP_ASSETS_H

#include <stddef.h>

struct srv_asset {
    const char *path; /* below the root: "/app/main.js" */
    const char *mime;
    const unsigned char *begin, *end; /* constant memory */
};

extern const struct srv_asset srv_assets[];
extern const size_t srv_asset_count;

#endif
