/* SPDX-License-Identifier: Apache-2.0 */
#include "http/router.h"

#include <string.h>

/* True if the path matches the pattern. Writes the segment that matched {} to `param`; several are
 * joined by "/". False also if `param` is too short for them. */
static bool matches(const char *pattern, const char *path, char param[SRV_PARAM_BYTES]) {
    size_t used = 0;
    param[0] = 0;
    while (*pattern) {
        if (strncmp(pattern, "{}", 2) != 0) {
            if (*pattern++ != *path++)
                return false;
            continue;
        }
        size_t length = strcspn(path, "/"), start = used ? used + 1 : 0;
        if (length == 0 || start + length >= SRV_PARAM_BYTES)
            return false;
        if (used)
            param[used] = '/';
        memcpy(param + start, path, length);
        used = start + length;
        param[used] = 0;
        pattern += 2;
        path += length;
    }
    return *path == 0;
}

static const struct {
    const char *name;
    unsigned method;
} names[] = {
    { "GET", SRV_GET },         { "HEAD", SRV_GET },    { "POST", SRV_POST },
    { "PUT", SRV_PUT },         { "PATCH", SRV_PATCH }, { "DELETE", SRV_DELETE },
    { "OPTIONS", SRV_OPTIONS },
};
enum { NAMES = sizeof names / sizeof *names };

unsigned srv_method_bit(const char *name) {
    for (size_t i = 0; i < NAMES; i++)
        if (strcmp(names[i].name, name) == 0)
            return names[i].method;
    return 0;
}

const struct srv_route *srv_route_find(const struct srv_route *routes, size_t count,
                                       const char *method, const char *path,
                                       char param[SRV_PARAM_BYTES], unsigned *allowed) {
    unsigned wanted = srv_method_bit(method);
    *allowed = 0;
    for (size_t i = 0; i < count; i++) {
        if (!matches(routes[i].pattern, path, param))
            continue;
        if (routes[i].method == wanted)
            return &routes[i];
        *allowed |= routes[i].method;
    }
    return NULL;
}

bool srv_route_accepts(const struct srv_route *route, const char *name) {
    for (size_t i = 0; i < SRV_QUERY_NAMES && route->query[i]; i++)
        if (strcmp(route->query[i], name) == 0)
            return true;
    return strcmp(name, "token") == 0;
}

void srv_methods_to_text(unsigned methods, char text[64]) {
    text[0] = 0;
    for (size_t i = 0; i < NAMES; i++) {
        if (!(names[i].method & methods))
            continue;
        if (text[0])
            strcat(text, ", ");
        strcat(text, names[i].name);
    }
}
