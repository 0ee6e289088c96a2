/* SPDX-License-Identifier: Apache-2.0 */
#include "http/query.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char digits[] = "0123456789";

bool srv_query_number(const char *text, unsigned max, unsigned *number) {
    unsigned long value = strtoul(text, NULL, 10); /* ULONG_MAX if there are too many digits */
    bool ok = *text && !text[strspn(text, digits)] && value >= 1 && value <= max;
    if (ok)
        *number = (unsigned)value;
    return ok;
}

bool srv_query_size(const char *text, uint32_t size[2]) {
    unsigned width, height;
    char end;
    if (text[strspn(text, "0123456789,")] || sscanf(text, "%5u,%5u%c", &width, &height, &end) != 2)
        return false;
    size[0] = width;
    size[1] = height;
    return true;
}

/* Reads digits at *text and advances it. The number is UINT64_MAX if there are too many digits.
 * False: no digits. */
static bool read_digits(const char **text, uint64_t *number) {
    size_t count = strspn(*text, digits);
    *number = count ? strtoull(*text, NULL, 10) : 0; /* UINT64_MAX on overflow */
    *text += count;
    return count > 0;
}

enum srv_range srv_header_range(const char *range, const char *if_range, const char *etag,
                                uint64_t size, uint64_t *from, uint64_t *count) {
    uint64_t first, last;
    *from = 0;
    *count = size;
    if (!range || strncmp(range, "bytes=", 6) != 0 || (if_range && strcmp(if_range, etag) != 0))
        return SRV_RANGE_WHOLE;
    range += 6;
    bool has_first = read_digits(&range, &first);
    if (*range++ != '-')
        return SRV_RANGE_WHOLE;
    bool has_last = read_digits(&range, &last);
    if (*range || (!has_first && !has_last) || (has_first && has_last && last < first))
        return SRV_RANGE_WHOLE;
    if (!has_first) /* "bytes=-N": the last N bytes */
        first = last < size ? size - last : 0;
    if (first >= size)
        return SRV_RANGE_NONE;
    *from = first;
    *count = (has_first && has_last && last < size ? last + 1 : size) - first;
    return SRV_RANGE_PART;
}
