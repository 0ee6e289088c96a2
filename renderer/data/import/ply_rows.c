/* SPDX-License-Identifier: Apache-2.0
 *
 * The rows of one element of a PLY file, as numbers.
 *
 * Why this parser is our own: parsers.md.
 */
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "data/import/ply.h"
#include "data/import/samples.h"
#include "data/import/text.h"

enum { BUFFER = 1 << 18 }; /* bytes */

struct ply_rows {
    const struct ply *ply;
    const struct ply_element *element;
    int list;
    uint64_t row;  /* of the element that is being read */
    uint64_t at;   /* bytes: offset of the first byte in the buffer that is not used */
    double *items; /* PLY_LIST_MAX; NULL = no list is kept */
    size_t begin, end;
    struct import_text text; /* words */
    uint8_t buffer[BUFFER];
    double values[PLY_PROPERTIES_MAX];
};

static bool cut_off(const struct ply_rows *r, const char *property, struct sp_error *err) {
    return import_fail(err, SP_ERR_FORMAT, r->ply->file->title, r->at, property,
                       "the file ends in row %" PRIu64 " of the %" PRIu64 " rows of %s", r->row,
                       r->element->count, r->element->name);
}

/* Returns the next n ≤ 8 bytes; NULL with *err set if there are fewer. */
static const uint8_t *next_bytes(struct ply_rows *r, size_t n, const char *property,
                                 struct sp_error *err) {
    while (r->end - r->begin < n) {
        memmove(r->buffer, r->buffer + r->begin, r->end - r->begin);
        r->end -= r->begin;
        r->begin = 0;
        size_t got;
        if (!import_read(r->ply->file, r->buffer + r->end, BUFFER - r->end, r->at + r->end, &got,
                         err) ||
            (got == 0 && !cut_off(r, property, err)))
            return NULL;
        r->end += got;
    }
    const uint8_t *bytes = r->buffer + r->begin;
    r->begin += n;
    r->at += n;
    return bytes;
}

static bool read_bytes(struct ply_rows *r, struct import_number number, const char *property,
                       double *value, struct sp_error *err) {
    const uint8_t *bytes = next_bytes(r, number.size, property, err);
    if (!bytes)
        return false;
    bool is_big = r->ply->form == PLY_BIG;
    uint8_t turned[8];
    for (size_t i = 0; is_big && i < number.size; i++)
        turned[i] = bytes[number.size - 1 - i];
    *value = import_widen(is_big ? turned : bytes, number);
    return true;
}

static bool read_word(struct ply_rows *r, const char *property, double *value,
                      struct sp_error *err) {
    char word[IMPORT_WORD_MAX + 1], *end;
    if (!import_text_word(&r->text, word, &r->at, err))
        return false;
    if (!word[0])
        return cut_off(r, property, err);
    *value = strtod(word, &end);
    return !*end || import_fail(err, SP_ERR_FORMAT, r->ply->file->title, r->at, property,
                                "\"%.40s\" is not a number", word);
}

static bool read_number(struct ply_rows *r, struct import_number number, const char *property,
                        double *value, struct sp_error *err) {
    return r->ply->form == PLY_WORDS ? read_word(r, property, value, err)
                                     : read_bytes(r, number, property, value, err);
}

/* Reads the items of a list after its length, into `items` unless it is NULL. */
static bool read_items(struct ply_rows *r, const struct ply_property *p, double length,
                       double *items, struct sp_error *err) {
    uint64_t at = r->at, left = r->ply->file->size - (at < r->ply->file->size ? at : 0);
    if (!(length >= 0) || length > (double)left || length != (double)(uint64_t)length)
        return import_fail(err, SP_ERR_FORMAT, r->ply->file->title, at, p->name,
                           "a list of %g items does not fit into the rest of the file", length);
    if (items && length > PLY_LIST_MAX)
        return import_fail(err, SP_ERR_UNSUPPORTED, r->ply->file->title, at, p->name,
                           "a list of %g items is longer than %d", length, PLY_LIST_MAX);
    for (uint64_t i = 0, n = (uint64_t)length; i < n; i++) {
        double value;
        if (!read_number(r, p->number, p->name, items ? &items[i] : &value, err))
            return false;
    }
    return true;
}

/* Reads the next row of any element. */
static bool read_row(struct ply_rows *r, const struct ply_element *e, double *items,
                     struct sp_error *err) {
    for (unsigned i = 0; i < e->properties; i++) {
        const struct ply_property *p = &r->ply->properties[e->first + i];
        bool is_list = p->length.size > 0;
        if (!read_number(r, is_list ? p->length : p->number, p->name, &r->values[i], err) ||
            (is_list && !read_items(r, p, r->values[i], (int)i == r->list ? items : NULL, err)))
            return false;
    }
    r->row++;
    return true;
}

static bool skip(struct ply_rows *r, const struct ply_element *e, struct sp_error *err) {
    r->element = e;
    r->row = 0;
    if (!e->has_lists && r->ply->form == PLY_WORDS)
        return import_text_skip(&r->text, e->count * e->properties, e->name, err);
    if (!e->has_lists) { /* ply_parse() has compared the sizes */
        r->at += e->count * e->least;
        r->begin = r->end = 0;
        return true;
    }
    for (uint64_t i = 0; i < e->count; i++)
        if (!read_row(r, e, NULL, err))
            return false;
    return true;
}

struct ply_rows *ply_rows_open(const struct ply *ply, const struct ply_element *element, int list,
                               struct sp_error *err) {
    struct ply_rows *r = malloc(sizeof *r);
    double *items = r && list >= 0 ? malloc(PLY_LIST_MAX * sizeof *items) : NULL;
    if (!r || (list >= 0 && !items)) {
        free(r);
        sp_fail(err, SP_ERR_MEMORY, ply->file->title, "out of memory for the rows");
        return NULL;
    }
    r->ply = ply;
    r->list = list;
    r->at = ply->begin;
    r->items = items;
    r->begin = r->end = 0;
    import_text_init(&r->text, ply->file, ply->begin, ply->file->size);
    for (const struct ply_element *e = ply->elements; e < element; e++)
        if (!skip(r, e, err)) {
            ply_rows_close(r);
            return NULL;
        }
    r->element = element;
    r->row = 0;
    return r;
}

const double *ply_rows_next(struct ply_rows *rows, struct sp_error *err) {
    return read_row(rows, rows->element, rows->items, err) ? rows->values : NULL;
}

const double *ply_rows_items(const struct ply_rows *rows) {
    return rows->items;
}

/* Something may follow the last rows of the file: more of them than the header declares. */
static void warn_of_rest(struct ply_rows *r) {
    const struct ply *ply = r->ply;
    const struct ply_element *e = r->element;
    char word[IMPORT_WORD_MAX + 1] = "";
    bool is_end = r->row == e->count;
    for (const struct ply_element *o = e + 1; o < ply->elements + ply->element_count; o++)
        is_end &= o->count == 0;
    if (is_end &&
        (ply->form == PLY_WORDS ? !import_text_word(&r->text, word, &r->at, NULL) || word[0]
                                : r->at < ply->file->size))
        import_warn(ply->file->warnings,
                    "The file goes on after row %" PRIu64
                    " of \"%s\", the last one that its header declares; the rest is not read.",
                    e->count, e->name);
}

void ply_rows_close(struct ply_rows *rows) {
    if (rows) {
        warn_of_rest(rows);
        free(rows->items);
    }
    free(rows);
}
