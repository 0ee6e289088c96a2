/* SPDX-License-Identifier: Apache-2.0
 *
 * Legacy VTK files: five lines of text, then keywords. Each keyword is followed by its numbers,
 * as words or as big-endian bytes. open() skips arrays by their size; read() goes back to the
 * arrays of the volume.
 *
 * Why this parser is our own: parsers.md.
 */
#include <ctype.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "data/import/vtk_legacy_words.h"

enum { COMPONENTS_MAX = 1 << 16 }; /* of an array that is skipped */

static bool probe(const uint8_t *start, size_t size, const char *title) {
    static const char magic[] = "# vtk DataFile";
    if (size >= sizeof magic - 1 && strncasecmp((const char *)start, magic, sizeof magic - 1) == 0)
        return true;
    return import_ends_with(title, ".vtk") && start[0] != '<';
}

/* Reads the next keyword or array name. VTK may write METADATA after any array; it ends with an
 * empty line, says nothing about samples, and is skipped. */
static bool next_keyword(struct vtk_legacy *l, char word[IMPORT_WORD_MAX + 1]) {
    for (;;) {
        if (!vtk_legacy_read_word(l, word))
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

static bool parse_dataset(struct vtk_legacy *l, const char *keyword) {
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
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "occurs twice");
    if (!vtk_legacy_read_word(l, kind))
        return false;
    for (size_t i = 0; i < sizeof sets / sizeof *sets; i++)
        if (strcasecmp(kind, sets[i].name) == 0)
            l->set = sets[i].set;
    return l->set ||
           VTK_LEGACY_REFUSE(l, SP_ERR_UNSUPPORTED, keyword,
                             "data set %.40s is not supported; supported are STRUCTURED_POINTS, "
                             "RECTILINEAR_GRID, STRUCTURED_GRID, UNSTRUCTURED_GRID and POLYDATA",
                             kind);
}

static bool parse_dimensions(struct vtk_legacy *l, const char *keyword) {
    if (l->set > VTK_STRUCTURED)
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "do not belong to this data set");
    if (l->grid_at)
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "the file has them twice");
    l->grid_at = l->byte;
    l->points = l->cells = 1;
    for (int axis = 0; axis < 3; axis++) {
        uint64_t n;
        if (!vtk_legacy_count(l, keyword, SP_DIM_MAX, &n))
            return false;
        vtk_legacy_piece(l)->dims[axis] = (uint32_t)n;
        l->points *= n;
        l->cells *= n > 1 ? n - 1 : 1;
    }
    return l->points > 0 || VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "the grid is empty");
}

static bool parse_triple(struct vtk_legacy *l, const char *keyword, double out[3]) {
    if (l->set != VTK_IMAGE)
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "belongs to STRUCTURED_POINTS only");
    for (int axis = 0; axis < 3; axis++) {
        char word[IMPORT_WORD_MAX + 1], *end;
        if (!vtk_legacy_read_word(l, word))
            return false;
        out[axis] = strtod(word, &end);
        if (end == word || *end)
            return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "\"%.40s\" is not a number", word);
    }
    return true;
}

static bool parse_origin(struct vtk_legacy *l, const char *keyword) {
    return parse_triple(l, keyword, l->volume->image.origin);
}

static bool parse_spacing(struct vtk_legacy *l, const char *keyword) {
    return parse_triple(l, keyword, l->volume->image.spacing);
}

/* Adds the array that begins here. NULL with *err set when out of memory. */
static struct vtk_entry *add(struct vtk_legacy *l, enum vtk_home home, const char *keyword,
                             const char *name, const struct vtk_type *type) {
    struct vtk_entry *e = vtk_add_entry(l->volume, home, name, l->err);
    if (e)
        e->array = vtk_legacy_array(l, keyword, name, type);
    if (e)
        e->components = 1;
    return e;
}

static bool parse_coordinates(struct vtk_legacy *l, const char *keyword) {
    const unsigned axis = (unsigned)(keyword[0] & ~0x20) - 'X';
    uint64_t count;
    const struct vtk_type *type;
    if (!l->grid_at || l->set != VTK_RECTILINEAR)
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword,
                                 "must follow the DIMENSIONS of a "
                                 "RECTILINEAR_GRID");
    const struct vtk_piece *piece = vtk_legacy_piece(l);
    if (vtk_find_entry(l->volume, piece, VTK_COORDINATES, axis, NULL))
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "occurs twice");
    if (!vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &count))
        return false;
    if (count != piece->dims[axis])
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword,
                                 "%" PRIu64 " coordinates for the %" PRIu32
                                 " samples of DIMENSIONS",
                                 count, piece->dims[axis]);
    if (!vtk_legacy_type(l, keyword, &type) || !vtk_legacy_end_line(l))
        return false;
    struct vtk_entry *e = add(l, VTK_COORDINATES, keyword, type->legacy, type);
    if (e)
        e->part = axis;
    return e && vtk_legacy_skip(l, keyword, type, count);
}

