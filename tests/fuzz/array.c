/* SPDX-License-Identifier: Apache-2.0
 *
 * The message that comes with an array in shared memory: any bytes are refused with a reason, are
 * the beginning of a message, or are a message that encodes to the same bytes. Other bytes are also
 * read as the JSON that describes the array.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/array.h"
#include "sp/shared_memory.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void must(bool ok) {
    if (!ok)
        abort();
}

static void read_description(const uint8_t *data, size_t size) {
    struct sp_volume_info info;
    struct sp_error err;
    proto_json *json = proto_json_parse((const char *)data, size, &err);
    if (json && proto_array_decode(json, &info, &err)) {
        const uint32_t *dims = info.grid.dims;
        sp_volume_map_check(&info, UINT64_C(64), &err);
        must(dims[0] >= 1 && dims[1] >= 1 && dims[2] >= 1 && info.type < SP_TYPE_COUNT);
    } else if (json) {
        must(err.code == SP_ERR_INVALID && err.place[0] == '/' && err.text[0]);
    }
    proto_json_free(&json);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct proto_array_hello hello;
    struct sp_error err;
    uint8_t again[PROTO_ARRAY_HELLO_MAX];
    size_t whole = size;
    if (size == 0 || !proto_array_is_hello(data[0])) {
        read_description(data, size);
    } else if (proto_array_hello_decode(data, &whole, &hello, &err)) {
        must(whole == size && hello.bytes > 0);
        must(proto_array_hello_encode(&hello, again) == size && memcmp(again, data, size) == 0);
    } else {
        must(err.text[0] &&
             (err.code == SP_ERR_INVALID ||
              (err.code == SP_ERR_NOT_READY && size < whole && whole <= PROTO_ARRAY_HELLO_MAX)));
    }
    return 0;
}
