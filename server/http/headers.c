/* SPDX-License-Identifier: Apache-2.0 */
#include "http/headers.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

static const char *skip(const char *s) {
    return s + strspn(s, " \t");
}

/* Returns the length without trailing spaces and tabs. */
static size_t trimmed(const char *s, size_t length) {
    while (length > 0 && (s[length - 1] == ' ' || s[length - 1] == '\t'))
        length--;
    return length;
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
