/* SPDX-License-Identifier: Apache-2.0
 *
 * Points in a text table: a line with the names of columns, then a line of numbers per point.
 * Fields are separated by what separates the names: a tab, a semicolon or a comma. They may be
 * quoted. Lines without characters are skipped, and an empty field is NaN.
 *
 * Why this parser is our own: parsers.md.
 */
#include <ctype.h>
#include <inttypes.h>
#include <math.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/grow.h"
#include "base/parallel_for.h"
#include "data/import/points.h"
#include "data/import/text.h"
#include "data/volume/unit.h"
#include "data/volume/volume.h"

enum { COLUMNS_MAX = 256, FIELD_BYTES = 64, CHUNK_ROWS = 1 << 16 };

struct csv {
    const struct import_file *file;
    struct import_text text;
    uint64_t line; /* from 1 */
    char separator;
    unsigned count; /* columns */
    char names[COLUMNS_MAX][FIELD_BYTES];
    const char *name_of[COLUMNS_MAX];
    char unit[SP_UNIT_BYTES]; /* of the coordinates, from their names; "" = unknown */
    double factors[3];        /* of the coordinates, from their own units to this one */
    struct import_columns columns;
    /* Where every PART rows begin, so that threads can read them; freed with it. */
    struct chunk {
        uint64_t at, line;
    } * chunks;
    size_t chunk_count;
};

static bool probe(const uint8_t *start, size_t size, const char *title) {
    (void)start;
    (void)size;
    return import_ends_with(title, ".csv");
}

/* Fails at a line, and at a column if it is not NULL. */
__attribute__((format(printf, 4, 5))) static bool
refuse(const struct csv *c, const char *column, struct sp_error *err, const char *format, ...) {
    char place[SP_ERROR_PLACE], text[SP_ERROR_TEXT];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    snprintf(place, sizeof place, "%.120s: line %" PRIu64 "%s%.63s", c->file->title, c->line,
             column ? ": column " : "", column ? column : "");
    return sp_fail(err, SP_ERR_FORMAT, place, "%s", text);
}

static int next(struct csv *c, struct sp_error *err) {
    int byte = import_text_peek(&c->text, err);
    c->text.at += byte >= 0;
    return byte;
}

static bool is_blank(const struct csv *c, int byte) {
    return byte == ' ' || byte == '\r' || (byte == '\t' && c->separator != '\t');
}

/* Skips blank lines; false at the end of the file or, with *failed, on failure. */
static bool skip_blank_lines(struct csv *c, bool *failed, struct sp_error *err) {
    int byte;
    while ((byte = import_text_peek(&c->text, err)) == '\n' || is_blank(c, byte)) {
        c->line += byte == '\n';
        c->text.at++;
    }
    *failed = byte == -2;
    return byte >= 0;
}

/* Reads the next field without the blanks around it. *last is set if it ends its line. */
static bool read_field(struct csv *c, char field[FIELD_BYTES], bool *last, struct sp_error *err) {
    size_t n = 0;
    int byte;
    enum { PLAIN, QUOTED, CLOSED } state = PLAIN;
    while ((byte = next(c, err)) >= 0 && byte != '\n' &&
           (byte != c->separator || state == QUOTED)) {
        bool is_quote = byte == '"';
        if (is_quote && state == QUOTED && import_text_peek(&c->text, err) == '"') {
            c->text.at++; /* two quotes are one */
        } else if (is_quote && (state == QUOTED || (state == PLAIN && n == 0))) {
            state = state == QUOTED ? CLOSED : QUOTED;
            continue;
        } else if (is_blank(c, byte) && (state == CLOSED || (state == PLAIN && n == 0))) {
            continue;
        }
        if (state == CLOSED)
            return refuse(c, NULL, err, "text follows a closing quote");
        if (n + 1 == FIELD_BYTES)
            return refuse(c, NULL, err, "a field is longer than %d bytes", FIELD_BYTES - 1);
        field[n++] = byte ? (char)byte : '?';
    }
    if (state == QUOTED && byte != -2)
        return refuse(c, NULL, err, "a quote is not closed");
    while (n > 0 && state == PLAIN && is_blank(c, field[n - 1]))
        n--;
    field[n] = 0;
    *last = byte != c->separator;
    return byte != -2;
}

