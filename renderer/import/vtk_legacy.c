/* SPDX-License-Identifier: Apache-2.0
 *
 * Legacy VTK files: five lines of text, then keywords. Each keyword is followed by its numbers,
 * as words or as big-endian bytes. Arrays are skipped by their size; read() returns to those of the
 * volume.
 */
#include <ctype.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "import/vtk_legacy_words.h"

enum { COMPONENTS_MAX = 1 << 16 };

static bool probe(const uint8_t *start, size_t size, const char *shown) {
    static const char magic[] = "# vtk DataFile";
    size_t n = strlen(shown);
    if (size >= sizeof magic - 1 && strncasecmp((const char *)start, magic, sizeof magic - 1) == 0)
        return true;
    return n > 4 && strcasecmp(shown + n - 4, ".vtk") == 0 && start[0] != '<';
}

/* Reads the next keyword or array name. VTK may write METADATA after any array; it ends with an
 * empty line, says nothing about samples, and is skipped. */
static bool next_keyword(struct vtk_legacy *l, char word[IMPORT_WORD_MAX + 1]) {
    for (;;) {
        if (!vtk_legacy_word(l, word))
            return false;
        if (strcasecmp(word, "METADATA") != 0)
            return true;
        char line[8];
        if (!import_text_line(&l->text, line, sizeof line, l->err))
            return false;
        do
            if (!import_text_line(&l->text, line, sizeof line, l->err))
                return false;
        while (line[strspn(line, " \t")] && l->text.at < l->text.end);
    }
}

/* The structure. */

static bool take_dataset(struct vtk_legacy *l, const char *keyword) {
    static const struct {
        const char *name;
        enum vtk_set set;
    } sets[] = { { "STRUCTURED_POINTS", VTK_IMAGE },
                 { "RECTILINEAR_GRID", VTK_RECTILINEAR },
                 { "STRUCTURED_GRID", VTK_STRUCTURED },
                 { "UNSTRUCTURED_GRID", VTK_UNSTRUCTURED },
                 { "POLYDATA", VTK_POLY } };
    char kind[IMPORT_WORD_MAX + 1];
    if (l->set)
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "occurs twice");
    if (!vtk_legacy_word(l, kind))
        return false;
    for (size_t i = 0; i < sizeof sets / sizeof *sets; i++)
        if (strcasecmp(kind, sets[i].name) == 0)
            l->set = sets[i].set;
    return l->set ||
           vtk_legacy_refuse(l, SP_ERR_UNSUPPORTED, keyword,
                             "data set %.40s is not supported; supported are STRUCTURED_POINTS, "
                             "RECTILINEAR_GRID, STRUCTURED_GRID, UNSTRUCTURED_GRID and POLYDATA",
                             kind);
}

static bool take_dimensions(struct vtk_legacy *l, const char *keyword) {
    if (l->set > VTK_STRUCTURED)
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "do not belong to this data set");
    if (l->grid_at)
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "occur twice");
    l->grid_at = l->byte;
    l->points = 1;
    for (int axis = 0; axis < 3; axis++) {
        uint64_t n;
        if (!vtk_legacy_count(l, keyword, SP_DIM_MAX, &n))
            return false;
        l->header->grid.dims[axis] = (uint32_t)n;
        l->points *= n;
    }
    return l->points > 0 || vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "the grid is empty");
}

static bool take_triple(struct vtk_legacy *l, const char *keyword, double out[3]) {
    if (l->set != VTK_IMAGE)
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "belongs to STRUCTURED_POINTS only");
    for (int axis = 0; axis < 3; axis++) {
        char word[IMPORT_WORD_MAX + 1], *end;
        if (!vtk_legacy_word(l, word))
            return false;
        out[axis] = strtod(word, &end);
        if (end == word || *end)
            return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "\"%.40s\" is not a number", word);
    }
    return true;
}

static bool take_origin(struct vtk_legacy *l, const char *keyword) {
    return take_triple(l, keyword, l->header->grid.origin);
}

static bool take_spacing(struct vtk_legacy *l, const char *keyword) {
    return take_triple(l, keyword, l->header->grid.spacing);
}

