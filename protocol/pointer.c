/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/pointer.h"

#include <stdio.h>
#include <string.h>

static void append(struct proto_pointer *pointer, const char *bytes, size_t size) {
    size_t capacity = sizeof pointer->text - 1 - pointer->length;
    if (size > capacity) {
        size = capacity;
        while (size > 0 && ((unsigned char)bytes[size] & 0xc0) == 0x80)
            size--; /* do not cut a character in half */
    }
    memcpy(pointer->text + pointer->length, bytes, size);
    pointer->length += size;
    pointer->text[pointer->length] = 0;
}

void proto_pointer_push(struct proto_pointer *pointer, const char *key, size_t key_bytes) {
    append(pointer, "/", 1);
    for (size_t i = 0; i < key_bytes;) {
        size_t plain = 0;
        while (i + plain < key_bytes && key[i + plain] != '~' && key[i + plain] != '/')
            plain++;
        append(pointer, key + i, plain);
        i += plain;
        if (i < key_bytes)
            append(pointer, key[i++] == '~' ? "~0" : "~1", 2);
    }
}

void proto_pointer_push_index(struct proto_pointer *pointer, size_t index) {
    char text[24];
    int n = snprintf(text, sizeof text, "/%zu", index);
    append(pointer, text, (size_t)n);
}

void proto_pointer_pop(struct proto_pointer *pointer, size_t old_length) {
    pointer->length = old_length;
    pointer->text[old_length] = 0;
}
