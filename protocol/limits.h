/* SPDX-License-Identifier: Apache-2.0
 *
 * Limits on what a peer may send, written once. Those of the view itself are in sp/view.h.
 */
#ifndef PROTO_LIMITS_H
#define PROTO_LIMITS_H

enum {
    PROTO_BODY_MAX = 1 << 20, /* bytes of one JSON document */
    PROTO_DEPTH_MAX = 32,     /* nested arrays and objects; a plain object is 1 deep */
    PROTO_RPC_ID_MAX = 256,   /* bytes of a string used as a JSON-RPC id */
    PROTO_RPC_METHOD_MAX = 64 /* bytes of a method's name */
};

#endif