static bool take_coordinates(struct vtk_legacy *l, const char *keyword) {
    int axis = (keyword[0] & ~0x20) - 'X';
    uint64_t count;
    const struct vtk_type *type;
    if (!l->grid_at || l->set != VTK_RECTILINEAR)
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword,
                                 "must follow the DIMENSIONS of a "
                                 "RECTILINEAR_GRID");
    if (l->volume->positions[axis])
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "occurs twice");
    if (!vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &count))
        return false;
    if (count != l->header->grid.dims[axis])
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword,
                                 "%" PRIu64 " coordinates for the %" PRIu32
                                 " samples of DIMENSIONS",
                                 count, l->header->grid.dims[axis]);
    if (!vtk_legacy_type(l, keyword, &type) || !vtk_legacy_end_line(l))
        return false;
    struct vtk_array a = vtk_legacy_array(l, keyword, type->legacy, type, count);
    l->volume->positions[axis] =
        vtk_array_check(l->file, &a, l->err) ? vtk_array_read_numbers(l->file, &a, l->err) : NULL;
    return l->volume->positions[axis] && vtk_legacy_skip(l, keyword, count, type->number.size);
}

/* The positions of points. */
static bool take_positions(struct vtk_legacy *l, const char *keyword) {
    uint64_t count, byte = l->byte;
    const struct vtk_type *type;
    if (!vtk_has_points(l->set))
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "do not belong to this data set");
    if (l->volume->points.type)
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "occurs twice");
    if (l->set == VTK_STRUCTURED && !l->grid_at)
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "comes before DIMENSIONS");
    if (!vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &count))
        return false;
    if (l->set == VTK_STRUCTURED && count != l->points)
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword,
                                 "%" PRIu64 " points, but DIMENSIONS give %" PRIu64, count,
                                 l->points);
    if (!vtk_legacy_type(l, keyword, &type) || !vtk_legacy_end_line(l))
        return false;
    if (l->set != VTK_STRUCTURED)
        l->grid_at = byte;
    l->points = count;
    l->volume->points = vtk_legacy_array(l, keyword, type->legacy, type, 3 * count);
    return vtk_legacy_skip(l, keyword, 3 * count, type->number.size);
}

static bool skip_cell_types(struct vtk_legacy *l, const char *keyword) {
    uint64_t count;
    return vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &count) && vtk_legacy_end_line(l) &&
           vtk_legacy_skip(l, keyword, count, 4);
}

/* The attributes. */

static bool begin_section(struct vtk_legacy *l, const char *keyword, int section) {
    l->section = section;
    if (!l->grid_at)
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "comes before %s",
                                 l->set > VTK_STRUCTURED ? "POINTS" : "DIMENSIONS");
    if (!vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &l->tuples))
        return false;
    return l->points <= SP_VOXELS_MAX ||
           import_fail(l->err, SP_ERR_FORMAT, l->file->shown, l->grid_at, "DIMENSIONS",
                       "more than %" PRIu64 " voxels", SP_VOXELS_MAX);
}

static bool take_points(struct vtk_legacy *l, const char *keyword) {
    if (!begin_section(l, keyword, POINTS))
        return false;
    return l->tuples == l->points ||
           vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "%" PRIu64 " points, but %s give %" PRIu64,
                             l->tuples, l->set > VTK_STRUCTURED ? "POINTS" : "DIMENSIONS",
                             l->points);
}

static bool take_cells(struct vtk_legacy *l, const char *keyword) {
    vtk_list(l->others, "cell data");
    l->volume->mesh.has_cell_data = true;
    return begin_section(l, keyword, CELLS);
}

static bool check_section(const struct vtk_legacy *l, const char *keyword) {
    return l->section != NOWHERE ||
           vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "comes before POINT_DATA and CELL_DATA");
}

static void list_other(struct vtk_legacy *l, const char *keyword, const char *name) {
    char text[96];
    snprintf(text, sizeof text, "%s %.60s", keyword, name);
    if (l->section == POINTS)
        vtk_list(l->others, text);
}

/* Copies the name of an array. VTK writes odd characters as %XX. */
static void take_name(char out[SP_FIELD_BYTES], const char *name) {
    char plain[IMPORT_WORD_MAX + 1];
    size_t n = 0;
    for (const char *c = name; *c && n < IMPORT_WORD_MAX; n++) {
        char digits[3] = { c[0] == '%' ? c[1] : 0, c[0] == '%' && c[1] ? c[2] : 0 }, *end;
        long code = strtol(digits, &end, 16);
        bool is_code = isxdigit((unsigned char)digits[0]) && end == digits + 2;
        plain[n] = is_code ? (char)code : *c;
        c += is_code ? 3 : 1;
    }
    plain[n] = 0;
    import_name(out, plain);
}

/* Takes the array of points that begins here as samples or vectors, unless there is one that is not
 * worse. */
