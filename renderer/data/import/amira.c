/* SPDX-License-Identifier: Apache-2.0
 *
 * Amira and Avizo meshes of lattices, uniform or rectilinear: a text header, then sections "@1",
 * "@2", …, each with the numbers of one field as text, bytes, zlib (HxZip) or runs (HxByteRLE).
 *
 *   define Lattice 4 3 2
 *   Parameters { BoundingBox 0 3 0 2 0 1, CoordType "uniform" }
 *   Lattice { byte Data } @1
 *
 * Why this parser is our own: parsers.md.
 */
#include <ctype.h>
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "data/import/derived.h"
#include "data/import/samples.h"
#include "data/import/text.h"
#include "data/import/vectors.h"
#include "data/volume/volume.h"

enum { HEADER_MAX = 1 << 20, FIELDS_MAX = 64, TOKEN_MAX = 255, SECTIONS_MAX = 64 };

enum packing { PACK_NONE, PACK_ZIP, PACK_RUNS };

struct field { /* what a section holds */
    char name[SP_FIELD_BYTES];
    struct import_number number;
    unsigned components;
    bool is_coordinates; /* of a rectilinear lattice; else on the lattice */
    unsigned section;
    enum packing packing;
    uint64_t packed_bytes; /* 0 = not packed */
    uint64_t at;           /* first byte of the section's numbers; 0 = not found */
};

struct amira {
    const struct import_file *file;
    bool is_text, big_endian;
    uint32_t dims[3];
    uint64_t coordinate_count;
    double box[6];
    bool has_box;
    char coordinates[32], unit[SP_UNIT_BYTES];
    struct field fields[FIELDS_MAX];
    unsigned count;
    const struct field *chosen, *vectors, *axes; /* NULL = none */
    unsigned component;                          /* of the chosen one */
    double *positions;                           /* owned: of all axes */
};

struct parser {
    struct amira *amira;
    char *text; /* owned */
    size_t size, at;
    char token[TOKEN_MAX + 1]; /* "" = the end, or a section begins */
    size_t token_at;
    int depth;
    struct sp_error *err;
};

static bool probe(const uint8_t *start, size_t size, const char *title) {
    (void)title;
    return (size >= 11 && memcmp(start, "# AmiraMesh", 11) == 0) ||
           (size >= 7 && memcmp(start, "# Avizo", 7) == 0);
}

static bool fail_at(const struct parser *p, enum sp_code code, const char *text) {
    return import_fail(p->err, code, p->amira->file->title, p->token_at, NULL, "%s", text);
}

/* Reads the next token: a word, a text in quotes, or one of { } ( ) , =. At a section's begin it is
 * "". */
static bool next(struct parser *p) {
    size_t n = 0;
    p->token[0] = 0;
    for (;;) {
        while (p->at < p->size && isspace((unsigned char)p->text[p->at]))
            p->at++;
        if (p->at < p->size && p->text[p->at] == '#')
            p->at += strcspn(p->text + p->at, "\n");
        else
            break;
    }
    p->token_at = p->at;
    if (p->at >= p->size)
        return false;
    const char first = p->text[p->at];
    if (strchr("{}(),=", first)) {
        p->token[n++] = first;
        p->at++;
    } else if (first == '"') {
        for (p->at++; p->at < p->size && p->text[p->at] != '"'; p->at++)
            if (n < TOKEN_MAX)
                p->token[n++] = p->text[p->at];
        p->at++;
    } else {
        for (; p->at < p->size && !isspace((unsigned char)p->text[p->at]) &&
               !strchr("{}(),=", p->text[p->at]);
             p->at++)
            if (n < TOKEN_MAX)
                p->token[n++] = p->text[p->at];
    }
    p->token[n] = 0;
    return true;
}

static bool is_token(const struct parser *p, const char *token) {
    return strcmp(p->token, token) == 0;
}

static bool read_number(struct parser *p, double *out) {
    char *end;
    if (!next(p))
        return fail_at(p, SP_ERR_FORMAT, "the header is cut off");
    *out = strtod(p->token, &end);
    return (end > p->token && !*end && isfinite(*out)) ||
           fail_at(p, SP_ERR_FORMAT, "expected a number");
}

/* Statements. */

