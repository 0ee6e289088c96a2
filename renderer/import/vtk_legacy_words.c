/* SPDX-License-Identifier: Apache-2.0 */
#include "import/vtk_legacy_words.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <strings.h>

bool vtk_legacy_refuse(const struct vtk_legacy *l, enum sp_code code, const char *field,
                       const char *format, ...) {
    char text[SP_ERROR_TEXT];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    return import_fail(l->err, code, l->file->shown, l->byte, field, "%s", text);
}

bool vtk_legacy_word(struct vtk_legacy *l, char word[IMPORT_WORD_MAX + 1]) {
    return import_text_word(&l->text, word, &l->byte, l->err);
}

bool vtk_legacy_count(struct vtk_legacy *l, const char *field, uint64_t limit, uint64_t *count) {
    char word[IMPORT_WORD_MAX + 1], *end;
    if (!vtk_legacy_word(l, word))
        return false;
    *count = strtoull(word, &end, 10);
    if (word[0] >= '0' && word[0] <= '9' && !*end && *count <= limit)
        return true;
    return vtk_legacy_refuse(l, SP_ERR_FORMAT, field,
                             "\"%.40s\" is not a whole number up to %" PRIu64, word, limit);
}

bool vtk_legacy_type(struct vtk_legacy *l, const char *field, const struct vtk_type **type) {
    char word[IMPORT_WORD_MAX + 1];
    if (!vtk_legacy_word(l, word))
        return false;
    *type = vtk_find_type(word, false);
    return *type || vtk_legacy_refuse(l, SP_ERR_UNSUPPORTED, field,
                                      "values of type \"%.40s\" are not supported", word);
}

bool vtk_legacy_end_line(struct vtk_legacy *l) {
    char line[2];
    return l->words || import_text_line(&l->text, line, sizeof line, l->err);
}

struct vtk_array vtk_legacy_array(const struct vtk_legacy *l, const char *keyword, const char *name,
                                  const struct vtk_type *type, uint64_t count) {
    struct vtk_array a = { .type = type,
                           .count = count,
                           .form = l->words ? VTK_WORDS : VTK_BYTES,
                           .big_endian = true,
                           .begin = l->text.at,
                           .end = l->file->size };
    snprintf(a.name, sizeof a.name, "%s %.60s", keyword, name);
    return a;
}

bool vtk_legacy_skip(struct vtk_legacy *l, const char *field, uint64_t count, size_t size) {
    if (l->words)
        return import_text_skip(&l->text, count, field, l->err);
    uint64_t left = l->text.end - l->text.at;
    if (count > left / size)
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, field,
                                 "%" PRIu64
                                 " values of %zu bytes do not fit into the rest of the file: it is "
                                 "cut off or a count is wrong",
                                 count, size);
    l->text.at += count * size;
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
            return &l->volume->mesh.cells[kind];
    return NULL;
}

/* COUNT and the number of integers, which are each cell's count and its points. Since version 5
 * these are the lengths of two arrays, OFFSETS and CONNECTIVITY, each with its type. */
bool vtk_legacy_cells(struct vtk_legacy *l, const char *keyword) {
    static const char *const arrays[] = { "OFFSETS", "CONNECTIVITY" };
    uint64_t counts[2];
    char word[IMPORT_WORD_MAX + 1];
    struct vtk_cells *cells = cells_of(l, keyword), found = { .starts_at_0 = l->new_cells };
    if (cells && cells->at)
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "occurs twice");
    found.at = l->byte;
    if (!vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &counts[0]) ||
        !vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &counts[1]) || !vtk_legacy_end_line(l))
        return false;
    found.count = counts[0] - (l->new_cells && counts[0] > 0);
    found.points = vtk_legacy_array(l, keyword, "", vtk_find_type("int", false), counts[1]);
    if (!l->new_cells && !vtk_legacy_skip(l, keyword, counts[1], 4))
        return false;
    for (int i = 0; l->new_cells && i < 2; i++) {
        const struct vtk_type *type;
        if (!vtk_legacy_word(l, word))
            return false;
        if (strcasecmp(word, arrays[i]) != 0)
            return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "\"%.40s\" instead of %s", word,
                                     arrays[i]);
        if (!vtk_legacy_type(l, arrays[i], &type) || !vtk_legacy_end_line(l))
            return false;
        *(i ? &found.points : &found.ends) =
            vtk_legacy_array(l, keyword, arrays[i], type, counts[i]);
        if (!vtk_legacy_skip(l, arrays[i], counts[i], type->number.size))
            return false;
    }
    if (cells)
        *cells = found;
    else if (l->set == VTK_UNSTRUCTURED && counts[1] > found.count * (l->new_cells ? 1 : 2))
        vtk_warn_of_cells(l->file, found.count);
    return true;
}