/* The positions of points. */
static bool parse_positions(struct vtk_legacy *l, const char *keyword) {
    uint64_t count, byte = l->byte;
    const struct vtk_type *type;
    if (!vtk_has_points(l->set))
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "do not belong to this data set");
    if (vtk_find_entry(l->volume, vtk_legacy_piece(l), VTK_POSITIONS, 0, NULL))
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "occurs twice");
    if (l->set == VTK_STRUCTURED && !l->grid_at)
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "comes before DIMENSIONS");
    if (!vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &count))
        return false;
    if (l->set == VTK_STRUCTURED && count != l->points)
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword,
                                 "%" PRIu64 " points, but DIMENSIONS give %" PRIu64, count,
                                 l->points);
    if (!vtk_legacy_type(l, keyword, &type) || !vtk_legacy_end_line(l))
        return false;
    if (l->set != VTK_STRUCTURED)
        l->grid_at = byte;
    l->points = count;
    vtk_legacy_piece(l)->count = count;
    struct vtk_entry *e = add(l, VTK_POSITIONS, keyword, "", type);
    if (e)
        e->components = 3;
    return e && vtk_legacy_skip(l, keyword, type, 3 * count);
}

static bool skip_cell_types(struct vtk_legacy *l, const char *keyword) {
    uint64_t count;
    return vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &count) && vtk_legacy_end_line(l) &&
           vtk_legacy_skip(l, keyword, vtk_find_type("int", false), count);
}

/* The attributes. */

static bool begin_section(struct vtk_legacy *l, const char *keyword, int section) {
    l->section = section;
    if (!l->grid_at)
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "comes before %s",
                                 l->set > VTK_STRUCTURED ? "POINTS" : "DIMENSIONS");
    if (!vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &l->tuples))
        return false;
    return l->points <= SP_VOXELS_MAX ||
           import_fail(l->err, SP_ERR_FORMAT, l->file->title, l->grid_at, "DIMENSIONS",
                       "the grid has more than %" PRIu64 " voxels, the limit", SP_VOXELS_MAX);
}

static bool parse_point_data(struct vtk_legacy *l, const char *keyword) {
    if (!begin_section(l, keyword, POINTS))
        return false;
    return l->tuples == l->points ||
           VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "%" PRIu64 " points, but %s give %" PRIu64,
                             l->tuples, l->set > VTK_STRUCTURED ? "POINTS" : "DIMENSIONS",
                             l->points);
}

static bool parse_cell_data(struct vtk_legacy *l, const char *keyword) {
    if (!begin_section(l, keyword, CELLS))
        return false;
    if (!vtk_has_points(l->set) && l->tuples != l->cells)
        import_warn(l->file->warnings,
                    "CELL_DATA has %" PRIu64 " values, but the grid has %" PRIu64
                    " cells: the data of cells are left out.",
                    l->tuples, l->cells);
    return true;
}

static bool check_section(const struct vtk_legacy *l, const char *keyword) {
    return l->section != NOWHERE ||
           VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "comes before POINT_DATA and CELL_DATA");
}