/* The separator is the first of these that occurs in the line. */
static bool choose_separator(struct csv *c, struct sp_error *err) {
    static const char separators[] = "\t;,";
    size_t best = 2;
    bool quoted = false;
    int byte;
    for (struct import_text *t = &c->text; (byte = import_text_peek(t, err)) >= 0 && byte != '\n';
         t->at++) {
        const char *found = byte ? strchr(separators, byte) : NULL;
        quoted ^= byte == '"';
        if (found && !quoted && (size_t)(found - separators) < best)
            best = (size_t)(found - separators);
    }
    c->separator = separators[best];
    return byte != -2;
}

static bool check_names(const struct csv *c, struct sp_error *err) {
    for (unsigned i = 0; i < c->count; i++)
        for (unsigned k = 0; k < i; k++)
            if (c->names[i][0] && strcasecmp(c->names[i], c->names[k]) == 0)
                return refuse(c, NULL, err,
                              "\"%s\" is the name of the columns %u and %u; rename one",
                              c->names[i], k + 1, i + 1);
    return true;
}

/* The axis of a column: "x", "x [mm]", "x (mm)", or "Points:0" as ParaView writes it. −1 = none. */
static int axis_of(const char *name, char unit[SP_UNIT_BYTES]) {
    static const char axes[] = "xyz", pairs[][3] = { "[]", "()" };
    const char *number = strncasecmp(name, "Points", 6) == 0 ? name + 6 : "";
    const char *axis = name[0] ? strchr(axes, tolower((unsigned char)name[0])) : NULL;
    unit[0] = 0;
    if ((number[0] == ':' || number[0] == '_') && number[1] >= '0' && number[1] <= '2' &&
        !number[2])
        return number[1] - '0';
    if (!axis || (name[1] && name[1] != ' ' && name[1] != '[' && name[1] != '('))
        return -1;
    const char *open = name + 1 + strspn(name + 1, " ");
    const size_t length = strlen(open);
    for (int i = 0; i < 2 && length > 2; i++)
        if (open[0] == pairs[i][0] && open[length - 1] == pairs[i][1] && length < SP_UNIT_BYTES)
            snprintf(unit, SP_UNIT_BYTES, "%.*s", (int)length - 2, open + 1);
    return unit[0] || !open[0] ? (int)(axis - axes) : -1;
}

/* All axes get the unit of x. */
static void apply_units(struct csv *c, char units[3][SP_UNIT_BYTES]) {
    const struct sp_unit *of_x = sp_unit_find(units[0]);
    bool are_alike = true, are_known = of_x != NULL;
    for (int axis = 1; axis < 3; axis++) {
        are_alike &= strcmp(units[axis], units[0]) == 0;
        are_known &= sp_unit_find(units[axis]) != NULL;
    }
    if (are_alike || are_known)
        snprintf(c->unit, sizeof c->unit, "%.31s", are_alike ? units[0] : of_x->symbol);
    else
        import_warn(
            c->file->warnings,
            "The coordinates x, y and z have the units \"%s\", \"%s\" and \"%s\"; they were "
            "not converted.",
            units[0], units[1], units[2]);
    for (int axis = 0; axis < 3 && are_known; axis++)
        c->factors[axis] = sp_unit_find(units[axis])->meters / of_x->meters;
}

/* Calls the columns of coordinates x, y and z, if there is one of each. */
static void name_axes(struct csv *c) {
    static const char *const names[] = { "x", "y", "z" };
    char units[3][SP_UNIT_BYTES], unit[SP_UNIT_BYTES];
    int found[3] = { -1, -1, -1 };
    for (unsigned i = 0; i < c->count; i++) {
        const int axis = axis_of(c->names[i], unit);
        if (axis >= 0 && (found[axis] < 0 || !c->names[i][1])) {
            found[axis] = (int)i;
            memcpy(units[axis], unit, sizeof unit);
        }
    }
    if (found[0] < 0 || found[1] < 0 || found[2] < 0)
        return;
    for (int axis = 0; axis < 3; axis++)
        c->name_of[found[axis]] = names[axis];
    apply_units(c, units);
}

