/* SPDX-License-Identifier: Apache-2.0
 *
 * Parsers of query values and of the header Range. Pure functions.
 */
#ifndef SRV_HTTP_QUERY_H
#define SRV_HTTP_QUERY_H

#include <stdbool.h>
#include <stdint.h>

/* Parses a whole number in [1, max]: digits only. */
bool srv_query_number(const char *text, unsigned max, unsigned *number);

/* Parses "WIDTH,HEIGHT": whole numbers of at most 5 digits. */
bool srv_query_size(const char *text, uint32_t size[2]);

enum srv_range { SRV_RANGE_WHOLE, SRV_RANGE_PART, SRV_RANGE_NONE };

/* Decodes a Range header (RFC 9110, 14) for a file of `size` bytes: the answer has the bytes
 * [*from, *from + *count). SRV_RANGE_PART: a single range. SRV_RANGE_WHOLE: no or several ranges,
 * another unit, or an If-Range other than `etag`. SRV_RANGE_NONE: the file does not have these
 * bytes. Both headers may be NULL. */
enum srv_range srv_header_range(const char *range, const char *if_range, const char *etag,
                                uint64_t size, uint64_t *from, uint64_t *count);

#endif
