/* SPDX-License-Identifier: Apache-2.0
 *
 * JSON-RPC 2.0, the text messages of a stream. A request has an id and gets an answer; a
 * notification has no id and gets none. The protocol has no batches.
 */
#ifndef PROTO_RPC_H
#define PROTO_RPC_H

#include <stdbool.h>
#include <stddef.h>

#include "protocol/json.h"
#include "sp/status.h"

enum proto_rpc_code {
    PROTO_RPC_PARSE = -32700,    /* not JSON */
    PROTO_RPC_REQUEST = -32600,  /* JSON, but not a request */
    PROTO_RPC_METHOD = -32601,   /* unknown method */
    PROTO_RPC_PARAMS = -32602,   /* wrong params for the method */
    PROTO_RPC_INTERNAL = -32603, /* out of memory */
    PROTO_RPC_VIEW =
        -32000, /* the patch gives an invalid view; data.pointer is relative to the patch */
    PROTO_RPC_UNSUPPORTED = -32001, /* a valid view that this daemon cannot render */
    PROTO_RPC_NOT_FOUND = -32002,   /* unknown volume or measurement */
    PROTO_RPC_NOT_READY = -32003,   /* the volume is still loading, or loading failed */
    PROTO_RPC_DENIED = -32004,      /* this token may only watch */
    PROTO_RPC_LIMIT = -32005,       /* over a limit of the daemon; try later or ask for less */
    PROTO_RPC_RENDER = -32006,      /* rendering or encoding failed; the next attempt may work */
    PROTO_RPC_HELD = -32007         /* another participant holds control */
};

struct proto_rpc_message {
    const char *method;       /* 1 to PROTO_RPC_METHOD_MAX bytes */
    bool has_id;              /* false = a notification */
    proto_json *id;           /* string or number for the answer; NULL = missing or unusable */
    const proto_json *params; /* an object; NULL = missing */
    proto_json *document;     /* owns the fields above */
};

/* Decodes one text message. On failure returns false: *code is the error code of the answer, *err
 * is filled, and message->id is set if the message has a usable one (else the answer has null).
 * Build the answer before proto_rpc_finish(). Call proto_rpc_finish() after success and failure. */
bool proto_rpc_decode(const char *bytes, size_t size, struct proto_rpc_message *message,
                      enum proto_rpc_code *code, struct sp_error *err);
void proto_rpc_finish(struct proto_rpc_message *message);

/* Return a text to send, NUL-terminated, to be freed by the caller; *size (may be NULL) excludes
 * the NUL. NULL when out of memory. The functions take ownership of `result` and `params`; either
 * may be NULL because building it failed, and then the function returns NULL. `id` is borrowed;
 * NULL writes null. */
char *proto_rpc_result(proto_json *id, proto_json *result, size_t *size);
char *proto_rpc_notification(const char *method, proto_json *params, size_t *size);
/* err->text becomes the message, err->place data.pointer. */
char *proto_rpc_error(proto_json *id, enum proto_rpc_code code, const struct sp_error *err,
                      size_t *size);

/* Returns the JSON-RPC code for an error of the renderer or the decoder. */
enum proto_rpc_code proto_rpc_code_from(enum sp_code code);

#endif