static void take_samples(struct vtk_legacy *l, const char *keyword, const char *name,
                         const struct vtk_type *type) {
    const char *wanted = l->volume->file->field;
    char own[SP_FIELD_BYTES];
    take_name(own, name);
    bool is_best = *wanted ? strcmp(own, wanted) == 0 : strcasecmp(keyword, "SCALARS") == 0;
    if (l->volume->samples.type && (!is_best || l->has_scalars)) {
        import_header_add_other(l->header, own);
        return;
    }
    import_header_add_other(l->header, l->header->value_name);
    l->has_scalars = is_best;
    l->volume->samples = vtk_legacy_array(l, keyword, name, type, l->points);
    memcpy(l->header->value_name, own, sizeof own);
}

static void take_vectors(struct vtk_legacy *l, const char *keyword, const char *name,
                         const struct vtk_type *type) {
    char own[SP_FIELD_BYTES];
    take_name(own, name);
    unsigned rank = vtk_rank_vectors(l->file, own, strcasecmp(keyword, "VECTORS") == 0);
    const char *other = rank > l->vector_rank ? l->header->vector_name : own;
    import_header_add_other_vectors(l->header, other);
    if (other == own)
        return;
    l->vector_rank = rank;
    l->volume->vectors = vtk_legacy_array(l, keyword, name, type, 3 * l->points);
    memcpy(l->header->vector_name, own, sizeof own);
}

/* Takes the first array of points that has colours. */
static void take_colors(struct vtk_legacy *l, const char *keyword, const char *name,
                        const struct vtk_type *type, uint64_t components) {
    struct vtk_mesh *mesh = &l->volume->mesh;
    if (l->section != POINTS || mesh->colors.type || (components != 3 && components != 4))
        return;
    mesh->colors = vtk_legacy_array(l, keyword, name, type, components * l->points);
    mesh->color_components = (unsigned)components;
}

static bool take_scalars(struct vtk_legacy *l, const char *keyword) {
    char line[512], name[256] = "", kind[64] = "", word[IMPORT_WORD_MAX + 1];
    int components = 1;
    if (!check_section(l, keyword) || !import_text_line(&l->text, line, sizeof line, l->err))
        return false;
    sscanf(line, "%255s %63s %d", name, kind, &components);
    const struct vtk_type *type = vtk_find_type(kind, false);
    if (!type)
        return vtk_legacy_refuse(l, SP_ERR_UNSUPPORTED, keyword,
                                 "values of type \"%s\" are not supported", kind);
    if (components < 1 || components > 4)
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword, "%d components, outside [1, 4]",
                                 components);
    if (!vtk_legacy_word(l, word))
        return false;
    if (strcasecmp(word, "LOOKUP_TABLE") != 0)
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword,
                                 "is followed by \"%.40s\"; its LOOKUP_TABLE must follow", word);
    if (!vtk_legacy_word(l, word) || !vtk_legacy_end_line(l))
        return false;
    list_other(l, keyword, name);
    if (l->section == POINTS && components == 1)
        take_samples(l, keyword, name, type);
    if (type->sample == SP_UINT8)
        take_colors(l, keyword, name, type, (unsigned)components);
    return vtk_legacy_skip(l, keyword, l->tuples * (unsigned)components, type->number.size);
}

/* Attributes with NAME, TYPE and a fixed number of components. */
static bool take_attribute(struct vtk_legacy *l, const char *keyword) {
    static const struct {
        const char *keyword;
        unsigned components;
    } known[] = { { "VECTORS", 3 },    { "NORMALS", 3 },      { "TENSORS", 9 },   { "TENSORS6", 6 },
                  { "GLOBAL_IDS", 1 }, { "PEDIGREE_IDS", 1 }, { "EDGE_FLAGS", 1 } };
    char name[IMPORT_WORD_MAX + 1];
    const struct vtk_type *type;
    if (!check_section(l, keyword) || !vtk_legacy_word(l, name) ||
        !vtk_legacy_type(l, keyword, &type) || !vtk_legacy_end_line(l))
        return false;
    list_other(l, keyword, name);
    unsigned components = 0;
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (strcasecmp(keyword, known[i].keyword) == 0)
            components = known[i].components;
    if (l->section == POINTS && components == 3)
        take_vectors(l, keyword, name, type);
    if (l->section == POINTS && strcasecmp(keyword, "NORMALS") == 0)
        l->volume->mesh.normals = vtk_legacy_array(l, keyword, name, type, 3 * l->points);
    return vtk_legacy_skip(l, keyword, l->tuples * components, type->number.size);
}

