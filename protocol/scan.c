/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/scan.h"

#include <stdint.h>
#include <string.h>

#include "protocol/limits.h"
#include "protocol/pointer.h"

struct level {
    char kind;       /* '[' or '{' */
    bool in_value;   /* of an object: past the colon of the current key */
    uint32_t index;  /* of an array: element that is being read */
    const char *key; /* of an object: the current key's text between its quotes; NULL = none */
    size_t key_bytes;
};

/* Past the closing quote, or `size` if there is none. i is the first byte after the opening one. */
static size_t skip_string(const char *bytes, size_t i, size_t size) {
    while (i < size && bytes[i] != '"')
        i += bytes[i] == '\\' ? 2 : 1;
    return i < size ? i + 1 : size;
}

static unsigned hex_value(const char *digits) {
    unsigned value = 0;
    for (int i = 0; i < 4; i++) {
        unsigned c = (unsigned char)digits[i];
        value = value << 4 | (c <= '9' ? c - '0' : (c | 0x20u) - 'a' + 10u) % 16;
    }
    return value;
}

/* One token of the pointer: a key without its escapes. Half a surrogate pair becomes '?'. */
static void push_key(struct proto_pointer *pointer, const char *key, size_t size) {
    static const char from[] = "bfnrt", to[] = "\b\f\n\r\t";
    char plain[SP_ERROR_PLACE];
    size_t n = 0;
    for (size_t i = 0; i < size && n + 4 < sizeof plain; i++) {
        if (key[i] != '\\' || i + 1 >= size) {
            plain[n++] = key[i];
            continue;
        }
        const char *known = memchr(from, key[++i], sizeof from - 1);
        unsigned c = known ? (unsigned char)to[known - from] : (unsigned char)key[i];
        if (key[i] == 'u' && i + 4 < size) {
            c = hex_value(key + i + 1);
            i += 4;
        }
        if (c < 0x80 || (c >= 0xd800 && c < 0xe000)) {
            plain[n++] = c && c < 0x80 ? (char)c : '?';
        } else if (c < 0x800) {
            plain[n++] = (char)(0xc0 | c >> 6);
            plain[n++] = (char)(0x80 | (c & 0x3f));
        } else {
            plain[n++] = (char)(0xe0 | c >> 12);
            plain[n++] = (char)(0x80 | (c >> 6 & 0x3f));
            plain[n++] = (char)(0x80 | (c & 0x3f));
        }
    }
    proto_pointer_push(pointer, plain, n);
}

static void write_pointer(const struct level *levels, unsigned depth, char *out, size_t capacity) {
    struct proto_pointer pointer = { .text = { 0 } };
    for (unsigned d = 0; d < depth; d++)
        if (levels[d].kind == '[')
            proto_pointer_push_index(&pointer, levels[d].index);
        else if (levels[d].key)
            push_key(&pointer, levels[d].key, levels[d].key_bytes);
    size_t i = 0;
    for (; i + 1 < capacity && pointer.text[i]; i++)
        out[i] = pointer.text[i];
    out[i] = 0;
}

bool proto_scan(const char *bytes, size_t *size, char *pointer, size_t capacity) {
    struct level levels[PROTO_DEPTH_MAX];
    unsigned depth = 0;
    bool fits = true;
    for (size_t i = 0; i < *size;) {
        struct level *top = depth ? &levels[depth - 1] : NULL;
        char c = bytes[i];
        if (c == '"') {
            size_t end = skip_string(bytes, i + 1, *size);
            if (top && top->kind == '{' && !top->in_value) {
                top->key = bytes + i + 1;
                top->key_bytes = end - i - 1 - (bytes[end - 1] == '"' && end > i + 1);
            }
            i = end;
            continue;
        }
        if (c == '[' || c == '{') {
            if (depth == PROTO_DEPTH_MAX) {
                *size = i;
                fits = false;
                break;
            }
            levels[depth++] = (struct level){ .kind = c };
        } else if ((c == ']' && top && top->kind == '[') || (c == '}' && top && top->kind == '{')) {
            depth--;
        } else if (c == ':' && top && top->kind == '{') {
            top->in_value = true;
        } else if (c == ',' && top) {
            top->in_value = false;
            top->key = NULL;
            top->index++;
        }
        i++;
    }
    write_pointer(levels, depth, pointer, capacity);
    return fits;
}
