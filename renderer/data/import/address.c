/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/address.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

bool sp_address_is_remote(const char *source) {
    return strncmp(source, "http://", 7) == 0 || strncmp(source, "https://", 8) == 0;
}

static bool is_host_char(char c) {
    return isalnum((unsigned char)c) || c == '.' || c == '-';
}

/* Reads ":PORT"; false if it is none in [1, 65535]. */
static bool read_port(const char *text, size_t length, unsigned *port) {
    char digits[6] = "";
    if (length < 2 || length > 6 || text[0] != ':')
        return false;
    memcpy(digits, text + 1, length - 1);
    if (strspn(digits, "0123456789") != length - 1)
        return false;
    *port = (unsigned)atoi(digits);
    return *port >= 1 && *port <= 65535;
}

static bool fail(const char *address, const char *what, struct sp_error *err) {
    return sp_fail(err, SP_ERR_INVALID, address, "%s", what);
}

bool sp_address_parse(const char *address, struct sp_address *parts, struct sp_error *err) {
    *parts = (struct sp_address){ .is_secure = strncmp(address, "https://", 8) == 0 };
    if (!sp_address_is_remote(address))
        return fail(address, "an address begins with http:// or https://", err);
    if (strlen(address) >= SP_ADDRESS_BYTES)
        return fail(address, "the address has more than 2047 bytes, the limit", err);
    const char *host = address + (parts->is_secure ? 8 : 7), *end = host + strcspn(host, "/");
    if (memchr(host, '@', (size_t)(end - host)))
        return fail(address, "addresses with a user or a password are not supported", err);
    size_t length = 0;
    while (host + length < end && is_host_char(host[length]))
        length++;
    if (length == 0 || length >= SP_HOST_BYTES)
        return fail(address, "the address has no host of letters, digits, '.' and '-'", err);
    memcpy(parts->host, host, length);
    parts->port = parts->is_secure ? 443 : 80;
    if (host + length < end &&
        !read_port(host + length, (size_t)(end - host) - length, &parts->port))
        return fail(address, "the host is followed by something other than a port", err);
    for (const char *c = end; *c; c++)
        if ((unsigned char)*c <= ' ' || *c == 0x7f || strchr("?#\\", *c))
            return fail(address, "the path must not contain spaces, '?', '#' or '\\'", err);
    return !strstr(end, "..") || fail(address, "the path must not contain \"..\"", err);
}

/* Splits an entry of the list into its pattern and its port, 0 = none. */
static bool read_entry(const char *entry, size_t length, char host[SP_HOST_BYTES], unsigned *port) {
    size_t n = 0, star = length > 2 && entry[0] == '*' && entry[1] == '.' ? 2 : 0;
    *port = 0;
    while (star + n < length && is_host_char(entry[star + n]))
        n++;
    n += star;
    if (n == star || n >= SP_HOST_BYTES)
        return false;
    memcpy(host, entry, n);
    host[n] = 0;
    return n == length || read_port(entry + n, length - n, port);
}

static enum sp_allowed match(const struct sp_address *parts, const char *host, unsigned port) {
    const size_t own = strlen(parts->host), length = strlen(host);
    if (port ? port != parts->port : parts->port != 80 && parts->port != 443)
        return SP_NOT_ALLOWED;
    if (strcasecmp(parts->host, host) == 0)
        return SP_ALLOWED_ANY;
    /* "*.example.org": every name that ends with ".example.org". */
    return host[0] == '*' && own > length - 1 &&
                   strcasecmp(parts->host + own - (length - 1), host + 1) == 0
               ? SP_ALLOWED_PUBLIC
               : SP_NOT_ALLOWED;
}

enum sp_allowed sp_address_allowed(const struct sp_address *parts, const char *list) {
    enum sp_allowed best = SP_NOT_ALLOWED;
    for (const char *entry = list; entry && *entry;) {
        const size_t length = strcspn(entry, ",");
        char host[SP_HOST_BYTES];
        unsigned port;
        if (read_entry(entry, length, host, &port)) {
            const enum sp_allowed found = match(parts, host, port);
            best = found > best ? found : best;
        }
        entry += length + (entry[length] == ',');
    }
    return best;
}

bool sp_address_check_list(const char *list, const char *place, struct sp_error *err) {
    for (const char *entry = list; *entry;) {
        const size_t length = strcspn(entry, ",");
        char host[SP_HOST_BYTES];
        unsigned port;
        if (!read_entry(entry, length, host, &port))
            return sp_fail(err, SP_ERR_INVALID, place, "'%.*s' is no HOST, HOST:PORT or *.DOMAIN",
                           (int)length, entry);
        entry += length + (entry[length] == ',');
    }
    return true;
}

static bool is_private_v4(const uint8_t b[4]) {
    return b[0] == 0 || b[0] == 10 || b[0] == 127 || b[0] >= 224 ||
           (b[0] == 100 && b[1] >> 6 == 1) || (b[0] == 169 && b[1] == 254) ||
           (b[0] == 172 && b[1] >> 4 == 1) || (b[0] == 192 && b[1] == 168) ||
           (b[0] == 192 && b[1] == 0 && b[2] == 0) || (b[0] == 198 && b[1] >> 1 == 9);
}

bool sp_address_is_private(const uint8_t *b, unsigned size) {
    static const uint8_t mapped[12] = { 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff };
    if (size == 4)
        return is_private_v4(b);
    if (size != 16)
        return true;
    if (memcmp(b, mapped, sizeof mapped) == 0)
        return is_private_v4(b + 12);
    /* Public ones are 2000::/3; 2002::/16 and 2001::/32 carry IPv4 addresses in tunnels. */
    return b[0] >> 5 != 1 || (b[0] == 0x20 && b[1] == 0x02) ||
           (b[0] == 0x20 && b[1] == 0x01 && b[2] == 0 && b[3] == 0);
}
