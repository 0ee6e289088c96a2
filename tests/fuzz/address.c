/* SPDX-License-Identifier: Apache-2.0
 *
 * An address and a list of hosts, on two lines. An address that is accepted has a simple form, and
 * an entry that is its own host and port allows it.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/address.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check(bool ok) {
    if (!ok)
        abort();
}

static void check_address(const char *address, const char *list) {
    static const char known[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-";
    struct sp_address parts;
    struct sp_error err = { .code = SP_OK };
    if (!sp_address_parse(address, &parts, &err)) {
        check(err.code == SP_ERR_INVALID);
        return;
    }
    char own[SP_HOST_BYTES + 8];
    const size_t length = strlen(parts.host);
    check(length > 0 && length < SP_HOST_BYTES && strspn(parts.host, known) == length);
    check(parts.port >= 1 && parts.port <= 65535);
    snprintf(own, sizeof own, "%s:%u", parts.host, parts.port);
    check(sp_address_allowed(&parts, own) == SP_ALLOWED_ANY);
    check(sp_address_allowed(&parts, "") == SP_NOT_ALLOWED);
    /* A list allows an address if one of its entries allows it. */
    enum sp_allowed best = SP_NOT_ALLOWED;
    for (const char *entry = list; *entry;) {
        const size_t bytes = strcspn(entry, ",");
        char *one = strndup(entry, bytes);
        const enum sp_allowed found = one ? sp_address_allowed(&parts, one) : SP_NOT_ALLOWED;
        best = found > best ? found : best;
        free(one);
        entry += bytes + (entry[bytes] == ',');
    }
    check(sp_address_allowed(&parts, list) == best);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    char *text = malloc(size + 1);
    struct sp_error err = { .code = SP_OK };
    if (!text)
        return 0;
    memcpy(text, data, size);
    text[size] = 0;
    char *end = strchr(text, '\n');
    const char *list = end ? end + 1 : "";
    if (end)
        *end = 0;
    check_address(text, list);
    check(sp_address_check_list(list, "list", &err) || err.code == SP_ERR_INVALID);
    if (size >= 4) { /* an IPv4 address, and the same as an IPv6 address */
        uint8_t mapped[16] = { [10] = 0xff, [11] = 0xff };
        memcpy(mapped + 12, data, 4);
        check(sp_address_is_private(data, 4) == sp_address_is_private(mapped, sizeof mapped));
    }
    free(text);
    return 0;
}
