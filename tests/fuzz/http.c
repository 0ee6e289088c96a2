/* SPDX-License-Identifier: Apache-2.0
 *
 * Request lines and headers, as the daemon checks them after the HTTP library has split them into
 * lines. The input is a list of requests, separated by empty lines. Bodies are not part of it.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "http/address.h"
#include "http/cors.h"
#include "http/headers.h"
#include "http/router.h"
#include "http/smuggling.h"

enum { TARGET_MAX = 256 };

static void handle_nothing(struct srv_request *request, struct srv_reply *reply) {
    (void)request;
    (void)reply;
}

static const struct srv_route routes[] = {
    { SRV_GET, "/healthz", SRV_RIGHT_NONE, handle_nothing, { NULL } },
    { SRV_GET, "/api/v1/volumes", SRV_RIGHT_NONE, handle_nothing, { NULL } },
    { SRV_POST, "/api/v1/volumes", SRV_RIGHT_NONE, handle_nothing, { NULL } },
    { SRV_GET, "/api/v1/volumes/{}", SRV_RIGHT_NONE, handle_nothing, { NULL } },
    { SRV_DELETE, "/api/v1/volumes/{}", SRV_RIGHT_NONE, handle_nothing, { NULL } },
    { SRV_GET, "/api/v1/volumes/{}/view", SRV_RIGHT_NONE, handle_nothing, { NULL } },
    { SRV_PATCH, "/api/v1/sessions/{}", SRV_RIGHT_NONE, handle_nothing, { NULL } },
    { SRV_GET, "/api/v1/sessions/{}/volumes/{}/view", SRV_RIGHT_NONE, handle_nothing, { NULL } },
};
enum { ROUTES = sizeof routes / sizeof *routes };

static void must(bool holds) {
    if (!holds)
        abort();
}

static void check_path(const char *method, const char *path) {
    char param[SRV_PARAM_BYTES], text[64];
    unsigned allowed;
    const struct srv_route *route = srv_route_find(routes, ROUTES, method, path, param, &allowed);
    if (route) {
        const char *first = strstr(route->pattern, "{}"), *slash = strchr(param, '/');
        const bool has_two = first && strstr(first + 2, "{}");
        must(strlen(param) < SRV_PARAM_BYTES);
        must(has_two == (slash != NULL) && !(slash && strchr(slash + 1, '/')));
        must(!strstr(route->pattern, "{}") == !*param);
        must(route->method == srv_method_bit(method));
    } else {
        srv_methods_to_text(allowed, text);
        must(strlen(text) < sizeof text && !allowed == !*text);
    }
}

/* An address that is parsed, printed and parsed again is the same address. */
static void check_address(const char *text) {
    struct srv_address address, again;
    char written[SRV_ADDRESS_TEXT];
    if (!srv_address_parse(text, &address, NULL))
        return;
    const struct sockaddr *a = (const struct sockaddr *)&address.storage;
    srv_address_to_text(a, written);
    must(srv_address_parse(written, &again, NULL));
    must(srv_address_same_host(a, (const struct sockaddr *)&again.storage));
    must(srv_address_is_loopback(a) ==
         srv_address_is_loopback((const struct sockaddr *)&again.storage));
}

static void check_origin(const char *value) {
    struct sp_error err;
    srv_cors_is_same_origin(value, "splat.example:8080");
    srv_cors_is_same_origin("https://splat.example", value);
    if (srv_cors_check_origins(value, &err) && !strchr(value, ','))
        must(srv_cors_allows(value, value));
}

static void check_etags(const char *value) {
    bool any = srv_header_has_etag(value, "\"0123456789abcdef\"");
    must(!any || strchr(value, '*') || strstr(value, "0123456789abcdef"));
}

static void check_token(const char *value, const char *token) {
    must(!srv_header_has_token(value, token) || strcasestr(value, token));
}

static void check_header(struct srv_smuggling *smuggling, const char *name, const char *value) {
    static const char *const types[] = { "image/jpeg", "image/png", "gzip", "application/json" };
    char accept[SRV_WEBSOCKET_ACCEPT_BYTES];
    srv_smuggling_add_header(smuggling, name, value);
    if (strcasecmp(name, "Accept") == 0 || strcasecmp(name, "Accept-Encoding") == 0)
        for (size_t i = 0; i < sizeof types / sizeof *types; i++) {
            double quality = srv_header_accept_quality(value, types[i]);
            must(quality >= 0 && quality <= 1);
        }
    const char *token =
        strcasecmp(name, "Authorization") == 0 ? srv_header_bearer_token(value) : NULL;
    must(!token || (token >= value + 7 && token <= value + strlen(value)));
    if (strcasecmp(name, "If-None-Match") == 0)
        check_etags(value);
    if (strcasecmp(name, "Origin") == 0)
        check_origin(value);
    if (strcasecmp(name, "Host") == 0)
        check_address(value);
    if (strcasecmp(name, "Content-Type") == 0)
        srv_header_is_json(value);
    if (strcasecmp(name, "Connection") == 0)
        check_token(value, "upgrade");
    if (strcasecmp(name, "Upgrade") == 0)
        check_token(value, "websocket");
    if (strcasecmp(name, "Sec-WebSocket-Protocol") == 0)
        check_token(value, "splatd.v1");
    if (strcasecmp(name, "Sec-WebSocket-Key") == 0 && strlen(value) == 24)
        must(!srv_header_websocket_accept(value, accept) ||
             strlen(accept) == SRV_WEBSOCKET_ACCEPT_BYTES - 1);
}

/* Checks "METHOD TARGET VERSION" and splits it in place. Returns the version. */
static const char *check_line(char *line) {
    char *target = line + strcspn(line, " ");
    if (*target)
        *target++ = 0;
    char *version = target + strcspn(target, " ");
    if (*version)
        *version++ = 0;
    size_t size = strlen(target);
    struct srv_rejection refusal = srv_smuggling_check_target(target, TARGET_MAX);
    must(!refusal.status == !refusal.detail);
    must(size <= TARGET_MAX || refusal.status == 414);
    target[strcspn(target, "?")] = 0;
    check_path(line, target);
    return version;
}

/* Returns the next line, whose end becomes a NUL; NULL at the end of the text. */
static char *next_line(char **at) {
    char *line = *at;
    if (!*line)
        return NULL;
    size_t length = strcspn(line, "\n");
    *at = line + length + (line[length] == '\n');
    line[length] = 0;
    if (length > 0 && line[length - 1] == '\r')
        line[length - 1] = 0;
    return line;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    char *text = malloc(size + 1), *at = text, *line;
    if (!text)
        return 0;
    memcpy(text, data, size);
    text[size] = 0; /* bytes after a NUL are ignored: the daemon refuses them by their gaps */
    while ((line = next_line(&at))) {
        struct srv_smuggling smuggling = { .hosts = 0 };
        const char *version = check_line(line);
        while ((line = next_line(&at)) && *line) {
            char *value = line + strcspn(line, ":");
            if (*value)
                *value++ = 0;
            check_header(&smuggling, line, value + strspn(value, " \t"));
        }
        struct srv_rejection refusal = srv_smuggling_check_headers(&smuggling, version);
        must(!refusal.status == !refusal.detail);
        must(refusal.status || (smuggling.hosts < 2 && smuggling.lengths < 2));
    }
    free(text);
    return 0;
}
