/* SPDX-License-Identifier: Apache-2.0
 *
 * What values in a query, and of the header Range, mean. Pure functions.
 */
#ifndef SRV_HTTP_QUERY_H
#define SRV_HTTP_QUERY_H

#include <stdbool.h>
#include <stdint.h>

/* A whole number in [1, max]: digits and nothing else. */
bool srv_query_number(const char *text, unsigned max, unsigned *number);

/* "WIDTH,HEIGHT": whole numbers of at most 5 digits. */
bool srv_query_size(const char *text, uint32_t size[2]);

enum srv_range { SRV_RANGE_WHOLE, SRV_RANGE_PART, SRV_RANGE_NONE };

/* Which bytes [*from, *from + *count) of `size` does a Range header ask for (RFC 9110, 14)? One
 * range is granted; what is none of bytes, or several, or of another state than `etag` (If-Range),
 * is answered with all. SRV_RANGE_NONE: there are no such bytes. Both headers may be NULL. */
enum srv_range srv_header_range(const char *range, const char *if_range, const char *etag,
                                uint64_t size, uint64_t *from, uint64_t *count);

#endif
