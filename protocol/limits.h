/* SPDX-License-Identifier: Apache-2.0
 *
 * Limits on what a client may send. sp/view.h has the limits of the fields of a view.
 */
#ifndef PROTO_LIMITS_H
#define PROTO_LIMITS_H

enum {
    PROTO_BODY_MAX = 1 << 20, /* bytes of one JSON document */
    PROTO_DEPTH_MAX = 32,     /* nested arrays and objects; a flat object has depth 1 */
    PROTO_RPC_ID_MAX = 256,   /* bytes of a string that is a JSON-RPC id */
    PROTO_RPC_METHOD_MAX = 64 /* bytes of a method name */
};

#endif
