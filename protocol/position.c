/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/position.h"

#include <string.h>

static unsigned hex_value(const char *digits) {
    unsigned value = 0;
    for (int i = 0; i < 4; i++) {
        unsigned c = (unsigned char)digits[i];
        value = value << 4 | (c <= '9' ? c - '0' : (c | 0x20u) - 'a' + 10u) % 16;
    }
    return value;
}

/* Appends a key without its escapes as one token. Half a surrogate pair becomes '?'. */
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

static void walk_string(struct proto_position *position, char c) {
    struct proto_nesting *top = position->depth ? &position->stack[position->depth - 1] : NULL;
    if (position->is_escaped)
        position->is_escaped = false;
    else if (c == '\\')
        position->is_escaped = true;
    else if (c == '"')
        position->in_string = false;
    if (position->is_key && position->in_string)
        top->key_bytes++;
}

static void begin_string(struct proto_position *position, struct proto_nesting *top) {
    position->in_string = true;
    position->is_key = top && top->kind == '{' && !top->in_value;
    if (position->is_key) {
        top->key = position->bytes + position->at + 1;
        top->key_bytes = 0;
    }
}

/* A byte outside a string. False: one bracket too many. */
static bool walk_token(struct proto_position *position, char c) {
    struct proto_nesting *top = position->depth ? &position->stack[position->depth - 1] : NULL;
    if (c == '"') {
        begin_string(position, top);
    } else if (c == '[' || c == '{') {
        if (position->depth == PROTO_DEPTH_MAX)
            return false;
        position->stack[position->depth++] = (struct proto_nesting){ .kind = c };
    } else if (top && c == (top->kind == '[' ? ']' : '}')) {
        position->depth--;
    } else if (top && c == ':' && top->kind == '{') {
        top->in_value = true;
    } else if (top && c == ',') {
        top->in_value = false;
        top->key = NULL;
        top->index++;
    }
    return true;
}

bool proto_position_advance(struct proto_position *position, size_t end) {
    for (; position->at < end && !position->is_too_deep; position->at++) {
        char c = position->bytes[position->at];
        if (position->in_string) {
            walk_string(position, c);
        } else if (!walk_token(position, c)) {
            position->is_too_deep = true;
            break;
        }
    }
    return !position->is_too_deep;
}

void proto_position_pointer(const struct proto_position *position, struct proto_pointer *pointer) {
    *pointer = (struct proto_pointer){ .length = 0 };
    for (unsigned d = 0; d < position->depth; d++) {
        const struct proto_nesting *nesting = &position->stack[d];
        if (nesting->kind == '[')
            proto_pointer_push_index(pointer, nesting->index);
        else if (nesting->key)
            push_key(pointer, nesting->key, nesting->key_bytes);
    }
}

void proto_position_line(const struct proto_position *position, unsigned *line, unsigned *column) {
    *line = *column = 1;
    for (size_t i = 0; i < position->at; i++)
        if (position->bytes[i] == '\n') {
            ++*line;
            *column = 1;
        } else if (((unsigned char)position->bytes[i] & 0xc0) != 0x80) {
            ++*column;
        }
}
