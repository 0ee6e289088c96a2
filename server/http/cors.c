/* SPDX-License-Identifier: Apache-2.0 */
#include "http/cors.h"

#include <string.h>
#include <strings.h>

#include "http/headers.h"

static bool is_origin(const char *text, size_t length) {
    static const char *const schemes[] = { "http://", "https://" };
    for (size_t i = 0; i < 2; i++) {
        size_t scheme = strlen(schemes[i]);
        if (length <= scheme || strncmp(text, schemes[i], scheme) != 0)
            continue;
        size_t host = strspn(text + scheme, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                            "0123456789.-:[]");
        return host == length - scheme;
    }
    return false;
}

bool srv_cors_check_origins(const char *list, struct sp_error *err) {
    if (list && strlen(list) > SRV_ORIGINS_MAX)
        return sp_fail(err, SP_ERR_INVALID, "--allow-origin",
                       "the list has %zu characters and may have %d; put the pages behind fewer "
                       "origins",
                       strlen(list), SRV_ORIGINS_MAX);
    for (const char *at = list; at;) {
        size_t length = strcspn(at, ",");
        if (!is_origin(at, length))
            return sp_fail(
                err, SP_ERR_INVALID, "--allow-origin",
                "'%.*s' is not an origin: write http[s]://HOST[:PORT] without a path, and "
                "separate origins by commas",
                length < 100 ? (int)length : 100, at);
        at = at[length] ? at + length + 1 : NULL;
    }
    return true;
}

bool srv_cors_allows(const char *list, const char *origin) {
    return list && origin && *origin && srv_header_has_token(list, origin);
}

bool srv_cors_is_same_origin(const char *origin, const char *host) {
    if (!origin)
        return true;
    if (!host)
        return false;
    bool https = strncasecmp(origin, "https://", 8) == 0;
    if (!https && strncasecmp(origin, "http://", 7) != 0)
        return false;
    const char *given = origin + (https ? 8 : 7), *scheme_port = https ? ":443" : ":80";
    size_t a = strlen(given), b = strlen(host);
    size_t port = strlen(scheme_port);
    if (a > port && strcmp(given + a - port, scheme_port) == 0)
        a -= port;
    if (b > port && strcmp(host + b - port, scheme_port) == 0)
        b -= port;
    return a == b && a > 0 && strncasecmp(given, host, a) == 0;
}
