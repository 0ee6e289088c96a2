/* SPDX-License-Identifier: Apache-2.0 */
#include "http/headers.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <gnutls/crypto.h>
#include <gnutls/gnutls.h>

static const char *skip(const char *s) {
    return s + strspn(s, " \t");
}

/* Returns the length without trailing spaces and tabs. */
static size_t trimmed(const char *s, size_t length) {
    while (length > 0 && (s[length - 1] == ' ' || s[length - 1] == '\t'))
        length--;
    return length;
}

void srv_header_trim(char *value) {
    value[trimmed(value, strlen(value))] = 0;
}

bool srv_header_has_token(const char *list, const char *token) {
    size_t wanted = strlen(token);
    for (const char *at = list; at && *at;) {
        at = skip(at);
        size_t length = strcspn(at, ",");
        if (trimmed(at, length) == wanted && strncasecmp(at, token, wanted) == 0)
            return true;
        at += length + (at[length] == ',');
    }
    return false;
}

/* How precisely a media range matches: 3 = the type, 2 = its group (image/...), 1 = any type, 0 =
 * no match. */
static int specificity(const char *range, size_t length, const char *mime) {
    size_t group = strcspn(mime, "/");
    if (length == strlen(mime) && strncasecmp(range, mime, length) == 0)
        return 3;
    if (length == group + 2 && strncasecmp(range, mime, group) == 0 &&
        strncmp(range + group, "/*", 2) == 0)
        return 2;
    return length == 3 && strncmp(range, "*/*", 3) == 0 ? 1 : 0;
}

static double q_of(const char *parameters, size_t length) {
    const char *end = parameters + length;
    for (const char *at = parameters; at < end;) {
        at = skip(at + (*at == ';'));
        size_t part = strcspn(at, ";,");
        if (part >= 2 && strncasecmp(at, "q=", 2) == 0) {
            double q = strtod(at + 2, NULL);
            return q >= 0 && q <= 1 ? q : 0;
        }
        at += part;
    }
    return 1;
}

double srv_header_accept_quality(const char *accept, const char *mime) {
    if (!accept)
        return 1;
    int best = 0;
    double quality = 0;
    for (const char *at = accept; *at;) {
        at = skip(at);
        size_t length = strcspn(at, ","), type = strcspn(at, ";,");
        int s = specificity(at, trimmed(at, type), mime);
        if (s > best) {
            best = s;
            quality = q_of(at + type, length - type);
        }
        at += length + (at[length] == ',');
    }
    return quality;
}

bool srv_header_has_etag(const char *if_none_match, const char *etag) {
    for (const char *at = if_none_match; at && *at;) {
        at = skip(at);
        if (strncmp(at, "W/", 2) == 0)
            at += 2;
        size_t length = strcspn(at, ","), own = trimmed(at, length);
        if ((own == 1 && *at == '*') || (own == strlen(etag) && strncmp(at, etag, own) == 0))
            return true;
        at += length + (at[length] == ',');
    }
    return false;
}

const char *srv_header_bearer_token(const char *authorization) {
    if (!authorization || strncasecmp(authorization, "Bearer ", 7) != 0)
        return NULL;
    return skip(authorization + 7);
}

bool srv_header_is_json(const char *content_type) {
    static const char *const types[] = { "application/json", "application/merge-patch+json" };
    if (!content_type)
        return true;
    size_t length = trimmed(content_type, strcspn(content_type, ";"));
    for (size_t i = 0; i < sizeof types / sizeof *types; i++)
        if (length == strlen(types[i]) && strncasecmp(content_type, types[i], length) == 0)
            return true;
    return false;
}

bool srv_header_websocket_accept(const char *key, char accept[SRV_WEBSOCKET_ACCEPT_BYTES]) {
    enum { SHA1_BYTES = 20 };
    char text[128];
    uint8_t digest[SHA1_BYTES];
    assert(strlen(key) <= 64);
    int length = snprintf(text, sizeof text, "%s258EAFA5-E914-47DA-95CA-C5AB0DC85B11", key);
    if (gnutls_hash_fast(GNUTLS_DIG_SHA1, text, (size_t)length, digest) != 0)
        return false;
    gnutls_datum_t from = { digest, sizeof digest }, encoded;
    if (gnutls_base64_encode2(&from, &encoded) != 0)
        return false;
    assert(encoded.size == SRV_WEBSOCKET_ACCEPT_BYTES - 1);
    memcpy(accept, encoded.data, encoded.size);
    accept[encoded.size] = 0;
    gnutls_free(encoded.data);
    return true;
}

/* Query values and Range. */

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

bool srv_query_numbers(const char *text, unsigned count, double *numbers) {
    if (text[strspn(text, "0123456789+-.eE,")]) /* strtod() takes more: blanks, "nan", "0x1p3" */
        return false;
    for (unsigned i = 0; i < count; i++) {
        char *end;
        double number = strtod(text, &end);
        if (end == text || !isfinite(number) || *end != (i + 1 < count ? ',' : 0))
            return false;
        numbers[i] = number;
        text = end + 1;
    }
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
    return SRV_RANGE_PARTIAL;
}