static bool read_define(struct parser *p) {
    struct amira *a = p->amira;
    double value = 0;
    if (!next(p))
        return fail_at(p, SP_ERR_FORMAT, "the header is cut off");
    const bool is_lattice = is_token(p, "Lattice"), is_axes = is_token(p, "Coordinates");
    if (!is_lattice && !is_axes)
        return fail_at(
            p, SP_ERR_UNSUPPORTED,
            "this mesh has no lattice (surfaces, tetrahedra, line sets and graphs are not "
            "supported)");
    for (int i = 0; i < (is_lattice ? 3 : 1); i++) {
        if (!read_number(p, &value))
            return false;
        if (!(value >= 1 && value <= 3.0 * SP_DIM_MAX && trunc(value) == value))
            return fail_at(p, SP_ERR_FORMAT,
                           "a size of Lattice must be a whole number of at least 1");
        if (is_lattice)
            a->dims[i] = (uint32_t)value;
        else
            a->coordinate_count = (uint64_t)value;
    }
    return true;
}

/* Parameters may be nested; three of them matter. */
static bool read_parameters(struct parser *p) {
    struct amira *a = p->amira;
    int depth = 0;
    do {
        if (!next(p))
            return fail_at(
                p, SP_ERR_FORMAT,
                "the file ends inside of Parameters: a closing brace is missing, or it is cut off");
        depth += is_token(p, "{") - is_token(p, "}");
        if (is_token(p, "BoundingBox") && depth == 1) {
            for (int i = 0; i < 6; i++)
                if (!read_number(p, &a->box[i]))
                    return false;
            a->has_box = true;
        } else if (is_token(p, "CoordType") && next(p)) {
            snprintf(a->coordinates, sizeof a->coordinates, "%.31s", p->token);
        } else if (is_token(p, "Coordinates") && depth == 2 && next(p)) {
            snprintf(a->unit, sizeof a->unit, "%.31s", p->token);
        }
    } while (depth > 0);
    return true;
}

/* "float[3]". */
static bool read_type(struct parser *p, struct field *f) {
    static const struct import_number_entry known[] = {
        { "byte", 0, { IMPORT_UNSIGNED, 1 } },   { "short", 0, { IMPORT_SIGNED, 2 } },
        { "ushort", 0, { IMPORT_UNSIGNED, 2 } }, { "int", 0, { IMPORT_SIGNED, 4 } },
        { "int32", 0, { IMPORT_SIGNED, 4 } },    { "uint", 0, { IMPORT_UNSIGNED, 4 } },
        { "float", 0, { IMPORT_FLOAT, 4 } },     { "double", 0, { IMPORT_FLOAT, 8 } },
    };
    const char *bracket = strchr(p->token, '[');
    const size_t length = bracket ? (size_t)(bracket - p->token) : strlen(p->token);
    f->components = bracket ? (unsigned)strtoul(bracket + 1, NULL, 10) : 1;
    if (import_number_by_name(known, sizeof known / sizeof *known, p->token, length, &f->number))
        return (f->components >= 1 && f->components <= 16) ||
               fail_at(p, SP_ERR_UNSUPPORTED, "the number of components is outside [1, 16]");
    return fail_at(p, SP_ERR_UNSUPPORTED,
                   "the type is not supported; supported are byte, short, ushort, int, uint, float "
                   "and double");
}

/* "@1", "@1(HxZip,1234)". */
static bool read_section(struct parser *p, struct field *f) {
    char *end;
    f->section = p->token[0] == '@' ? (unsigned)strtoul(p->token + 1, &end, 10) : 0;
    if (f->section < 1 || f->section > SECTIONS_MAX || *end)
        return fail_at(p, SP_ERR_FORMAT, "expected the number of a section, @1 or higher");
    if (p->at >= p->size || p->text[p->at] != '(')
        return true;
    double bytes = 0;
    next(p);
    if (!next(p))
        return fail_at(p, SP_ERR_FORMAT, "the header is cut off");
    if (!is_token(p, "HxZip") && !is_token(p, "HxByteRLE"))
        return fail_at(p, SP_ERR_UNSUPPORTED,
                       "the compression is not supported; supported are HxZip and HxByteRLE");
    f->packing = is_token(p, "HxZip") ? PACK_ZIP : PACK_RUNS;
    if (!next(p) || !read_number(p, &bytes) || !next(p) || !is_token(p, ")") || !(bytes >= 1) ||
        bytes > 1e15)
        return fail_at(p, SP_ERR_FORMAT, "expected the size of the packed numbers");
    f->packed_bytes = (uint64_t)bytes;
    return true;
}

