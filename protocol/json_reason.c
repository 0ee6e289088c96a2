/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/json_reason.h"

#include <stdbool.h>
#include <stdio.h>
#include <string.h>

enum { QUOTED_MAX = 40 }; /* bytes of a token in a message */

struct token {
    const char *start;
    size_t size;
    char before; /* the last byte of the token before; 0 = none */
};

static bool is_space(char c) {
    return c == ' ' || c == '\t' || c == '\n' || c == '\r';
}

static bool is_digit(char c) {
    return c >= '0' && c <= '9';
}

/* Bytes of UTF-8 characters beyond ASCII count as letters. */
static bool is_word(char c) {
    return (unsigned char)c >= 0x80 || is_digit(c) || (c >= 'a' && c <= 'z') ||
           (c >= 'A' && c <= 'Z') || c == '_' || c == '+' || c == '-' || c == '.';
}

static size_t token_size(const char *text, size_t size) {
    size_t n = 1;
    if (*text == '"') {
        while (n < size && text[n] != '"')
            n += text[n] == '\\' && n + 1 < size ? 2 : 1;
        return n < size ? n + 1 : size;
    }
    while (is_word(*text) && n < size && is_word(text[n]))
        n++;
    return n;
}

/* The first token that ends at or behind `end`, or else the last one. */
static struct token read_token(const char *text, size_t size, size_t end) {
    struct token token = { .size = 0 };
    for (size_t at = 0; at < size && (!token.size || token.start + token.size < text + end);) {
        if (is_space(text[at])) {
            at++;
            continue;
        }
        char before = token.size ? token.start[token.size - 1] : 0;
        token = (struct token){ text + at, token_size(text + at, size - at), before };
        at += token.size;
    }
    return token;
}

/* The length of a number of RFC 8259 at the start of the text. */
static size_t number_size(const char *text, size_t size) {
    size_t n = size > 0 && *text == '-', digits = n;
    while (n < size && is_digit(text[n]))
        n++;
    if (n == digits || (text[digits] == '0' && n > digits + 1))
        return 0;
    if (n + 1 < size && text[n] == '.' && is_digit(text[n + 1]))
        for (n++; n < size && is_digit(text[n]);)
            n++;
    size_t exponent = n + 1;
    if (n < size && (text[n] | 0x20) == 'e') {
        exponent += exponent < size && (text[exponent] == '+' || text[exponent] == '-');
        for (digits = exponent; digits < size && is_digit(text[digits]);)
            digits++;
        n = digits > exponent ? digits : n;
    }
    return n;
}

static bool is_one_of(struct token token, const char *const *words) {
    for (; *words; words++)
        if (strlen(*words) == token.size && memcmp(token.start, *words, token.size) == 0)
            return true;
    return false;
}

/* True if the character is one of `set`. */
static bool is_in(const char *set, char c) {
    return c && strchr(set, c);
}

/* The bytes of an escape "\\u….", two surrogates included; 0 = it lacks digits, 6 with *is_half =
 * it is half of a pair. */
static size_t unicode_size(const char *escape, size_t size, bool *is_half) {
    static const char hex[] = "0123456789abcdefABCDEF";
    for (size_t i = 2; i < 6; i++)
        if (i >= size || !is_in(hex, escape[i]))
            return 0;
    bool is_surrogate = is_in("dD", escape[2]) && !is_in("01234567", escape[3]);
    bool is_high = is_surrogate && is_in("89abAB", escape[3]);
    bool is_pair = is_high && size >= 10 && escape[6] == '\\' && escape[7] == 'u' &&
                   is_in("dD", escape[8]) && is_in("cdefCDEF", escape[9]);
    *is_half = is_surrogate && !is_pair;
    return is_pair ? 12 : 6;
}

/* The reason in an escape that begins with '\\'; returns its length, and no text if it is sound. */
static size_t explain_escape(const char *escape, size_t size, char *text, size_t capacity) {
    bool is_half = false;
    size_t unicode = size > 1 && escape[1] == 'u' ? unicode_size(escape, size, &is_half) : 0;
    if (size < 2 || is_in("\"\\/bfnrt", escape[1]))
        return 2;
    if (escape[1] != 'u')
        snprintf(text, capacity, "a backslash begins no known escape; write \\\\ for a backslash");
    else if (!unicode)
        snprintf(text, capacity, "\\u needs four hexadecimal digits");
    else if (is_half)
        snprintf(text, capacity, "'%.6s' is half of a surrogate pair", escape);
    return unicode;
}

/* What is wrong inside of a string; no text = nothing. */
static void explain_string(struct token token, char *text, size_t capacity) {
    for (size_t i = 1; i < token.size && !*text;) {
        const char *c = token.start + i;
        if ((unsigned char)*c < 0x20)
            snprintf(text, capacity, "a string holds the control character 0x%02x; write \\u%04x",
                     (unsigned)*c, (unsigned)*c);
        i += *c == '\\' ? explain_escape(c, token.size - i, text, capacity) : 1;
    }
}