static bool skip_texture(struct vtk_legacy *l, const char *keyword) {
    char name[IMPORT_WORD_MAX + 1];
    uint64_t components;
    const struct vtk_type *type;
    return check_section(l, keyword) && vtk_legacy_word(l, name) &&
           vtk_legacy_count(l, keyword, 3, &components) && vtk_legacy_type(l, keyword, &type) &&
           vtk_legacy_end_line(l) &&
           vtk_legacy_skip(l, keyword, l->tuples * components, type->number.size);
}

/* Bytes, or words in [0, 1]. */
static bool take_color_scalars(struct vtk_legacy *l, const char *keyword) {
    char name[IMPORT_WORD_MAX + 1];
    uint64_t components;
    if (!check_section(l, keyword) || !vtk_legacy_word(l, name) ||
        !vtk_legacy_count(l, keyword, COMPONENTS_MAX, &components) || !vtk_legacy_end_line(l))
        return false;
    list_other(l, keyword, name);
    take_colors(l, keyword, name, vtk_find_type(l->words ? "float" : "unsigned_char", false),
                components);
    return vtk_legacy_skip(l, keyword, l->tuples * components, 1);
}

static bool skip_table(struct vtk_legacy *l, const char *keyword) {
    char name[IMPORT_WORD_MAX + 1];
    uint64_t count;
    return vtk_legacy_word(l, name) && vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &count) &&
           vtk_legacy_end_line(l) && vtk_legacy_skip(l, keyword, 4 * count, 1);
}

/* Named arrays. Outside of a section they belong to anything. */
static bool take_field(struct vtk_legacy *l, const char *keyword) {
    char name[IMPORT_WORD_MAX + 1];
    uint64_t arrays, components, tuples;
    const struct vtk_type *type;
    if (!vtk_legacy_word(l, name) || !vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &arrays))
        return false;
    for (uint64_t i = 0; i < arrays; i++) {
        if (!next_keyword(l, name))
            return false;
        if (!name[0])
            return vtk_legacy_refuse(l, SP_ERR_FORMAT, keyword,
                                     "the file ends %" PRIu64 " arrays before its end", arrays - i);
        if (strcmp(name, "NULL_ARRAY") == 0)
            continue;
        if (!vtk_legacy_count(l, name, COMPONENTS_MAX, &components) ||
            !vtk_legacy_count(l, name, VTK_COUNT_MAX, &tuples) ||
            !vtk_legacy_type(l, name, &type) || !vtk_legacy_end_line(l))
            return false;
        list_other(l, keyword, name);
        bool is_of_points = l->section == POINTS && tuples == l->points;
        if (is_of_points && components == 1 && (type->sample >= 0 || vtk_has_points(l->set)))
            take_samples(l, keyword, name, type);
        if (is_of_points && type->sample == SP_UINT8)
            take_colors(l, keyword, name, type, components);
        else if (is_of_points && components == 3)
            take_vectors(l, keyword, name, type);
        if (!vtk_legacy_skip(l, name, tuples * components, type->number.size))
            return false;
    }
    return true;
}

static bool take_keyword(struct vtk_legacy *l, const char *word) {
    static const struct {
        const char *keyword;
        bool (*take)(struct vtk_legacy *l, const char *keyword);
    } known[] = { { "DATASET", take_dataset },
                  { "DIMENSIONS", take_dimensions },
                  { "ORIGIN", take_origin },
                  { "SPACING", take_spacing },
                  { "ASPECT_RATIO", take_spacing },
                  { "X_COORDINATES", take_coordinates },
                  { "Y_COORDINATES", take_coordinates },
                  { "Z_COORDINATES", take_coordinates },
                  { "POINTS", take_positions },
                  { "CELLS", vtk_legacy_cells },
                  { "VERTICES", vtk_legacy_cells },
                  { "LINES", vtk_legacy_cells },
                  { "POLYGONS", vtk_legacy_cells },
                  { "TRIANGLE_STRIPS", vtk_legacy_cells },
                  { "CELL_TYPES", skip_cell_types },
                  { "POINT_DATA", take_points },
                  { "CELL_DATA", take_cells },
                  { "SCALARS", take_scalars },
                  { "FIELD", take_field },
                  { "VECTORS", take_attribute },
                  { "NORMALS", take_attribute },
                  { "TENSORS", take_attribute },
                  { "TENSORS6", take_attribute },
                  { "GLOBAL_IDS", take_attribute },
                  { "PEDIGREE_IDS", take_attribute },
                  { "EDGE_FLAGS", take_attribute },
                  { "TEXTURE_COORDINATES", skip_texture },
                  { "COLOR_SCALARS", take_color_scalars },
                  { "LOOKUP_TABLE", skip_table } };
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (strcasecmp(word, known[i].keyword) == 0) {
            if (i > 0 && !l->set && known[i].take != take_field)
                return vtk_legacy_refuse(l, SP_ERR_FORMAT, known[i].keyword,
                                         "comes before DATASET");
            return known[i].take(l, known[i].keyword);
        }
    return vtk_legacy_refuse(
        l, SP_ERR_FORMAT, NULL,
        "\"%.40s\" is not a keyword of a VTK file, or a count before it is wrong", word);
}

