/* SPDX-License-Identifier: Apache-2.0 */
#include "cli/print.h"

#include <locale.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <wchar.h>

enum { LINE_WIDTH = 100, INDENT = 2 };

bool end_output(struct sp_error *err) {
    return (fflush(stdout) == 0 && !ferror(stdout)) ||
           sp_fail(err, SP_ERR_IO, "standard output", "cannot write");
}

static bool put_plain(const proto_json *json) {
    char *text = proto_json_to_text(json, NULL);
    if (text)
        fputs(text, stdout);
    free(text);
    return text != NULL;
}

static void put_indent(int depth) {
    printf("\n%*s", INDENT * depth, "");
}

static bool put_value(const proto_json *json, int depth, size_t column);

/* Prints "key": and returns its width; 0 when out of memory. */
static size_t put_key(const char *key) {
    proto_json *name = proto_json_new_string(key);
    char *text = proto_json_to_text(name, NULL);
    size_t width = text ? strlen(text) + 2 : 0;
    if (text)
        printf("%s: ", text);
    free(text);
    proto_json_free(&name);
    return width;
}

static bool put_members(const proto_json *json, int depth) {
    void *at = NULL;
    const char *key;
    const proto_json *value;
    bool ok = true;
    putchar('{');
    for (const char *comma = ""; ok && proto_json_next(json, &at, &key, &value); comma = ",") {
        fputs(comma, stdout);
        put_indent(depth + 1);
        size_t width = put_key(key);
        ok = width > 0 && put_value(value, depth + 1, (size_t)(INDENT * (depth + 1)) + width);
    }
    put_indent(depth);
    putchar('}');
    return ok;
}

static bool put_items(const proto_json *json, int depth) {
    bool ok = true;
    putchar('[');
    for (size_t i = 0; ok && i < proto_json_size(json); i++) {
        if (i)
            putchar(',');
        put_indent(depth + 1);
        ok = put_value(proto_json_at(json, i), depth + 1, (size_t)(INDENT * (depth + 1)));
    }
    put_indent(depth);
    putchar(']');
    return ok;
}

/* Prints the compact text with a space behind each comma and colon outside strings. */
static void put_line(const char *text) {
    bool is_quoted = false;
    for (const char *c = text; *c; c++) {
        putchar(*c);
        if (*c == '\\' && is_quoted && c[1])
            putchar(*++c);
        else if (*c == '"')
            is_quoted = !is_quoted;
        else if (!is_quoted && (*c == ',' || *c == ':'))
            putchar(' ');
    }
}

/* The document itself is never on one line, so that views of all sizes look alike. */
static bool put_value(const proto_json *json, int depth, size_t column) {
    enum proto_json_type type = proto_json_type(json);
    if ((type != PROTO_JSON_ARRAY && type != PROTO_JSON_OBJECT) || proto_json_size(json) == 0)
        return put_plain(json);
    size_t size = 0;
    char *text = proto_json_to_text(json, &size);
    if (!text)
        return false;
    size_t spaces = 0;
    for (const char *c = text; *c; c++)
        spaces += *c == ',' || *c == ':';
    bool fits = depth > 0 && column + size + spaces < LINE_WIDTH;
    if (fits)
        put_line(text);
    free(text);
    if (fits)
        return true;
    return type == PROTO_JSON_OBJECT ? put_members(json, depth) : put_items(json, depth);
}

bool print_indented(const proto_json *json, struct sp_error *err) {
    if (!put_value(json, 0, 0))
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
    putchar('\n');
    return end_output(err);
}

/* Replaces control characters of ASCII and C1, which a terminal would obey. */
static void clean(char *text) {
    for (unsigned char *c = (unsigned char *)text; *c; c++)
        if (*c < 0x20 || *c == 0x7f)
            *c = '?';
        else if (*c == 0xc2 && c[1] >= 0x80 && c[1] < 0xa0)
            c[0] = c[1] = '?';
}

void print_warning(const char *volume, const char *text) {
    char line[1024];
    snprintf(line, sizeof line, "%s: %s", volume, text);
    clean(line);
    fprintf(stderr, "splatctl: warning: %s\n", line);
}

void table_add(struct table *table, const char *format, ...) {
    va_list args;
    char *cell = NULL;
    if (table->count == table->capacity) {
        size_t capacity = table->capacity ? 2 * table->capacity : 64;
        char **grown = realloc(table->cells, capacity * sizeof *grown);
        if (!grown) {
            table->failed = true;
            return;
        }
        table->cells = grown;
        table->capacity = capacity;
    }
    va_start(args, format);
    if (vasprintf(&cell, format, args) < 0)
        table->failed = true;
    else
        clean(table->cells[table->count++] = cell);
    va_end(args);
}

/* Columns that the text takes on a terminal: wide letters take two, combining marks none. Bytes
 * that are not UTF-8 count as one each. */
static size_t width_of(const char *text) {
    mbstate_t state = { 0 };
    size_t width = 0;
    for (size_t left = strlen(text); left > 0;) {
        wchar_t letter;
        size_t n = mbrtowc(&letter, text, left, &state);
        if (n == (size_t)-1 || n == (size_t)-2 || n == 0) {
            state = (mbstate_t){ 0 };
            n = 1;
            width++;
        } else {
            int columns = wcwidth(letter);
            width += columns < 0 ? 1 : (size_t)columns;
        }
        text += n;
        left -= n;
    }
    return width;
}

static void print_row(const struct table *table, char **row, const size_t *widths) {
    for (size_t c = 0; c < table->columns; c++) {
        bool is_last = c + 1 == table->columns;
        int padding = (int)(widths[c] - width_of(row[c]));
        if (table->is_right[c])
            printf("%*s%s", padding, "", row[c]);
        else
            printf("%s%*s", row[c], is_last ? 0 : padding, "");
        fputs(is_last ? "\n" : "  ", stdout);
    }
}

bool table_print(struct table *table, struct sp_error *err) {
    /* The names are UTF-8 in every locale of the user. */
    if (!setlocale(LC_CTYPE, "C.UTF-8"))
        setlocale(LC_CTYPE, "");
    size_t widths[TABLE_COLUMNS_MAX] = { 0 };
    for (size_t i = 0; i < table->count; i++) {
        size_t width = width_of(table->cells[i]);
        if (width > widths[i % table->columns])
            widths[i % table->columns] = width;
    }
    for (size_t i = 0; !table->failed && i + table->columns <= table->count; i += table->columns)
        print_row(table, table->cells + i, widths);
    for (size_t i = 0; i < table->count; i++)
        free(table->cells[i]);
    free(table->cells);
    bool failed = table->failed;
    *table = (struct table){ 0 };
    return failed ? sp_fail(err, SP_ERR_MEMORY, "", "out of memory") : end_output(err);
}

bool print_list(const struct listing *listing, const proto_json *items, struct sp_error *err) {
    struct table table = { .columns = listing->columns };
    for (size_t c = 0; c < listing->columns; c++)
        table.is_right[c] = listing->right >> c & 1;
    for (size_t c = 0; c < listing->columns && listing->headings[c]; c++)
        table_add(&table, "%s", listing->headings[c]);
    for (size_t i = 0; i < proto_json_size(items); i++)
        listing->add(&table, proto_json_at(items, i));
    return table_print(&table, err);
}
