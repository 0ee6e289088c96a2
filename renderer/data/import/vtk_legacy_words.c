/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/vtk_legacy_words.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <strings.h>

bool vtk_legacy_read_word(struct vtk_legacy *l, char word[IMPORT_WORD_MAX + 1]) {
    return import_text_word(&l->text, word, &l->byte, l->err);
}

bool vtk_legacy_count(struct vtk_legacy *l, const char *field, uint64_t limit, uint64_t *count) {
    char word[IMPORT_WORD_MAX + 1], *end;
    if (!vtk_legacy_read_word(l, word))
        return false;
    *count = strtoull(word, &end, 10);
    if (word[0] >= '0' && word[0] <= '9' && !*end && *count <= limit)
        return true;
    return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, field,
                             "\"%.40s\" is not a whole number up to %" PRIu64, word, limit);
}

bool vtk_legacy_type(struct vtk_legacy *l, const char *field, const struct vtk_type **type) {
    char word[IMPORT_WORD_MAX + 1];
    if (!vtk_legacy_read_word(l, word))
        return false;
    *type = vtk_find_type(word, false);
    return *type || VTK_LEGACY_REFUSE(l, SP_ERR_UNSUPPORTED, field,
                                      "values of type \"%.40s\" are not supported", word);
}

bool vtk_legacy_end_line(struct vtk_legacy *l) {
    char line[2];
    return l->words || import_text_line(&l->text, line, sizeof line, l->err);
}

struct vtk_array vtk_legacy_array(const struct vtk_legacy *l, const char *keyword, const char *name,
                                  const struct vtk_type *type) {
    struct vtk_array a = { .type = type,
                           .form = l->words ? VTK_WORDS : VTK_BYTES,
                           .big_endian = true,
                           .begin = l->text.at,
                           .end = l->file->size };
    snprintf(a.name, sizeof a.name, "%s %.60s", keyword, name);
    return a;
}

struct vtk_piece *vtk_legacy_piece(const struct vtk_legacy *l) {
    return &l->volume->pieces[0];
}

bool vtk_legacy_skip(struct vtk_legacy *l, const char *field, const struct vtk_type *type,
                     uint64_t count) {
    if (l->words)
        return import_text_skip(&l->text, count, field, l->err);
    const uint64_t left = l->text.end - l->text.at;
    if (count > left * (type->are_bits ? 8 : 1) || vtk_type_bytes(type, count) > left)
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, field,
                                 "%" PRIu64
                                 " values of %zu bytes do not fit into the rest of the file: it is "
                                 "cut off or a count is wrong",
                                 count, type->number.size);
    l->text.at += vtk_type_bytes(type, count);
    return true;
}

/* The length has 1, 2, 4 or 8 bytes; the two highest bits tell (3, 2, 1, 0). */
static bool skip_string(struct vtk_legacy *l) {
    const int first = import_text_peek(&l->text, l->err);
    if (first < 0)
        return false;
    const unsigned bytes = 1U << (3 - (first >> 6));
    uint64_t length = (unsigned)first & 63;
    l->text.at++;
    for (unsigned i = 1; i < bytes; i++) {
        const int next = import_text_peek(&l->text, l->err);
        if (next < 0)
            return false;
        length = length << 8 | (unsigned)next;
        l->text.at++;
    }
    if (length > l->text.end - l->text.at)
        return false;
    l->text.at += length;
    return true;
}

bool vtk_legacy_skip_strings(struct vtk_legacy *l, const char *field, uint64_t count) {
    char line[2];
    if (l->words && !import_text_line(&l->text, line, sizeof line, l->err)) /* of the name */
        return false;
    for (uint64_t i = 0; i < count; i++) {
        const bool is_there = l->text.at < l->text.end;
        if (is_there && l->words && !import_text_line(&l->text, line, sizeof line, l->err))
            return false;
        if (!is_there || (!l->words && !skip_string(l)))
            return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, field,
                                     "the file ends after %" PRIu64 " of %" PRIu64
                                     " texts: it is cut off or a count is wrong",
                                     i, count);
    }
    return true;
}

/* Where the cells of a keyword go; NULL = they are not drawn. */
static struct vtk_cells *cells_of(struct vtk_legacy *l, const char *keyword) {
    static const char *const kinds[VTK_CELL_KINDS] = { [VTK_VERTS] = "VERTICES",
                                                       [VTK_LINES] = "LINES",
                                                       [VTK_POLYS] = "POLYGONS",
                                                       [VTK_STRIPS] = "TRIANGLE_STRIPS" };
    for (int kind = 0; kind < VTK_CELL_KINDS; kind++)
        if (l->set == VTK_POLY && strcasecmp(keyword, kinds[kind]) == 0)
            return &vtk_legacy_piece(l)->cells[kind];
    return NULL;
}

/* COUNT and the number of integers, which are each cell's count and its points. Since version 5
 * these are the lengths of two arrays, OFFSETS and CONNECTIVITY, each with its type. */
bool vtk_legacy_cells(struct vtk_legacy *l, const char *keyword) {
    static const char *const arrays[] = { "OFFSETS", "CONNECTIVITY" };
    uint64_t counts[2];
    char word[IMPORT_WORD_MAX + 1];
    const struct vtk_type *type = vtk_find_type("int", false);
    struct vtk_cells *cells = cells_of(l, keyword), found = { .starts_at_0 = l->new_cells };
    if (cells && cells->at)
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "occurs twice");
    found.at = l->byte;
    if (!vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &counts[0]) ||
        !vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &counts[1]) || !vtk_legacy_end_line(l))
        return false;
    found.count = counts[0] - (l->new_cells && counts[0] > 0);
    found.points = vtk_legacy_array(l, keyword, "", type);
    found.points.count = counts[1];
    if (!l->new_cells && !vtk_legacy_skip(l, keyword, type, counts[1]))
        return false;
    for (int i = 0; l->new_cells && i < 2; i++) {
        struct vtk_array *array = i ? &found.points : &found.ends;
        if (!vtk_legacy_read_word(l, word))
            return false;
        if (strcasecmp(word, arrays[i]) != 0)
            return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "\"%.40s\" instead of %s", word,
                                     arrays[i]);
        if (!vtk_legacy_type(l, arrays[i], &type) || !vtk_legacy_end_line(l))
            return false;
        *array = vtk_legacy_array(l, keyword, arrays[i], type);
        array->count = counts[i];
        if (!vtk_legacy_skip(l, arrays[i], type, counts[i]))
            return false;
    }
    if (cells)
        *cells = found;
    else if (l->set == VTK_UNSTRUCTURED && counts[1] > found.count * (l->new_cells ? 1 : 2))
        vtk_warn_of_cells(l->volume, found.count);
    return true;
}
