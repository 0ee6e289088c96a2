/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/rpc.h"

#include <math.h>
#include <string.h>

#include "protocol/limits.h"

/* Larger numbers may lose digits as doubles. */
#define ID_MAX 9007199254740992.0

static bool refuse(enum proto_rpc_code value, enum proto_rpc_code *code, struct sp_error *err,
                   const char *place, const char *text) {
    *code = value;
    return sp_fail(err, SP_ERR_INVALID, place, "%s", text);
}

static bool decode_id(struct proto_rpc_message *message, const proto_json *id) {
    enum proto_json_type type = proto_json_type(id);
    if (type != PROTO_JSON_NUMBER && type != PROTO_JSON_STRING)
        return type == PROTO_JSON_NONE;
    double number = 0;
    if (type == PROTO_JSON_STRING ? strlen(proto_json_string(id)) > PROTO_RPC_ID_MAX
                                  : !proto_json_number(id, &number) || fabs(number) > ID_MAX)
        return false;
    message->id = (proto_json *)id; /* the message owns the document */
    return true;
}

bool proto_rpc_decode(const char *bytes, size_t size, struct proto_rpc_message *message,
                      enum proto_rpc_code *code, struct sp_error *err) {
    *message = (struct proto_rpc_message){ 0 };
    struct sp_error why;
    proto_json *document = message->document = proto_json_parse(bytes, size, &why);
    if (!document) {
        *code = why.code == SP_ERR_MEMORY ? PROTO_RPC_INTERNAL : PROTO_RPC_PARSE;
        if (err)
            *err = why;
        return false;
    }
    if (proto_json_type(document) == PROTO_JSON_ARRAY)
        return refuse(PROTO_RPC_REQUEST, code, err, "",
                      "a batch is not supported; send each request as its own message");
    if (proto_json_type(document) != PROTO_JSON_OBJECT)
        return refuse(PROTO_RPC_REQUEST, code, err, "", "a message must be an object");
    const proto_json *id = proto_json_get(document, "id");
    message->has_id = id != NULL;
    if (!decode_id(message, id))
        return refuse(PROTO_RPC_REQUEST, code, err, "/id",
                      "\"id\" must be a number in [-2^53, 2^53] or a string of at most 256 bytes");
    const char *version = proto_json_string(proto_json_get(document, "jsonrpc"));
    if (!version || strcmp(version, "2.0") != 0)
        return refuse(PROTO_RPC_REQUEST, code, err, "/jsonrpc", "\"jsonrpc\" must be \"2.0\"");
    const char *method = proto_json_string(proto_json_get(document, "method"));
    if (!method || !*method || strlen(method) > PROTO_RPC_METHOD_MAX)
        return refuse(PROTO_RPC_REQUEST, code, err, "/method",
                      "\"method\" must be a string of 1 to 64 bytes");
    const proto_json *params = proto_json_get(document, "params");
    if (params && proto_json_type(params) != PROTO_JSON_OBJECT)
        return refuse(PROTO_RPC_PARAMS, code, err, "/params", "\"params\" must be an object");
    message->method = method;
    message->params = params;
    return true;
}

void proto_rpc_finish(struct proto_rpc_message *message) {
    proto_json_free(&message->document);
    *message = (struct proto_rpc_message){ 0 };
}

/* Takes ownership of `value`. */
static char *write_message(const char *key, proto_json *value, bool with_id, proto_json *id,
                           const char *method, size_t *size) {
    proto_json *message = proto_json_object();
    proto_json_set_string(&message, "jsonrpc", "2.0");
    if (with_id)
        proto_json_set(&message, "id", id ? proto_json_ref(id) : proto_json_new_null());
    if (method)
        proto_json_set_string(&message, "method", method);
    proto_json_set(&message, key, value);
    char *text = proto_json_to_text(message, size);
    proto_json_free(&message);
    return text;
}

char *proto_rpc_result(proto_json *id, proto_json *result, size_t *size) {
    return write_message("result", result, true, id, NULL, size);
}

char *proto_rpc_notification(const char *method, proto_json *params, size_t *size) {
    return write_message("params", params, false, NULL, method, size);
}

char *proto_rpc_error(proto_json *id, enum proto_rpc_code code, const struct sp_error *err,
                      size_t *size) {
    proto_json *error = proto_json_object();
    proto_json_set_integer(&error, "code", code);
    proto_json_set_string(&error, "message", err->text);
    if (err->place[0]) {
        proto_json *data = proto_json_object();
        proto_json_set_string(&data, "pointer", err->place);
        proto_json_set(&error, "data", data);
    }
    return write_message("error", error, true, id, NULL, size);
}

enum proto_rpc_code proto_rpc_code_from(enum sp_code code) {
    switch (code) {
    case SP_ERR_INVALID:
        return PROTO_RPC_VIEW;
    case SP_ERR_UNSUPPORTED:
        return PROTO_RPC_UNSUPPORTED;
    case SP_ERR_NOT_FOUND:
    case SP_ERR_VOLUME_UNKNOWN:
        return PROTO_RPC_NOT_FOUND;
    case SP_ERR_NOT_READY:
    case SP_ERR_VOLUME_FAILED:
        return PROTO_RPC_NOT_READY;
    case SP_ERR_FORMAT:
        return PROTO_RPC_PARSE;
    case SP_ERR_DENIED:
        return PROTO_RPC_DENIED;
    case SP_ERR_BUDGET:
    case SP_ERR_FRAME_BUDGET:
    case SP_ERR_QUOTA:
    case SP_ERR_TOO_LARGE:
        return PROTO_RPC_LIMIT;
    case SP_ERR_MEMORY:
        return PROTO_RPC_INTERNAL;
    case SP_OK:
    case SP_ERR_IO:
    case SP_ERR_TIMEOUT:
    case SP_ERR_CRASHED:
    case SP_ERR_CANCELLED:
    case SP_ERR_BACKEND:
        break;
    }
    return PROTO_RPC_RENDER;
}