static bool refuse_names(const struct csv *c, struct sp_error *err) {
    struct import_list list;
    char names[120] = "";
    import_list_begin(&list, names, sizeof names);
    for (unsigned i = 0; i < c->count; i++)
        import_list_add(&list, i ? ", " : "", c->names[i][0] ? c->names[i] : "\"\"");
    import_list_end(&list, false);
    return refuse(c, NULL, err,
                  "the first line must name columns x, y and z, separated by commas, semicolons or "
                  "tabs; it names %s. Write x, y and z for the coordinates",
                  names);
}

static bool read_names(struct csv *c, struct sp_error *err) {
    bool last = false, failed;
    static const int mark[] = { 0xef, 0xbb, 0xbf }; /* of byte order, as UTF-8 */
    for (int i = 0; i < 3 && import_text_peek(&c->text, err) == mark[i]; i++)
        c->text.at++;
    if (!skip_blank_lines(c, &failed, err))
        return failed ? false : refuse(c, NULL, err, "the file has no names of columns");
    if (import_text_peek(&c->text, err) == '#') /* as numpy.savetxt() begins its header */
        c->text.at++;
    uint64_t start = c->text.at;
    if (!choose_separator(c, err))
        return false;
    for (c->text.at = start; !last; c->count++) {
        if (c->count == COLUMNS_MAX)
            return refuse(c, NULL, err, "the file has more than %d columns, the limit",
                          COLUMNS_MAX);
        if (!read_field(c, c->names[c->count], &last, err))
            return false;
        c->name_of[c->count] = c->names[c->count];
    }
    if (!check_names(c, err))
        return false;
    name_axes(c);
    if (!import_columns_find(c->file, c->name_of, c->count, &c->columns))
        return refuse_names(c, err);
    c->line++;
    return true;
}

/* Notes that a part begins at the next row. */
static bool add_part(struct csv *c, struct sp_error *err) {
    if (!sp_grow(&c->chunks, c->chunk_count, sizeof *c->chunks))
        return sp_fail(err, SP_ERR_MEMORY, c->file->title, "out of memory for the rows");
    c->chunks[c->chunk_count++] = (struct chunk){ c->text.at, c->line };
    return true;
}

static bool count_rows(struct csv *c, uint64_t *rows, struct sp_error *err) {
    bool failed;
    for (*rows = 0; skip_blank_lines(c, &failed, err); ++*rows) {
        int byte;
        if (*rows % CHUNK_ROWS == 0) {
            import_report(c->file->opening, c->text.at);
            if (!add_part(c, err))
                return false;
        }
        while ((byte = next(c, err)) >= 0 && byte != '\n')
            continue;
        c->line++;
    }
    return !failed;
}

static void close_csv(void *reader) {
    struct csv *c = reader;
    free(c->chunks);
}

static bool open_csv(void *reader, const struct import_file *file, struct import_header *header,
                     struct sp_error *err) {
    struct csv *c = reader;
    uint64_t rows;
    c->file = file;
    c->line = 1;
    for (int axis = 0; axis < 3; axis++)
        c->factors[axis] = 1;
    import_text_init(&c->text, file, 0, file->size);
    if (!read_names(c, err) || !count_rows(c, &rows, err))
        return false;
    if (rows > SP_ELEMENTS_MAX)
        return refuse(c, NULL, err, "%" PRIu64 " points; a volume has at most %d", rows,
                      SP_ELEMENTS_MAX);
    import_columns_use(&c->columns, c->name_of, c->count, (uint32_t)rows, header);
    memcpy(header->unit, c->unit, sizeof header->unit);
    return true;
}

/* Other columns may have any text. */
static bool is_used(const struct import_columns *columns, int column) {
    const bool has_colors = columns->color[0] >= 0;
    bool used = column == columns->scalar && !has_colors;
    for (int a = 0; a < 3; a++)
        used |= column == columns->position[a] || (has_colors && column == columns->color[a]);
    for (int k = 0; k < 6 && columns->variance[0] >= 0; k++)
        used |= column == columns->variance[k] || column == columns->volume;
    return used;
}

/* Some countries write 0,5 for 0.5, and separate by something else. */
static void use_point(char field[FIELD_BYTES]) {
    char *comma = strchr(field, ',');
    if (comma && !strchr(comma + 1, ',') && !strchr(field, '.'))
        *comma = '.';
}