/* "Lattice { byte Data } @1"; the token is the first word. */
static bool read_field(struct parser *p) {
    struct amira *a = p->amira;
    struct field f = { .is_coordinates = is_token(p, "Coordinates") };
    const bool is_used = f.is_coordinates || is_token(p, "Lattice");
    if (!next(p) || !is_token(p, "{") || !next(p))
        return fail_at(p, SP_ERR_FORMAT, "expected \"{ TYPE NAME }\"");
    if (is_used && !read_type(p, &f))
        return false;
    if (!next(p))
        return fail_at(p, SP_ERR_FORMAT, "the header is cut off");
    import_name(f.name, p->token);
    while (!is_token(p, "}"))
        if (!next(p))
            return fail_at(p, SP_ERR_FORMAT, "the header is cut off");
    if (!next(p) || (is_token(p, "=") && !next(p)))
        return fail_at(p, SP_ERR_FORMAT, "expected a section");
    if (!read_section(p, &f))
        return false;
    if (is_used && a->count < FIELDS_MAX)
        a->fields[a->count++] = f;
    return true;
}

static bool read_statements(struct parser *p) {
    while (next(p)) {
        if (p->token[0] == '@')
            return true; /* the first section */
        if (is_token(p, "define")                                   ? !read_define(p)
            : is_token(p, "Parameters") || is_token(p, "Materials") ? !read_parameters(p)
                                                                    : !read_field(p))
            return false;
    }
    return fail_at(p, SP_ERR_FORMAT, "there is no section \"@1\" with numbers");
}

static bool read_magic(struct amira *a, const char *text, struct sp_error *err) {
    char line[128];
    snprintf(line, sizeof line, "%.*s", (int)strcspn(text, "\r\n"), text);
    a->is_text = strstr(line, "ASCII") != NULL;
    a->big_endian = !strstr(line, "LITTLE-ENDIAN");
    return a->is_text || strstr(line, "BINARY") ||
           import_fail(err, SP_ERR_UNSUPPORTED, a->file->title, 0, NULL,
                       "expected ASCII, BINARY or BINARY-LITTLE-ENDIAN in the first line");
}

/* Sections. */

static uint64_t values_of(const struct amira *a, const struct field *f) {
    return (f->is_coordinates ? a->coordinate_count
                              : (uint64_t)a->dims[0] * a->dims[1] * a->dims[2]) *
           f->components;
}

/* Finds the numbers of all sections. Binary ones have a known size. */
static bool find_sections(struct amira *a, uint64_t at, struct sp_error *err) {
    struct import_text *text = malloc(sizeof *text);
    char word[IMPORT_WORD_MAX + 1];
    bool ok = text || sp_fail(err, SP_ERR_MEMORY, a->file->title, "out of memory");
    for (unsigned n = 0; ok && n < a->count; n++) {
        uint64_t word_at;
        struct field *f = NULL;
        import_text_init(text, a->file, at, a->file->size);
        if (!(ok = import_text_word(text, word, &word_at, err)))
            break;
        for (unsigned i = 0; i < a->count && word[0] == '@'; i++)
            if (a->fields[i].section == strtoul(word + 1, NULL, 10) && !a->fields[i].at)
                f = &a->fields[i];
        if (!f) {
            ok = import_fail(err, SP_ERR_FORMAT, a->file->title, word_at, NULL,
                             "expected a section that the header names, or the numbers are cut "
                             "off");
            break;
        }
        f->at = word_at + strlen(word);
        if (a->is_text) {
            ok = import_text_skip(text, values_of(a, f), f->name, err);
            at = text->at;
            continue;
        }
        uint8_t ends[2] = { 0 }; /* a line end */
        if (pread(a->file->fd, ends, 2, (off_t)f->at) > 0)
            f->at += ends[0] == '\r' && ends[1] == '\n' ? 2 : 1;
        at = f->at + (f->packed_bytes ? f->packed_bytes : values_of(a, f) * f->number.size);
        if (at > a->file->size)
            ok = import_fail(err, SP_ERR_FORMAT, a->file->title, f->at, f->name,
                             "the numbers end at byte %" PRIu64 ", the file has %" PRIu64
                             ": it is cut off or Lattice is wrong",
                             at, a->file->size);
    }
    free(text);
    return ok;
}

