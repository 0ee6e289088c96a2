/* SPDX-License-Identifier: Apache-2.0
 *
 * Text for people: indented JSON and tables whose columns line up in any script. Both print to
 * standard output, warnings to standard error.
 */
#ifndef CLI_PRINT_H
#define CLI_PRINT_H

#include "protocol/json.h"

/* Prints the document with an indent of two spaces. An array or object that fits into a line stays
 * on that line, so that points and vectors read as one item. */
bool print_indented(const proto_json *json, struct sp_error *err);

/* Prints a warning about a volume to standard error, such as a difference from its file. Control
 * characters become "?". */
void print_warning(const char *volume, const char *text);

enum { TABLE_COLUMNS_MAX = 12 };

struct table {
    size_t columns;
    bool is_right[TABLE_COLUMNS_MAX]; /* aligned to the right; the default is left */
    char **cells;                     /* rows of `columns` cells, owned */
    size_t count, capacity;           /* cells */
    bool failed;                      /* out of memory */
};

/* Adds one cell, row by row; the first row is the heading. Control characters become "?", because
 * names come from files and other people. */
__attribute__((format(printf, 2, 3))) void table_add(struct table *table, const char *format, ...);
/* A list of the daemon and its columns. */
struct listing {
    const char *name;
    const char *headings[TABLE_COLUMNS_MAX]; /* {NULL} = one column without a heading */
    size_t columns;
    unsigned right; /* bit c: column c is aligned to the right */
    void (*add)(struct table *table, const proto_json *item);
};
bool print_list(const struct listing *listing, const proto_json *items, struct sp_error *err);
/* Flushes standard output. */
bool end_output(struct sp_error *err);
/* Prints all rows, with two spaces between the columns, and frees the cells. */
bool table_print(struct table *table, struct sp_error *err);

#endif
