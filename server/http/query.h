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

/* Finds the bytes [*from, *from + *count) of `size` that a Range header asks for (RFC 9110, 14). A
 * single range is granted. The whole is sent if there are several ranges, another unit, or an
 * If-Range that is not `etag`. SRV_RANGE_NONE: there are no such bytes. Both headers may be NULL.
 */
enum srv_range srv_header_range(const char *range, const char *if_range, const char *etag,
                                uint64_t size, uint64_t *from, uint64_t *count);

#endif