static void explain_word(struct token token, bool is_key, char *text, size_t capacity) {
    static const char *const no_numbers[] = { "NaN",       "nan",       "Infinity", "-Infinity",
                                              "+Infinity", "-infinity", "infinity", NULL };
    static const char *const words[] = { "true", "false", "null", NULL };
    int size = token.size < QUOTED_MAX ? (int)token.size : QUOTED_MAX;
    while (size > 0 && (size_t)size < token.size && (token.start[size] & 0xc0) == 0x80)
        size--; /* not inside of a character */
    if (token.size >= 3 && memcmp(token.start, "\xef\xbb\xbf", 3) == 0)
        snprintf(text, capacity, "the text begins with a byte order mark; remove it");
    else if (is_key)
        snprintf(text, capacity, "a key needs double quotes");
    else if (is_one_of(token, no_numbers))
        snprintf(text, capacity, "%.*s is no number of JSON", size, token.start);
    else if (is_one_of(token, words) || number_size(token.start, token.size) == token.size)
        snprintf(text, capacity, "%.*s does not belong here; a comma or a bracket is missing", size,
                 token.start);
    else if (is_digit(*token.start) || is_in("+-.", *token.start))
        snprintf(text, capacity, "%.*s is no number of JSON; write it like -1.5 or 2e3", size,
                 token.start);
    else
        snprintf(text, capacity, "'%.*s' is no value; a string needs double quotes", size,
                 token.start);
}

static void explain_sign(struct token token, const struct proto_nesting *top, char *text,
                         size_t capacity) {
    const char c = *token.start;
    const bool is_close = c == '}' || c == ']';
    if (c == '\'')
        snprintf(text, capacity, "a string needs double quotes");
    else if (c == '/' || c == '#')
        snprintf(text, capacity, "comments are not allowed");
    else if (is_close && token.before == ',')
        snprintf(text, capacity, "no comma may stand before '%c'", c);
    else if (is_close && top && (top->kind == '[') != (c == ']'))
        snprintf(text, capacity, "'%c' does not close the %s", c,
                 top->kind == '[' ? "array; ']' is missing" : "object; '}' is missing");
    else if ((unsigned char)c < 0x20 || c == 0x7f)
        snprintf(text, capacity, "the control character 0x%02x does not belong here", (unsigned)c);
    else
        snprintf(text, capacity, "'%c' does not belong here", c);
}

static void explain_syntax(const struct proto_position *position, size_t size, char *text,
                           size_t capacity) {
    const struct token token = read_token(position->bytes, size, position->at);
    const struct proto_nesting *top =
        position->depth ? &position->stack[position->depth - 1] : NULL;
    const bool is_key = top && top->kind == '{' && !top->in_value;
    if (token.size && *token.start == '"') {
        explain_string(token, text, capacity);
        if (!*text)
            snprintf(text, capacity,
                     "a string does not belong here; a comma or a colon is missing");
    } else if (token.size && is_word(*token.start)) {
        if (is_key && token.before == '"')
            snprintf(text, capacity, "a colon is missing behind the key");
        else
            explain_word(token, is_key, text, capacity);
    } else if (token.size) {
        explain_sign(token, top, text, capacity);
    } else {
        snprintf(text, capacity, "there is no value");
    }
}

static void explain_end(const struct proto_position *position, size_t size, char *text,
                        size_t capacity) {
    size_t blank = 0;
    while (blank < size && is_space(position->bytes[blank]))
        blank++;
    const char *open = position->in_string                                ? "a string"
                       : !position->depth                                 ? "a value"
                       : position->stack[position->depth - 1].kind == '[' ? "an array"
                                                                          : "an object";
    if (blank == size)
        snprintf(text, capacity, "the text is empty");
    else
        snprintf(text, capacity, "the text ends inside of %s", open);
}

void proto_json_reason(enum proto_json_fault fault, const struct proto_position *position,
                       size_t size, char text[PROTO_JSON_REASON_BYTES]) {
    const size_t capacity = PROTO_JSON_REASON_BYTES;
    *text = 0;
    switch (fault) {
    case PROTO_JSON_SYNTAX:
        explain_syntax(position, size, text, capacity);
        break;
    case PROTO_JSON_ENDS:
        explain_end(position, size, text, capacity);
        break;
    case PROTO_JSON_GOES_ON:
        snprintf(text, capacity, "more text follows the end of the document; send one document");
        break;
    case PROTO_JSON_NOT_UTF8:
        snprintf(text, capacity, "the byte 0x%02x is not UTF-8; save the text as UTF-8",
                 position->at < size ? (unsigned char)position->bytes[position->at] : 0u);
        break;
    case PROTO_JSON_NUL:
        snprintf(text, capacity, "the character \\u0000 is not allowed");
        break;
    case PROTO_JSON_TWICE:
        snprintf(text, capacity, "the object has a duplicate key; keep one of them");
        break;
    case PROTO_JSON_TOO_LARGE:
        snprintf(text, capacity, "the number is beyond 1.7e308, the limit of a double");
        break;
    }
}
