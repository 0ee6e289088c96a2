/* SPDX-License-Identifier: Apache-2.0 */
#include "http/upload_headers.h"

#include <gnutls/crypto.h>
#include <gnutls/gnutls.h>
#include <stdlib.h>
#include <string.h>

enum { NUMBER_DIGITS = 16 };
#define NUMBER_MAX (UINT64_C(1) << 53)

bool srv_upload_number(const char *text, uint64_t *number) {
    size_t length = text ? strspn(text, "0123456789") : 0;
    if (length == 0 || length > NUMBER_DIGITS || text[length])
        return false;
    *number = strtoull(text, NULL, 10);
    return *number <= NUMBER_MAX;
}

/* Decodes base64[0, length) to at most `size` bytes. */
static bool decode(const char *base64, size_t length, unsigned char *out, size_t size,
                   size_t *out_length) {
    gnutls_datum_t in = { (unsigned char *)(uintptr_t)base64, (unsigned)length }, decoded;
    *out_length = 0;
    if (length == 0)
        return true;
    if (gnutls_base64_decode2(&in, &decoded) != 0)
        return false;
    bool fits = decoded.size <= size;
    if (fits) {
        memcpy(out, decoded.data, decoded.size);
        *out_length = decoded.size;
    }
    gnutls_free(decoded.data);
    return fits;
}

bool srv_upload_metadata(const char *header, const char *key, char value[SRV_METADATA_BYTES],
                         size_t *length) {
    size_t key_length = strlen(key);
    for (const char *pair = header; pair && *pair;) {
        pair += strspn(pair, " \t");
        size_t whole = strcspn(pair, ","), name = strcspn(pair, " ,");
        if (name == key_length && strncmp(pair, key, name) == 0) {
            const char *base64 = pair + name;
            size_t gap = strspn(base64, " "), left = whole - name;
            gap = gap < left ? gap : left;
            size_t size = left - gap;
            while (size > 0 && base64[gap + size - 1] == ' ')
                size--;
            if (!decode(base64 + gap, size, (unsigned char *)value, SRV_METADATA_BYTES - 1, length))
                return false;
            value[*length] = 0;
            return strlen(value) == *length;
        }
        pair += whole;
        pair += *pair == ',';
    }
    return false;
}

static const struct {
    const char *name;
    gnutls_digest_algorithm_t algorithm;
} algorithms[] = {
    { "sha1", GNUTLS_DIG_SHA1 },
    { "sha256", GNUTLS_DIG_SHA256 },
    { "sha512", GNUTLS_DIG_SHA512 },
    { "md5", GNUTLS_DIG_MD5 },
};

bool srv_checksum_parse(const char *header, int *algorithm,
                        unsigned char digest[SRV_DIGEST_BYTES]) {
    size_t name = header ? strcspn(header, " ") : 0, length;
    if (name == 0 || !header[name])
        return false;
    const char *base64 = header + name + strspn(header + name, " ");
    for (size_t i = 0; i < sizeof algorithms / sizeof *algorithms; i++) {
        if (strlen(algorithms[i].name) != name || strncmp(algorithms[i].name, header, name) != 0)
            continue;
        *algorithm = (int)algorithms[i].algorithm;
        return decode(base64, strlen(base64), digest, SRV_DIGEST_BYTES, &length) &&
               length == gnutls_hash_get_len(algorithms[i].algorithm);
    }
    return false;
}

struct srv_checksum {
    gnutls_hash_hd_t hash;
    size_t length;
    unsigned char expected[SRV_DIGEST_BYTES];
    bool has_failed;
};

struct srv_checksum *srv_checksum_create(int algorithm,
                                         const unsigned char expected[SRV_DIGEST_BYTES]) {
    struct srv_checksum *checksum = calloc(1, sizeof *checksum);
    if (!checksum)
        return NULL;
    if (gnutls_hash_init(&checksum->hash, (gnutls_digest_algorithm_t)algorithm) != 0) {
        free(checksum);
        return NULL;
    }
    checksum->length = gnutls_hash_get_len((gnutls_digest_algorithm_t)algorithm);
    memcpy(checksum->expected, expected, SRV_DIGEST_BYTES);
    return checksum;
}

void srv_checksum_add(struct srv_checksum *checksum, const void *bytes, size_t size) {
    if (gnutls_hash(checksum->hash, bytes, size) != 0)
        checksum->has_failed = true;
}

bool srv_checksum_matches(struct srv_checksum **checksum_pointer) {
    struct srv_checksum *checksum = *checksum_pointer;
    unsigned char digest[SRV_DIGEST_BYTES];
    *checksum_pointer = NULL;
    if (!checksum)
        return true;
    gnutls_hash_deinit(checksum->hash, digest);
    bool same = !checksum->has_failed && memcmp(digest, checksum->expected, checksum->length) == 0;
    free(checksum);
    return same;
}