static bool read_header(struct amira *a, struct sp_error *err) {
    struct parser p = { .amira = a, .err = err };
    p.text = malloc(HEADER_MAX + 1);
    if (!p.text)
        return sp_fail(err, SP_ERR_MEMORY, a->file->title, "out of memory");
    const ssize_t got = pread(a->file->fd, p.text, HEADER_MAX, 0);
    p.size = got > 0 ? (size_t)got : 0;
    p.text[p.size] = 0;
    bool ok = read_magic(a, p.text, err) && read_statements(&p);
    free(p.text);
    if (ok && (a->dims[0] < 1 || a->count == 0))
        ok = import_fail(err, SP_ERR_UNSUPPORTED, a->file->title, 0, NULL,
                         "this mesh has no field on a lattice; only lattices are supported");
    for (int axis = 0; axis < 3 && ok; axis++)
        if (a->dims[axis] > SP_DIM_MAX)
            ok = import_fail(err, SP_ERR_FORMAT, a->file->title, 0, "Lattice",
                             "size %" PRIu32 " is outside [1, %u]", a->dims[axis], SP_DIM_MAX);
    return ok && find_sections(a, p.token_at, err);
}

/* The grid. */

/* Reads numbers that are not packed, as text or bytes. */
static bool read_numbers(const struct amira *a, const struct field *f, double *out,
                         struct sp_error *err) {
    const uint64_t count = values_of(a, f);
    struct import_text *text = malloc(sizeof *text);
    char word[IMPORT_WORD_MAX + 1];
    uint8_t bytes[IMPORT_NUMBER_BYTES];
    uint64_t at = f->at;
    bool ok = text || sp_fail(err, SP_ERR_MEMORY, a->file->title, "out of memory");
    if (ok)
        import_text_init(text, a->file, f->at, a->file->size);
    for (uint64_t i = 0; ok && i < count; i++) {
        if (a->is_text) {
            ok = import_text_word(text, word, &at, err);
            out[i] = ok ? strtod(word, NULL) : 0;
            continue;
        }
        ok = pread(a->file->fd, bytes, f->number.size, (off_t)at) == (ssize_t)f->number.size ||
             import_fail(
                 err, SP_ERR_FORMAT, a->file->title, at, f->name,
                 "cannot read the numbers: the file became shorter, or its disk or network fails");
        if (a->big_endian != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__))
            import_swap_numbers(bytes, f->number, 1);
        out[i] = ok ? import_widen(bytes, f->number) : 0;
        at += f->number.size;
    }
    free(text);
    return ok;
}

static bool place_axes(struct amira *a, struct sp_grid *grid, struct sp_error *err) {
    const uint64_t needed = (uint64_t)a->dims[0] + a->dims[1] + a->dims[2];
    if (!a->axes || a->coordinate_count != needed || a->axes->components != 1 ||
        a->axes->packing != PACK_NONE)
        return import_fail(err, SP_ERR_FORMAT, a->file->title, 0, "Coordinates",
                           "%" PRIu64 " numbers in a section that is not packed are needed, for x, "
                           "y and z",
                           needed);
    a->positions = malloc(needed * sizeof *a->positions);
    if (!a->positions)
        return sp_fail(err, SP_ERR_MEMORY, a->file->title, "out of memory for coordinates");
    if (!read_numbers(a, a->axes, a->positions, err))
        return false;
    double *positions = a->positions;
    for (unsigned axis = 0; axis < 3; positions += a->dims[axis++])
        import_grid_set_positions(grid, axis, positions);
    return true;
}