static bool read_row(struct csv *c, double row[COLUMNS_MAX], struct sp_error *err) {
    char field[FIELD_BYTES], *end;
    bool last = false;
    for (unsigned i = 0; i < c->count; i++) {
        if (last)
            return refuse(c, NULL, err, "the row has %u fields instead of %u", i, c->count);
        if (!read_field(c, field, &last, err))
            return false;
        if (c->separator != ',')
            use_point(field);
        row[i] = field[0] ? strtod(field, &end) : NAN;
        if (field[0] && *end && is_used(&c->columns, (int)i))
            return refuse(c, c->names[i], err, "\"%s\" is not a number", field);
    }
    for (int axis = 0; axis < 3; axis++)
        row[c->columns.position[axis]] *= c->factors[axis];
    return last || refuse(c, NULL, err, "the row has more than %u fields", c->count);
}

struct reading {
    const struct sp_elements *elements;
    const struct import_progress *progress;
    struct csv *copies; /* by thread: each has a buffer of its own */
    atomic_size_t rows; /* that are read */
    atomic_size_t ends; /* the first part that failed; parts behind it are left */
    pthread_mutex_t mutex;
    struct sp_error *err; /* of that part; with the mutex */
};

static bool read_chunk(struct csv *c, const struct sp_elements *e, size_t chunk,
                       struct sp_error *err) {
    double row[COLUMNS_MAX];
    bool failed;
    const size_t end = (chunk + 1) * CHUNK_ROWS;
    import_text_init(&c->text, c->file, c->chunks[chunk].at, c->file->size);
    c->line = c->chunks[chunk].line;
    for (size_t i = chunk * CHUNK_ROWS; i < end && i < e->shape.count; i++, c->line++) {
        if (!skip_blank_lines(c, &failed, err))
            return failed
                       ? false
                       : refuse(
                             c, NULL, err,
                             "the file ends before its last row: it was changed while it was read");
        if (!read_row(c, row, err))
            return false;
        import_columns_copy(&c->columns, row, e, (uint32_t)i);
    }
    return true;
}

static void read_chunks(void *user, size_t begin, size_t end, unsigned worker) {
    struct reading *r = user;
    struct csv *c = &r->copies[worker];
    for (size_t chunk = begin; chunk < end && chunk < r->ends; chunk++) {
        struct sp_error err;
        if (!read_chunk(c, r->elements, chunk, &err)) {
            pthread_mutex_lock(&r->mutex);
            if (chunk < r->ends) {
                r->ends = chunk;
                *r->err = err;
            }
            pthread_mutex_unlock(&r->mutex);
        }
        const size_t rows = CHUNK_ROWS + atomic_fetch_add(&r->rows, CHUNK_ROWS);
        if (worker == 0) /* the thread that may report */
            import_report(r->progress, (uint64_t)rows * 4 * sizeof(float));
    }
}

/* Threads read chunks of the file. Reports the error of the first faulty line. */
static bool read_elements(void *reader, const struct sp_elements *elements,
                          const struct import_progress *progress, struct sp_error *err) {
    const struct csv *c = reader;
    struct sp_pool *pool = sp_pool_create(c->chunk_count > 1 ? sp_volume_threads() : 1, err);
    if (!pool)
        return false;
    struct sp_error why = { .code = SP_OK };
    struct reading r = { .elements = elements,
                         .progress = progress,
                         .copies = malloc(sp_pool_threads(pool) * sizeof *r.copies),
                         .ends = c->chunk_count,
                         .mutex = PTHREAD_MUTEX_INITIALIZER,
                         .err = &why };
    for (unsigned i = 0; r.copies && i < sp_pool_threads(pool); i++)
        r.copies[i] = *c;
    if (r.copies)
        sp_parallel_for(pool, c->chunk_count, 1, read_chunks, &r);
    else
        sp_fail(&why, SP_ERR_MEMORY, c->file->title, "out of memory for the rows");
    sp_pool_destroy(&pool);
    free(r.copies);
    if (why.code != SP_OK && err)
        *err = why;
    return why.code == SP_OK;
}

const struct import_format import_csv = { .name = "points (.csv)",
                                          .probe = probe,
                                          .reader_size = sizeof(struct csv),
                                          .open = open_csv,
                                          .read_elements = read_elements,
                                          .close = close_csv };
