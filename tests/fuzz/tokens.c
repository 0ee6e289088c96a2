/* SPDX-License-Identifier: Apache-2.0
 *
 * Token file: any text is refused with its line, or every token in it has a right, a name and
 * quotas within their limits, and no token or name occurs twice.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "config/token_file.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check(const struct srv_token *list, size_t i) {
    const struct srv_token *token = &list[i];
    size_t length = strlen(token->text), name = strlen(token->name);
    bool ok = length >= 16 && length < SRV_TOKEN_BYTES && name >= 1 &&
              name < SRV_TOKEN_NAME_BYTES && token->rights && token->rights < 32 &&
              token->quota.fps <= 120 && token->quota.frame_px <= UINT64_C(8192) * 8192;
    for (size_t j = 0; j < i; j++)
        ok = ok && strcmp(list[j].text, token->text) != 0 && strcmp(list[j].name, token->name) != 0;
    if (!ok)
        abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct srv_token *list;
    struct sp_error err;
    size_t count;
    if (srv_token_file_parse((const char *)data, size, &list, &count, &err)) {
        for (size_t i = 0; i < count; i++)
            check(list, i);
        if (count == 0)
            abort();
        free(list);
    } else if (err.code == SP_ERR_INVALID && strncmp(err.place, "line ", 5) != 0) {
        abort();
    }
    return 0;
}