/* Copies the name of an array. VTK writes odd characters as %XX. */
static void decode_name(char out[SP_FIELD_BYTES], const char *name) {
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

/* Adds the array of points or cells that begins here, unless it is no field. */
static bool add_field(struct vtk_legacy *l, const char *keyword, const char *name,
                      const struct vtk_type *type, uint64_t components, enum vtk_role role) {
    const bool is_of_cells = l->section == CELLS && !vtk_has_points(l->set);
    char own[SP_FIELD_BYTES];
    if (l->section == CELLS && vtk_has_points(l->set)) {
        decode_name(own, name);
        vtk_note_cells(l->volume, own);
    }
    if ((l->section != POINTS && !is_of_cells) || (is_of_cells && l->tuples != l->cells) ||
        components == 0)
        return true;
    decode_name(own, name);
    if (components > VTK_COMPONENTS_MAX) {
        import_warn(l->file->warnings,
                    "The array \"%.60s\" has %" PRIu64 " components, more than %d; it is not read.",
                    own, components, VTK_COMPONENTS_MAX);
        return true;
    }
    struct vtk_entry *e = add(l, is_of_cells ? VTK_OF_CELLS : VTK_OF_POINTS, keyword, name, type);
    if (!e)
        return false;
    memcpy(e->name, own, sizeof own);
    e->components = (unsigned)components;
    e->role = role;
    l->has_scalars |= l->section == POINTS && role == VTK_SCALARS && components == 1;
    l->has_vectors |= l->section == POINTS && role == VTK_VECTORS;
    return true;
}

static bool parse_scalars(struct vtk_legacy *l, const char *keyword) {
    char line[512], name[256] = "", kind[64] = "", word[IMPORT_WORD_MAX + 1];
    int components = 1;
    if (!check_section(l, keyword) || !import_text_line(&l->text, line, sizeof line, l->err))
        return false;
    sscanf(line, "%255s %63s %d", name, kind, &components);
    const struct vtk_type *type = vtk_find_type(kind, false);
    if (!type)
        return VTK_LEGACY_REFUSE(l, SP_ERR_UNSUPPORTED, keyword,
                                 "values of type \"%s\" are not supported", kind);
    if (components < 1 || components > COMPONENTS_MAX) /* SimpleITK writes more than 4 */
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword, "%d components, outside [1, %d]",
                                 components, COMPONENTS_MAX);
    if (!vtk_legacy_read_word(l, word))
        return false;
    if (strcasecmp(word, "LOOKUP_TABLE") != 0)
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword,
                                 "is followed by \"%.40s\"; its LOOKUP_TABLE must follow", word);
    if (!vtk_legacy_read_word(l, word) || !vtk_legacy_end_line(l))
        return false;
    return add_field(l, keyword, name, type, (unsigned)components, VTK_SCALARS) &&
           vtk_legacy_skip(l, keyword, type, l->tuples * (unsigned)components);
}

/* Attributes with NAME, TYPE and a fixed number of components. */
static bool parse_attribute(struct vtk_legacy *l, const char *keyword) {
    static const struct {
        const char *keyword;
        unsigned components;
        enum vtk_role role;
    } known[] = { { "VECTORS", 3, VTK_VECTORS }, { "NORMALS", 3, VTK_NORMALS },
                  { "TENSORS", 9, VTK_ANY },     { "TENSORS6", 6, VTK_ANY },
                  { "GLOBAL_IDS", 1, VTK_IDS },  { "PEDIGREE_IDS", 1, VTK_IDS },
                  { "EDGE_FLAGS", 1, VTK_IDS } };
    char name[IMPORT_WORD_MAX + 1];
    const struct vtk_type *type;
    size_t i = 0;
    if (!check_section(l, keyword) || !vtk_legacy_read_word(l, name) ||
        !vtk_legacy_type(l, keyword, &type) || !vtk_legacy_end_line(l))
        return false;
    while (strcasecmp(keyword, known[i].keyword) != 0)
        i++;
    return add_field(l, keyword, name, type, known[i].components, known[i].role) &&
           vtk_legacy_skip(l, keyword, type, l->tuples * known[i].components);
}

static bool parse_texture(struct vtk_legacy *l, const char *keyword) {
    char name[IMPORT_WORD_MAX + 1];
    uint64_t components;
    const struct vtk_type *type;
    return check_section(l, keyword) && vtk_legacy_read_word(l, name) &&
           vtk_legacy_count(l, keyword, 3, &components) && vtk_legacy_type(l, keyword, &type) &&
           vtk_legacy_end_line(l) && add_field(l, keyword, name, type, components, VTK_IDS) &&
           vtk_legacy_skip(l, keyword, type, l->tuples * components);
}

/* Bytes, or words in [0, 1]. */
static bool parse_color_scalars(struct vtk_legacy *l, const char *keyword) {
    char name[IMPORT_WORD_MAX + 1];
    uint64_t components;
    const struct vtk_type *type = vtk_find_type(l->words ? "float" : "unsigned_char", false);
    return check_section(l, keyword) && vtk_legacy_read_word(l, name) &&
           vtk_legacy_count(l, keyword, COMPONENTS_MAX, &components) && vtk_legacy_end_line(l) &&
           add_field(l, keyword, name, type, components, VTK_COLORS) &&
           vtk_legacy_skip(l, keyword, type, l->tuples * components);
}

static bool skip_table(struct vtk_legacy *l, const char *keyword) {
    char name[IMPORT_WORD_MAX + 1];
    uint64_t count;
    return vtk_legacy_read_word(l, name) && vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &count) &&
           vtk_legacy_end_line(l) &&
           vtk_legacy_skip(l, keyword, vtk_find_type("unsigned_char", false), 4 * count);
}

