/* SPDX-License-Identifier: Apache-2.0
 *
 * Bytes → JSON-RPC message → answer. Every answer must be valid JSON.
 */
#include <stdint.h>
#include <stdlib.h>

#include "protocol/rpc.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct proto_rpc_message message;
    enum proto_rpc_code code = PROTO_RPC_INTERNAL;
    struct sp_error err = { 0 };
    bool ok = proto_rpc_decode((const char *)data, size, &message, &code, &err);
    size_t answer_size;
    char *answer = ok ? proto_rpc_result(message.id, proto_json_object(), &answer_size)
                      : proto_rpc_error(message.id, code, &err, &answer_size);
    proto_json *json = answer ? proto_json_parse(answer, answer_size, &err) : NULL;
    if (!json)
        abort();
    proto_json_free(&json);
    free(answer);
    proto_rpc_finish(&message);
    return 0;
}
