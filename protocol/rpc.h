/* SPDX-License-Identifier: Apache-2.0
 *
 * JSON-RPC 2.0, the text messages of a stream. A request has an id and is answered; a notification
 * has none and never is. Batches are not part of the protocol.
 */
#ifndef PROTO_RPC_H
#define PROTO_RPC_H

#include <stdbool.h>
#include <stddef.h>

#include "protocol/json.h"
#include "sp/status.h"

enum proto_rpc_code {
    PROTO_RPC_PARSE = -32700,       /* not JSON */
    PROTO_RPC_REQUEST = -32600,     /* JSON, but no request */
    PROTO_RPC_METHOD = -32601,      /* no such method */
    PROTO_RPC_PARAMS = -32602,      /* the method does not take these params */
    PROTO_RPC_INTERNAL = -32603,    /* out of memory and the like */
    PROTO_RPC_VIEW = -32000,        /* an invalid view; data.pointer is relative to the patch */
    PROTO_RPC_UNSUPPORTED = -32001, /* a valid view that this daemon cannot draw */
    PROTO_RPC_NOT_FOUND = -32002,   /* no such volume */
    PROTO_RPC_NOT_READY = -32003,   /* the volume is still loading, or failed to */
    PROTO_RPC_DENIED = -32004,      /* this token may watch, not change */
    PROTO_RPC_LIMIT = -32005,       /* over a limit of the daemon; try later or ask for less */
    PROTO_RPC_RENDER = -32006,      /* rendering or encoding failed; the next try may work */
    PROTO_RPC_HELD = -32007         /* another participant holds control */
};

struct proto_rpc_message {
    const char *method; /* of 1 to PROTO_RPC_METHOD_MAX bytes */
    bool has_id;        /* false = a notification */
    proto_json *id; /* a string or number to be echoed; NULL if there is none or it is unusable */
    const proto_json *params; /* an object, or NULL if there is none */
    proto_json *document;     /* owns the above */
};

/* Decodes one text message. On failure returns false with *code set to the error to answer with,
 * *err filled, and message->id set if it could be read (answer null otherwise): the answer can be
 * built before proto_rpc_finish(). Call proto_rpc_finish() in both cases. */
bool proto_rpc_decode(const char *bytes, size_t size, struct proto_rpc_message *message,
                      enum proto_rpc_code *code, struct sp_error *err);
void proto_rpc_finish(struct proto_rpc_message *message);

/* Texts to send: malloc'ed, NUL-terminated, *size (may be NULL) without the NUL; NULL when out of
 * memory. `result` and `params` are stolen, and may be NULL (= building them failed): NULL. `id` is
 * borrowed; NULL writes null. */
char *proto_rpc_result(proto_json *id, proto_json *result, size_t *size);
char *proto_rpc_notification(const char *method, proto_json *params, size_t *size);
/* The error's text is the message; a place becomes data.pointer. */
char *proto_rpc_error(proto_json *id, enum proto_rpc_code code, const struct sp_error *err,
                      size_t *size);

/* The code that tells a client of a renderer's or decoder's error. */
enum proto_rpc_code proto_rpc_code_from(enum sp_code code);

#endif