/* The time of the file: an array of one number outside of sections. */
static bool parse_time(struct vtk_legacy *l, const char *name, const struct vtk_type *type) {
    struct vtk_array a = vtk_legacy_array(l, "FIELD", name, type);
    a.count = 1;
    double *time =
        vtk_array_check(l->file, &a, l->err) ? vtk_array_read_numbers(l->file, &a, l->err) : NULL;
    if (time)
        l->volume->time = *time;
    free(time);
    return time != NULL;
}

/* One array of a FIELD. */
static bool parse_array(struct vtk_legacy *l, const char *keyword, const char *name) {
    static const char *const texts[] = { "string", "utf8_string" };
    uint64_t components, tuples;
    char word[IMPORT_WORD_MAX + 1];
    if (!vtk_legacy_count(l, name, COMPONENTS_MAX, &components) ||
        !vtk_legacy_count(l, name, VTK_COUNT_MAX, &tuples) || !vtk_legacy_read_word(l, word))
        return false;
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++)
        if (strcasecmp(word, texts[i]) == 0)
            return vtk_legacy_end_line(l) && vtk_legacy_skip_strings(l, name, components * tuples);
    const struct vtk_type *type = vtk_find_type(word, false);
    if (!type)
        return VTK_LEGACY_REFUSE(l, SP_ERR_UNSUPPORTED, name,
                                 "values of type \"%.40s\" are not supported", word);
    if (!vtk_legacy_end_line(l))
        return false;
    const bool is_time = strcasecmp(name, "TimeValue") == 0 || strcasecmp(name, "TIME") == 0;
    if (l->section == NOWHERE && is_time && components * tuples == 1 && !parse_time(l, name, type))
        return false;
    return (tuples != l->tuples || add_field(l, keyword, name, type, components, VTK_ANY)) &&
           vtk_legacy_skip(l, name, type, tuples * components);
}

/* Named arrays. Outside of a section they belong to anything. */
static bool parse_field(struct vtk_legacy *l, const char *keyword) {
    char name[IMPORT_WORD_MAX + 1];
    uint64_t arrays;
    if (!vtk_legacy_read_word(l, name) || !vtk_legacy_count(l, keyword, VTK_COUNT_MAX, &arrays))
        return false;
    for (uint64_t i = 0; i < arrays; i++) {
        if (!next_keyword(l, name))
            return false;
        if (!name[0])
            return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, keyword,
                                     "the file ends %" PRIu64 " arrays before its end", arrays - i);
        if (strcmp(name, "NULL_ARRAY") != 0 && !parse_array(l, keyword, name))
            return false;
    }
    return true;
}

static bool parse_keyword(struct vtk_legacy *l, const char *word) {
    static const struct {
        const char *keyword;
        bool (*handler)(struct vtk_legacy *l, const char *keyword);
    } known[] = { { "DATASET", parse_dataset },
                  { "DIMENSIONS", parse_dimensions },
                  { "ORIGIN", parse_origin },
                  { "SPACING", parse_spacing },
                  { "ASPECT_RATIO", parse_spacing },
                  { "X_COORDINATES", parse_coordinates },
                  { "Y_COORDINATES", parse_coordinates },
                  { "Z_COORDINATES", parse_coordinates },
                  { "POINTS", parse_positions },
                  { "CELLS", vtk_legacy_cells },
                  { "VERTICES", vtk_legacy_cells },
                  { "LINES", vtk_legacy_cells },
                  { "POLYGONS", vtk_legacy_cells },
                  { "TRIANGLE_STRIPS", vtk_legacy_cells },
                  { "CELL_TYPES", skip_cell_types },
                  { "POINT_DATA", parse_point_data },
                  { "CELL_DATA", parse_cell_data },
                  { "SCALARS", parse_scalars },
                  { "FIELD", parse_field },
                  { "VECTORS", parse_attribute },
                  { "NORMALS", parse_attribute },
                  { "TENSORS", parse_attribute },
                  { "TENSORS6", parse_attribute },
                  { "GLOBAL_IDS", parse_attribute },
                  { "PEDIGREE_IDS", parse_attribute },
                  { "EDGE_FLAGS", parse_attribute },
                  { "TEXTURE_COORDINATES", parse_texture },
                  { "COLOR_SCALARS", parse_color_scalars },
                  { "LOOKUP_TABLE", skip_table } };
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (strcasecmp(word, known[i].keyword) == 0) {
            if (i > 0 && !l->set && known[i].handler != parse_field)
                return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, known[i].keyword,
                                         "comes before DATASET");
            return known[i].handler(l, known[i].keyword);
        }
    return VTK_LEGACY_REFUSE(
        l, SP_ERR_FORMAT, NULL,
        "\"%.40s\" is not a keyword of a VTK file, or a count before it is wrong", word);
}