/* The box has the centres of the first and the last samples. */
static bool place(struct amira *a, struct import_header *header, struct sp_error *err) {
    struct sp_grid *grid = &header->grid;
    memcpy(grid->dims, a->dims, sizeof grid->dims);
    snprintf(header->unit, sizeof header->unit, "%s", a->unit);
    if (strcasecmp(a->coordinates, "rectilinear") == 0)
        return place_axes(a, grid, err);
    if (*a->coordinates && strcasecmp(a->coordinates, "uniform") != 0)
        return import_fail(err, SP_ERR_UNSUPPORTED, a->file->title, 0, "CoordType",
                           "\"%s\" is not supported; supported are uniform and rectilinear",
                           a->coordinates);
    for (int axis = 0; axis < 3 && a->has_box; axis++) {
        const double extent = a->box[2 * axis + 1] - a->box[2 * axis];
        grid->origin[axis] = a->box[2 * axis];
        if (a->dims[axis] > 1 && extent > 0)
            grid->spacing[axis] = extent / (a->dims[axis] - 1);
    }
    return true;
}

/* The samples are the scalars that are wanted, or else the first ones, or else components. */
static void choose(struct amira *a, struct import_header *header) {
    for (unsigned i = 0; i < a->count; i++) {
        const struct field *f = &a->fields[i];
        const bool is_scalar = !f->is_coordinates && f->components == 1;
        if (f->is_coordinates)
            a->axes = f;
        else if (!a->vectors && f->components == 3 && f->number.kind == IMPORT_FLOAT)
            a->vectors = f;
        if (is_scalar && (!a->chosen || strcmp(f->name, a->file->field) == 0))
            a->chosen = f;
    }
    for (unsigned i = 0; i < a->count && !a->chosen && !a->vectors; i++)
        if (!a->fields[i].is_coordinates)
            a->chosen = &a->fields[i];
    if (a->chosen && a->chosen->components > 1)
        a->component = import_header_choose_component(header, a->file->field, a->chosen->components,
                                                      a->chosen->components > 2);
    else if (a->chosen)
        import_name(header->value_name, a->chosen->name);
    for (unsigned i = 0; i < a->count; i++)
        if (&a->fields[i] != a->chosen && !a->fields[i].is_coordinates &&
            a->fields[i].components == 1)
            import_header_add_other(header, a->fields[i].name);
}

/* As what memory holds the numbers of a field. */
static struct import_conversion conversion_of(const struct amira *a, const struct field *f) {
    struct import_conversion c = import_conversion_of(f->number, a->file->warnings);
    if (a->is_text)
        c.number = (struct import_number){ IMPORT_FLOAT, sizeof(double) };
    c.components = f->components;
    c.component = a->component;
    return c;
}

static bool check_packing(const struct amira *a, const struct field *f, struct sp_error *err) {
    if (f->packing != PACK_RUNS || (f->number.size == 1 && f->components == 1))
        return true;
    return import_fail(err, SP_ERR_UNSUPPORTED, a->file->title, f->at, f->name,
                       "HxByteRLE is supported for the type byte only; save the field without it");
}

static bool open_amira(void *reader, const struct import_file *file, struct import_header *header,
                       struct sp_error *err) {
    struct amira *a = reader;
    a->file = file;
    if (!read_header(a, err))
        return false;
    choose(a, header);
    if (!a->chosen && !a->vectors)
        return import_fail(err, SP_ERR_UNSUPPORTED, a->file->title, 0, NULL,
                           "this mesh has no field on its lattice");
    if (a->chosen)
        header->type = conversion_of(a, a->chosen).type;
    if (a->vectors)
        import_header_add_vectors(header, a->vectors->name);
    if (!a->chosen)
        import_header_use_vectors(header, a->file->field);
    return (!a->chosen || check_packing(a, a->chosen, err)) &&
           (!a->vectors || check_packing(a, a->vectors, err)) && place(a, header, err) &&
           sp_grid_check(&header->grid, header->type, a->file->title, &header->bytes, err);
}

static void close_amira(void *reader) {
    struct amira *a = reader;
    free(a->positions);
}

/* Reading. */

struct target { /* samples or vectors */
    void *voxels;
    float (*vectors)[3];
};

