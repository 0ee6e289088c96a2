/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SRV_HTTP_GZIP_H
#define SRV_HTTP_GZIP_H

#include <stdbool.h>
#include <stddef.h>

/* True if compression is worthwhile: for text of 1 KiB or more. Images are compressed already.
 * `mime` may be NULL. */
bool srv_gzip_is_for(const char *mime, size_t size);

/* Compression levels of libdeflate. FAST is for answers that are compressed for each request, SMALL
 * for files of the page, which are compressed once. */
enum srv_gzip_level { SRV_GZIP_FAST = 6, SRV_GZIP_SMALL = 12 };

/* Compresses to a gzip member (RFC 1952), which the caller frees. NULL when out of memory, or if
 * the result would not be shorter. */
void *srv_gzip(const void *bytes, size_t size, enum srv_gzip_level level, size_t *gzip_size);

#endif
