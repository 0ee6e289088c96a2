/* SPDX-License-Identifier: Apache-2.0
 *
 * Finds the handler of a path and method in the table of routes (routes.c).
 */
#ifndef SRV_HTTP_ROUTER_H
#define SRV_HTTP_ROUTER_H

#include <stdbool.h>
#include <stddef.h>

#include "config/token_file.h"

enum srv_method {
    SRV_GET = 1,
    SRV_POST = 2,
    SRV_PUT = 4,
    SRV_PATCH = 8,
    SRV_DELETE = 16,
    SRV_OPTIONS = 32
};
enum { SRV_PARAM_BYTES = 160, SRV_QUERY_NAMES = 13 };

struct srv_request;
struct srv_reply;

struct srv_route {
    enum srv_method method;
    const char *pattern;  /* "{}" matches one segment that is not empty */
    enum srv_right needs; /* checked before the body is read */
    /* Fills *reply, or suspends the request (request.h). */
    void (*handle)(struct srv_request *request, struct srv_reply *reply);
    /* Names of the query parameters besides "token", which every route takes; NULL after the last
     * one. A request with another one is refused with 400. */
    const char *query[SRV_QUERY_NAMES + 1];
};

/* Returns the bit of the method; HEAD counts as GET; 0 = unknown. */
unsigned srv_method_bit(const char *name);

/* Returns the route, or NULL. Then *allowed is the set of methods of that path; 0 = no such path.
 */
const struct srv_route *srv_route_find(const struct srv_route *routes, size_t count,
                                       const char *method, const char *path,
                                       char param[SRV_PARAM_BYTES], unsigned *allowed);

/* True if the route takes a query parameter of this name. */
bool srv_route_accepts(const struct srv_route *route, const char *name);

/* Writes "GET, HEAD, POST", as in an Allow header. */
void srv_methods_to_text(unsigned methods, char text[64]);

#endif