/* Text, in parts of whole samples. */
static bool read_text(const struct amira *a, const struct field *f, const struct target *to,
                      const struct import_progress *progress, struct sp_error *err) {
    enum { PART = 3 * 16 * 256 };
    const struct import_conversion c = conversion_of(a, f);
    const uint64_t count = values_of(a, f);
    const struct import_vectors vectors = { .number = c.number,
                                            .count = count / 3,
                                            .out = to->vectors };
    struct import_text *text = malloc(sizeof *text);
    double *part = malloc(PART * sizeof *part);
    char word[IMPORT_WORD_MAX + 1], *end;
    bool ok = (text && part) || sp_fail(err, SP_ERR_MEMORY, a->file->title, "out of memory");
    if (ok)
        import_text_init(text, a->file, f->at, a->file->size);
    const size_t step = PART - PART % f->components;
    for (uint64_t at = 0; ok && at < count; at += step) {
        const size_t n = count - at < step ? (size_t)(count - at) : step;
        uint64_t byte;
        for (size_t i = 0; ok && i < n; i++) {
            ok = import_text_word(text, word, &byte, err);
            part[i] = ok ? strtod(word, &end) : 0;
            if (ok && (!*word || *end))
                ok = import_fail(err, SP_ERR_FORMAT, a->file->title, byte, f->name,
                                 "expected a number");
        }
        if (ok && to->vectors)
            import_vectors_put(&vectors, at, part, n);
        else if (ok)
            import_conversion_put(&c, part, n / f->components,
                                  (char *)to->voxels + at / f->components * sp_type_size(c.type));
        import_report(progress, at);
    }
    free(text);
    free(part);
    return ok;
}

/* Runs of bytes: a count of up to 127 and the byte that is repeated, or 128 + a count and as many
 * bytes. */
static bool read_runs(const struct amira *a, const struct field *f, uint8_t *voxels,
                      struct sp_error *err) {
    const uint64_t count = values_of(a, f);
    uint8_t *packed = malloc(f->packed_bytes);
    if (!packed)
        return sp_fail(err, SP_ERR_MEMORY, a->file->title, "out of memory for packed numbers");
    const ssize_t got = pread(a->file->fd, packed, f->packed_bytes, (off_t)f->at);
    uint64_t at = 0, done = 0;
    const uint64_t size = got > 0 ? (uint64_t)got : 0;
    while (done < count && at + 1 < size) {
        const bool is_copy = packed[at] & 128;
        uint64_t n = packed[at] & 127;
        n = n < count - done ? n : count - done;
        if (is_copy && n > size - at - 1)
            break;
        if (is_copy)
            memcpy(voxels + done, packed + at + 1, n);
        else
            memset(voxels + done, packed[at + 1], n);
        at += is_copy ? n + 1 : 2;
        done += n;
    }
    free(packed);
    return done == count ||
           import_fail(err, SP_ERR_FORMAT, a->file->title, f->at + at, f->name,
                       "the packed numbers end after %" PRIu64 " of %" PRIu64, done, count);
}

static bool read_field_into(const struct amira *a, const struct field *f, const struct target *to,
                            const struct import_progress *progress, struct sp_error *err) {
    const struct import_conversion c = conversion_of(a, f);
    if (a->is_text)
        return read_text(a, f, to, progress, err);
    if (f->packing == PACK_RUNS)
        return read_runs(a, f, to->voxels, err);
    struct import_samples samples = { .file = a->file,
                                      .encoding = f->packing == PACK_ZIP ? IMPORT_GZIP : IMPORT_RAW,
                                      .big_endian = a->big_endian,
                                      .rest = IMPORT_REST_IGNORED,
                                      .start = f->at,
                                      .number = f->number,
                                      .is_vectors = to->vectors != NULL,
                                      .conversion =
                                          to->vectors || import_conversion_is_copy(&c) ? NULL : &c,
                                      .bytes = values_of(a, f) * f->number.size,
                                      .field = f->name };
    return import_samples_read(&samples, to->voxels, to->vectors, progress, err);
}

static bool read_amira(void *reader, void *voxels, float (*vectors)[3],
                       const struct import_progress *progress, struct sp_error *err) {
    const struct amira *a = reader;
    const struct target samples = { .voxels = voxels }, lines = { .vectors = vectors };
    return (!a->chosen || read_field_into(a, a->chosen, &samples, progress, err)) &&
           (!a->vectors || read_field_into(a, a->vectors, &lines, progress, err));
}

const struct import_format import_amira = { .name = "Amira",
                                            .probe = probe,
                                            .reader_size = sizeof(struct amira),
                                            .open = open_amira,
                                            .read = read_amira,
                                            .close = close_amira };
