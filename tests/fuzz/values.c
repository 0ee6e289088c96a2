/* SPDX-License-Identifier: Apache-2.0
 *
 * A query value or Range header: it is refused, or the decoded value equals the text.
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "http/headers.h"
#include "http/slice_query.h"
#include "sp/encode.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void must(bool holds) {
    if (!holds)
        abort();
}

/* Skips leading zeros. */
static const char *shortest(const char *text) {
    return text + strspn(text, "0");
}

static void check_number(const char *text) {
    static const unsigned most[] = { 1, 100, 1000, UINT32_MAX };
    const char *rest = shortest(text);
    size_t length = strlen(rest);
    bool is_valid = length > 0 && strspn(rest, "0123456789") == length &&
                    (length < 10 || (length == 10 && strcmp(rest, "4294967295") <= 0));
    for (int i = 0; i < 4; i++) {
        unsigned number = 0;
        bool ok = srv_query_number(text, most[i], &number);
        must(ok == (is_valid && strtoull(rest, NULL, 10) <= most[i]));
        must(!ok || number == strtoull(rest, NULL, 10));
    }
}

/* True if the text is this number, followed by `end`. */
static bool is_number(const char *text, unsigned number, char end) {
    char written[16];
    int length = number ? snprintf(written, sizeof written, "%u", number) : 0;
    const char *rest = shortest(text);
    return memcmp(rest, written, strnlen(rest, (size_t)length)) == 0 && rest[length] == end;
}

static void check_size(const char *text) {
    uint32_t px[2];
    if (!srv_query_size(text, px))
        return;
    must(is_number(text, px[0], ',') && is_number(strchr(text, ',') + 1, px[1], 0));
}

static void check_numbers(const char *text) {
    for (unsigned count = 1; count <= 3; count++) {
        double numbers[3], again[3];
        char written[128];
        if (!srv_query_numbers(text, count, numbers))
            continue;
        int length = 0;
        for (unsigned i = 0; i < count; i++) {
            must(isfinite(numbers[i]));
            length += snprintf(written + length, sizeof written - (size_t)length, "%s%.17g",
                               i ? "," : "", numbers[i]);
        }
        must(srv_query_numbers(written, count, again));
        must(memcmp(numbers, again, count * sizeof *numbers) == 0);
    }
}

static const char *get_text(void *user, const char *name) {
    /* The text is a query: NAME=VALUE, one per line. */
    const char *at = user;
    static char value[200];
    size_t length = strlen(name);
    for (; at; at = strchr(at, '\n') ? strchr(at, '\n') + 1 : NULL)
        if (strncmp(at, name, length) == 0 && at[length] == '=') {
            size_t size = strcspn(at + length + 1, "\n");
            size = size < sizeof value - 1 ? size : sizeof value - 1;
            memcpy(value, at + length + 1, size);
            value[size] = 0;
            return value;
        }
    return NULL;
}

/* A query of a slice: refused with a reason, or a slice that lies where it may. */
static void check_slice(char *text) {
    const struct sp_volume_info info = { .type = SP_UINT8,
                                         .grid = { .dims = { 5, 3000, 1 },
                                                   .spacing = { 1, 0.5, 2 },
                                                   .direction = {
                                                       { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } } };
    struct srv_slice_query query;
    struct sp_slice slice;
    struct sp_error err;
    if (!srv_slice_query_read(&query, get_text, text, &err) ||
        !srv_slice_query_resolve(&query, &info, &slice, &err)) {
        must((err.code == SP_ERR_FORMAT || err.code == SP_ERR_INVALID) && *err.place && *err.text);
        return;
    }
    for (int i = 0; i < 2; i++)
        must(slice.size[i] >= 1 && slice.size[i] <= SP_SLICE_SIDE_MAX);
}

static void check_range(const char *text, uint64_t size) {
    char again[64];
    uint64_t from, count, more[2];
    enum srv_range range = srv_header_range(text, NULL, "\"e\"", size, &from, &count);
    if (range != SRV_RANGE_PARTIAL) {
        must(from == 0 && count == size);
        must(range == SRV_RANGE_WHOLE || strchr(text, '-'));
        return;
    }
    must(count > 0 && from < size && count <= size - from);
    must(srv_header_range(text, "\"e\"", "\"e\"", size, &more[0], &more[1]) == range);
    must(more[0] == from && more[1] == count);
    must(srv_header_range(text, "\"f\"", "\"e\"", size, &more[0], &more[1]) == SRV_RANGE_WHOLE);
    snprintf(again, sizeof again, "bytes=%llu-%llu", (unsigned long long)from,
             (unsigned long long)(from + count - 1));
    must(srv_header_range(again, NULL, "", size, &more[0], &more[1]) == range);
    must(more[0] == from && more[1] == count);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    char *text = malloc(size + 1);
    if (!text)
        return 0;
    memcpy(text, data, size);
    text[size] = 0;
    check_number(text);
    check_size(text);
    check_numbers(text);
    check_slice(text);
    check_range(text, 0);
    check_range(text, 1);
    check_range(text, 1000);
    check_range(text, (uint64_t)1 << 62);
    enum sp_image_format format = sp_image_format_find(text);
    must(format == SP_IMAGE_FORMAT_COUNT || *sp_image_format_info(format)->mime);
    must(sp_chroma_find(text) <= SP_CHROMA_COUNT);
    free(text);
    return 0;
}