static bool take_preamble(struct vtk_legacy *l) {
    char line[300], word[IMPORT_WORD_MAX + 1];
    int major = 0;
    if (!import_text_line(&l->text, line, sizeof line, l->err))
        return false;
    if (strncasecmp(line, "# vtk DataFile Version ", 23) != 0 ||
        sscanf(line + 23, "%d", &major) != 1)
        return vtk_legacy_refuse(
            l, SP_ERR_FORMAT, NULL,
            "a legacy VTK file starts with the line # vtk DataFile Version 3.0");
    if (major < 1 || major > 5)
        return vtk_legacy_refuse(
            l, SP_ERR_UNSUPPORTED, NULL,
            "version %d of legacy VTK files is not supported; supported are 1 to 5", major);
    l->new_cells = major == 5;
    if (!import_text_line(&l->text, line, sizeof line, l->err) || !vtk_legacy_word(l, word))
        return false;
    l->words = strcasecmp(word, "ASCII") == 0;
    return l->words || strcasecmp(word, "BINARY") == 0 ||
           vtk_legacy_refuse(l, SP_ERR_FORMAT, NULL,
                             "the third line is \"%.40s\"; it must be ASCII or BINARY", word);
}

static bool check_found(struct vtk_legacy *l) {
    if (!l->set)
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, "DATASET", "is missing at the end of the file");
    if (l->set < VTK_UNSTRUCTURED && !l->grid_at)
        return vtk_legacy_refuse(l, SP_ERR_FORMAT, "DIMENSIONS",
                                 "are missing at the end of the file");
    if (vtk_has_points(l->set))
        return l->volume->points.type ||
               vtk_legacy_refuse(l, SP_ERR_FORMAT, "POINTS", "are missing at the end of the file");
    for (int axis = 0; l->set == VTK_RECTILINEAR && axis < 3; axis++)
        if (!l->volume->positions[axis])
            return vtk_legacy_refuse(
                l, SP_ERR_FORMAT,
                (const char *[]){ "X_COORDINATES", "Y_COORDINATES", "Z_COORDINATES" }[axis],
                "are missing");
    if (l->volume->samples.type || l->volume->vectors.type)
        return true;
    return vtk_legacy_refuse(l, SP_ERR_UNSUPPORTED, "POINT_DATA",
                             "the points have neither scalars nor vectors; the file has %s",
                             l->others[0] ? l->others : "no data");
}

static bool take_all(struct vtk_legacy *l) {
    char word[IMPORT_WORD_MAX + 1];
    import_header_init(l->header);
    if (!take_preamble(l))
        return false;
    do {
        /* What follows is only read for the names of fields: it may be damaged, or of any kind. */
        const bool may_end = l->has_scalars && l->vector_rank > 1;
        bool ok = next_keyword(l, word) && (!word[0] || take_keyword(l, word));
        if (!ok && !may_end)
            return false;
        word[0] = ok ? word[0] : 0;
    } while (word[0]);
    if (!check_found(l))
        return false;
    return vtk_has_points(l->set)
               ? vtk_complete_points(l->volume, l->header, l->points, l->set, l->grid_at, "POINTS",
                                     l->err)
               : vtk_complete(l->volume, l->header, l->grid_at, "DIMENSIONS", l->err);
}

static void *open_legacy(const struct import_file *file, struct import_header *header,
                         struct sp_error *err) {
    struct vtk_volume *volume = calloc(1, sizeof *volume);
    struct vtk_legacy *l = calloc(1, sizeof *l);
    bool ok = volume && l;
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory for the header");
    if (ok) {
        volume->file = file;
        l->file = file;
        l->header = header;
        l->volume = volume;
        l->err = err;
        import_text_init(&l->text, file, 0, file->size);
        ok = take_all(l);
    }
    free(l);
    if (ok)
        return volume;
    if (volume)
        vtk_close(volume);
    return NULL;
}

const struct import_format import_vtk = { .name = "VTK",
                                          .probe = probe,
                                          .open = open_legacy,
                                          .read = vtk_read,
                                          .read_elements = vtk_read_elements,
                                          .close = vtk_close };
