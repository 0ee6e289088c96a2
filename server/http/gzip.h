/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SRV_HTTP_GZIP_H
#define SRV_HTTP_GZIP_H

#include <stdbool.h>
#include <stddef.h>

/* Is it worth it? Text of some length; pictures are compressed already. `mime` may be NULL. */
bool srv_gzip_is_for(const char *mime, size_t size);

/* A gzip member (RFC 1952) that holds `bytes`, shorter than they are: malloc'ed, the caller's. NULL
 * = out of memory, or it would not be shorter. */
void *srv_gzip(const void *bytes, size_t size, size_t *gzip_size);

#endif
