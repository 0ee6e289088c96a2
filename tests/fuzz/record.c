/* SPDX-License-Identifier: Apache-2.0
 *
 * Bytes → the check of a record of a saved view or a preset. A refused one has a reason. The first
 * byte chooses the kind.
 */
#include <stdint.h>
#include <stdlib.h>

#include "render/record_check.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct sp_error err = { .code = SP_OK };
    if (size == 0)
        return 0;
    const enum srv_kind kind = data[0] == 'p' ? SRV_KIND_PRESET : SRV_KIND_VIEW;
    if (!srv_record_check(kind, (const char *)data + 1, size - 1, &err) &&
        ((err.code != SP_ERR_FORMAT && err.code != SP_ERR_INVALID && err.code != SP_ERR_MEMORY) ||
         !err.text[0]))
        abort();
    return 0;
}
