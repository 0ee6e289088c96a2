/* SPDX-License-Identifier: Apache-2.0
 *
 * Why this parser is our own: parsers.md.
 */
#include "data/import/ply.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/number.h"
#include "data/import/text.h"

#define COUNT_MAX (UINT64_C(1) << 40) /* rows */

enum { LINE_MAX_BYTES = 1024, LINES_MAX = 1 << 16 };

struct header { /* state while it is read */
    struct ply *ply;
    struct import_text text;
    struct sp_error *err;
    uint64_t byte; /* of the line */
    bool has_form;
};

static const struct import_number_entry types[] = {
    { "char", 0, { IMPORT_SIGNED, 1 } },     { "int8", 0, { IMPORT_SIGNED, 1 } },
    { "uchar", 0, { IMPORT_UNSIGNED, 1 } },  { "uint8", 0, { IMPORT_UNSIGNED, 1 } },
    { "short", 0, { IMPORT_SIGNED, 2 } },    { "int16", 0, { IMPORT_SIGNED, 2 } },
    { "ushort", 0, { IMPORT_UNSIGNED, 2 } }, { "uint16", 0, { IMPORT_UNSIGNED, 2 } },
    { "int", 0, { IMPORT_SIGNED, 4 } },      { "int32", 0, { IMPORT_SIGNED, 4 } },
    { "uint", 0, { IMPORT_UNSIGNED, 4 } },   { "uint32", 0, { IMPORT_UNSIGNED, 4 } },
    { "int64", 0, { IMPORT_SIGNED, 8 } },    { "uint64", 0, { IMPORT_UNSIGNED, 8 } },
    { "float", 0, { IMPORT_FLOAT, 4 } },     { "float32", 0, { IMPORT_FLOAT, 4 } },
    { "double", 0, { IMPORT_FLOAT, 8 } },    { "float64", 0, { IMPORT_FLOAT, 8 } },
};

static bool refuse(const struct header *h, enum sp_code code, const char *field, const char *text,
                   const char *word) {
    return import_fail(h->err, code, h->ply->file->title, h->byte, field, text, word ? word : "");
}

static bool find_type(const struct header *h, const char *name, struct import_number *number) {
    return (name && import_number_by_name(types, sizeof types / sizeof *types, name, strlen(name),
                                          number)) ||
           refuse(h, SP_ERR_FORMAT, "property", "\"%.40s\" is not a type of numbers", name);
}

static bool copy_name(const struct header *h, const char *field, const char *word,
                      char name[PLY_NAME_BYTES]) {
    if (!word || strlen(word) >= PLY_NAME_BYTES)
        return refuse(h, SP_ERR_FORMAT, field, "\"%.80s\" is not a name of 1 to 63 bytes", word);
    strcpy(name, word);
    return true;
}

static bool parse_form(struct header *h, const char *form) {
    static const char *const forms[] = { [PLY_WORDS] = "ascii",
                                         [PLY_LITTLE] = "binary_little_endian",
                                         [PLY_BIG] = "binary_big_endian" };
    for (unsigned i = 0; form && i < sizeof forms / sizeof *forms; i++)
        if (strcmp(form, forms[i]) == 0) {
            h->ply->form = (enum ply_form)i;
            h->has_form = true;
            return true;
        }
    return refuse(h, SP_ERR_UNSUPPORTED, "format",
                  "is \"%.40s\"; it must be ascii, binary_little_endian or binary_big_endian",
                  form);
}

static bool parse_element(struct header *h, const char *name, const char *count) {
    struct ply *ply = h->ply;
    if (ply->element_count == PLY_ELEMENTS_MAX)
        return refuse(h, SP_ERR_UNSUPPORTED, "element", "more than 16 elements", NULL);
    struct ply_element *e = &ply->elements[ply->element_count];
    *e = (struct ply_element){ .first = ply->property_count };
    if (!copy_name(h, "element", name, e->name))
        return false;
    char *end = NULL;
    e->count = count ? strtoull(count, &end, 10) : 0;
    if (!count || count[0] < '0' || count[0] > '9' || *end || e->count > COUNT_MAX)
        return refuse(h, SP_ERR_FORMAT, e->name, "\"%.40s\" is not a number of rows", count);
    if (ply_find(ply, e->name))
        return refuse(h, SP_ERR_FORMAT, e->name, "occurs twice", NULL);
    ply->element_count++;
    return true;
}

static bool parse_property(struct header *h, char **rest) {
    struct ply *ply = h->ply;
    struct ply_element *e = ply->element_count ? &ply->elements[ply->element_count - 1] : NULL;
    if (!e)
        return refuse(h, SP_ERR_FORMAT, "property", "comes before the first element", NULL);
    if (ply->property_count == PLY_PROPERTIES_MAX)
        return refuse(h, SP_ERR_UNSUPPORTED, "property", "more than 512 properties", NULL);
    struct ply_property *p = &ply->properties[ply->property_count];
    *p = (struct ply_property){ .name = "" };
    const char *type = strtok_r(NULL, " \t", rest);
    bool is_list = type && strcmp(type, "list") == 0;
    if (is_list && (!find_type(h, strtok_r(NULL, " \t", rest), &p->length) ||
                    (p->length.kind == IMPORT_FLOAT &&
                     !refuse(h, SP_ERR_FORMAT, "property", "the length of a list is a float", 0))))
        return false;
    if (!find_type(h, is_list ? strtok_r(NULL, " \t", rest) : type, &p->number) ||
        !copy_name(h, "property", strtok_r(NULL, " \t", rest), p->name))
        return false;
    for (unsigned i = 0; i < e->properties; i++)
        if (strcmp(ply->properties[e->first + i].name, p->name) == 0)
            return refuse(h, SP_ERR_FORMAT, p->name, "occurs twice in an element", NULL);
    e->has_lists |= is_list;
    e->least += ply->form == PLY_WORDS ? 1 : is_list ? p->length.size : p->number.size;
    e->properties++;
    ply->property_count++;
    return true;
}