static bool parse_preamble(struct vtk_legacy *l) {
    char line[300], word[IMPORT_WORD_MAX + 1];
    int major = 0;
    if (!import_text_line(&l->text, line, sizeof line, l->err))
        return false;
    if (strncasecmp(line, "# vtk DataFile Version ", 23) != 0 ||
        sscanf(line + 23, "%d", &major) != 1)
        return VTK_LEGACY_REFUSE(
            l, SP_ERR_FORMAT, NULL,
            "a legacy VTK file starts with the line # vtk DataFile Version 3.0");
    if (major < 1 || major > 5)
        return VTK_LEGACY_REFUSE(
            l, SP_ERR_UNSUPPORTED, NULL,
            "version %d of legacy VTK files is not supported; supported are 1 to 5", major);
    l->new_cells = major == 5;
    if (!import_text_line(&l->text, line, sizeof line, l->err) || !vtk_legacy_read_word(l, word))
        return false;
    l->words = strcasecmp(word, "ASCII") == 0;
    return l->words || strcasecmp(word, "BINARY") == 0 ||
           VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, NULL,
                             *word ? "the third line is \"%.40s\"; it must be ASCII or BINARY"
                                   : "the third line is empty%s; it must be ASCII or BINARY",
                             word);
}

static bool check_found(struct vtk_legacy *l) {
    if (!l->set)
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, "DATASET", "is missing at the end of the file");
    if (l->set < VTK_UNSTRUCTURED && !l->grid_at)
        return VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, "DIMENSIONS",
                                 "are missing at the end of the file");
    if (vtk_has_points(l->set))
        return vtk_find_entry(l->volume, vtk_legacy_piece(l), VTK_POSITIONS, 0, NULL) ||
               VTK_LEGACY_REFUSE(l, SP_ERR_FORMAT, "POINTS", "are missing at the end of the file");
    for (unsigned axis = 0; l->set == VTK_RECTILINEAR && axis < 3; axis++)
        if (!vtk_find_entry(l->volume, vtk_legacy_piece(l), VTK_COORDINATES, axis, NULL))
            return VTK_LEGACY_REFUSE(
                l, SP_ERR_FORMAT,
                (const char *[]){ "X_COORDINATES", "Y_COORDINATES", "Z_COORDINATES" }[axis],
                "the arrays are missing");
    return true;
}

static bool parse_all(struct vtk_legacy *l) {
    char word[IMPORT_WORD_MAX + 1];
    if (!parse_preamble(l))
        return false;
    do {
        /* What follows is only read for the names of fields: it may be damaged, or of any kind. */
        const bool may_end = l->has_scalars && l->has_vectors;
        bool ok = next_keyword(l, word) && (!word[0] || parse_keyword(l, word));
        if (!ok && !may_end)
            return false;
        word[0] = ok ? word[0] : 0;
    } while (word[0]);
    if (!check_found(l))
        return false;
    l->volume->set = l->set;
    l->volume->grid_at = l->grid_at;
    l->volume->grid_name = vtk_has_points(l->set) ? "POINTS" : "DIMENSIONS";
    return true;
}

/* Reads the structure and the places of arrays. */
static bool parse(struct vtk_volume *volume, const struct import_file *file, struct sp_error *err) {
    vtk_init(volume, file);
    struct vtk_legacy *l = calloc(1, sizeof *l);
    if (!l)
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for the header");
    bool ok = vtk_add_piece(volume, 0, err);
    if (ok) {
        l->file = file;
        l->volume = volume;
        l->err = err;
        import_text_init(&l->text, file, 0, file->size);
        ok = parse_all(l);
    }
    free(l);
    return ok;
}

static bool open_legacy(void *reader, const struct import_file *file, struct import_header *header,
                        struct sp_error *err) {
    return parse(reader, file, err) && vtk_complete(reader, header, err);
}

static bool read_time(const struct import_file *file, double *time) {
    struct vtk_volume v;
    const bool ok = parse(&v, file, NULL) && isfinite(v.time);
    *time = v.time;
    vtk_close(&v);
    return ok;
}

const struct import_format import_vtk = { .name = "VTK",
                                          .probe = probe,
                                          .reader_size = sizeof(struct vtk_volume),
                                          .open = open_legacy,
                                          .read = vtk_read,
                                          .read_elements = vtk_read_elements,
                                          .close = vtk_close,
                                          .read_time = read_time };