/* Reads one line; *ended if it is the last one of the header. */
static bool parse_line(struct header *h, bool *ended) {
    char line[LINE_MAX_BYTES], *rest = NULL;
    h->byte = h->text.at;
    if (h->text.at >= h->text.end)
        return refuse(h, SP_ERR_FORMAT, "end_header", "is missing at the end of the file", NULL);
    if (!import_text_line(&h->text, line, sizeof line, h->err))
        return false;
    const char *word = strtok_r(line, " \t", &rest);
    if (!word || strcmp(word, "comment") == 0 || strcmp(word, "obj_info") == 0)
        return true;
    *ended = strcmp(word, "end_header") == 0;
    if (*ended)
        return true;
    if (strcmp(word, "format") == 0)
        return h->ply->element_count == 0 ? parse_form(h, strtok_r(NULL, " \t", &rest))
                                          : refuse(h, SP_ERR_FORMAT, "format", "comes late", NULL);
    if (!h->has_form)
        return refuse(h, SP_ERR_FORMAT, "format", "must be the second line", NULL);
    if (strcmp(word, "element") == 0) {
        const char *name = strtok_r(NULL, " \t", &rest);
        return parse_element(h, name, strtok_r(NULL, " \t", &rest));
    }
    if (strcmp(word, "property") == 0)
        return parse_property(h, &rest);
    return refuse(h, SP_ERR_FORMAT, NULL, "\"%.40s\" is not a keyword of a PLY header", word);
}

static bool check_size(const struct ply *ply, struct sp_error *err) {
    uint64_t have = ply->file->size - ply->begin, need = 0;
    for (unsigned i = 0; i < ply->element_count; i++) {
        const struct ply_element *e = &ply->elements[i];
        /* A word needs one byte and one byte before the next word, but for the last one. */
        need += e->count * e->least * (ply->form == PLY_WORDS ? 2 : 1);
        if (need > have + (ply->form == PLY_WORDS))
            return import_fail(err, SP_ERR_FORMAT, ply->file->title, ply->begin, e->name,
                               "%" PRIu64 " rows need at least %" PRIu64
                               " bytes, the file has %" PRIu64
                               ": it is cut off or a count is wrong",
                               e->count, need, have);
    }
    return true;
}

bool ply_parse(struct ply *ply, const struct import_file *file, struct sp_error *err) {
    struct header *h = malloc(sizeof *h);
    if (!h)
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for the header");
    *ply = (struct ply){ .file = file };
    h->ply = ply;
    h->err = err;
    h->byte = 0;
    h->has_form = false;
    import_text_init(&h->text, file, 0, file->size);
    char magic[8];
    bool ended = false, ok = import_text_line(&h->text, magic, sizeof magic, err);
    if (ok && strcmp(magic, "ply") != 0)
        ok = refuse(h, SP_ERR_FORMAT, NULL, "a PLY file starts with the line ply", NULL);
    for (int lines = 0; ok && !ended; lines++)
        ok = lines < LINES_MAX ? parse_line(h, &ended)
                               : refuse(h, SP_ERR_FORMAT, NULL,
                                        "the header has more than 65536 lines, the limit", NULL);
    ply->begin = h->text.at;
    free(h);
    return ok && check_size(ply, err);
}

const struct ply_element *ply_find(const struct ply *ply, const char *element) {
    for (unsigned i = 0; i < ply->element_count; i++)
        if (strcmp(ply->elements[i].name, element) == 0)
            return &ply->elements[i];
    return NULL;
}

int ply_column(const struct ply *ply, const struct ply_element *element, const char *property) {
    for (unsigned i = 0; element && i < element->properties; i++) {
        const struct ply_property *p = &ply->properties[element->first + i];
        if (!p->length.size && strcmp(p->name, property) == 0)
            return (int)i;
    }
    return -1;
}

bool ply_columns(const struct ply *ply, const struct ply_element *element,
                 const char *const *properties, unsigned count, int *columns,
                 struct sp_error *err) {
    for (unsigned i = 0; i < count; i++) {
        columns[i] = ply_column(ply, element, properties[i]);
        if (columns[i] < 0)
            return import_fail(err, SP_ERR_FORMAT, ply->file->title, ply->begin, element->name,
                               "the property %s is missing", properties[i]);
    }
    return true;
}

bool ply_check_count(const struct ply *ply, const struct ply_element *element,
                     struct sp_error *err) {
    return element->count <= SP_ELEMENTS_MAX ||
           import_fail(err, SP_ERR_UNSUPPORTED, ply->file->title, ply->begin, element->name,
                       "%" PRIu64 " rows are more than the %d that a volume may have",
                       element->count, SP_ELEMENTS_MAX);
}
