/* SPDX-License-Identifier: Apache-2.0
 *
 * NRRD, attached and detached, in every encoding but zrl. nrrd_header.c parses the header;
 * samples.c reads the samples straight to their place and counts every byte.
 *
 * ITK's reader (NrrdIO) is no replacement: it cannot read a part of a file, so that one time step
 * needs the memory of the whole series; it lacks bzip2 and the units; it reads axis mins and maxs
 * as spacing 1.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/derived.h"
#include "data/import/meaning.h"
#include "data/import/nrrd_header.h"
#include "data/import/pattern.h"
#include "data/import/samples.h"
#include "data/volume/volume.h"

enum { PIECES_MAX = 65536 }; /* data files */

struct parsing {
    const struct import_file *file;
    const struct nrrd_header *text;
    struct import_header *header;
    struct import_samples *samples;
    struct import_conversion *conversion;
    double **times; /* as in struct nrrd */
    struct sp_error *err;
};

struct nrrd {
    struct import_sampled sampled; /* the first: read() is that of samples.h */
    double *times;                 /* owned; of the steps, for the header; NULL = none */
};

#define REFUSE(p, code, field, ...)                                                                \
    NRRD_FAIL((p)->err, code, (p)->file, (p)->text, field, __VA_ARGS__)

static bool probe(const uint8_t *start, size_t size, const char *title) {
    return (size >= 4 && memcmp(start, "NRRD", 4) == 0) || import_ends_with(title, ".nrrd") ||
           import_ends_with(title, ".nhdr");
}

static void set_sizes(const struct parsing *p) {
    const struct nrrd_header *h = p->text;
    for (unsigned axis = 0; axis < 3; axis++)
        p->header->grid.dims[axis] = axis < h->axes ? (uint32_t)h->sizes[h->first + axis] : 1;
}

/* Axes along the axes of the world, from "spacings", "axis mins" and "axis maxs". */
static bool set_spacings(const struct parsing *p) {
    const struct nrrd_header *h = p->text;
    for (unsigned i = 0; i < h->axes; i++) {
        unsigned axis = h->first + i;
        double *spacing = &p->header->grid.spacing[i], n = (double)h->sizes[axis];
        bool cell = h->is_cell[axis];
        if (h->value[NRRD_SPACINGS]) {
            if (isinf(h->spacing[axis]))
                return REFUSE(p, SP_ERR_FORMAT, NRRD_SPACINGS, "the spacing of axis %u is infinite",
                              axis);
            if (isnan(h->spacing[axis])) /* how NRRD says that it is unknown */
                import_warn(p->file->warnings,
                            "The spacing of axis %u is unknown (spacings: NaN); it is taken as 1.",
                            axis);
            else
                *spacing = h->spacing[axis];
        } else if (isfinite(h->min[axis]) && isfinite(h->max[axis]) &&
                   (cell || h->sizes[axis] > 1)) {
            *spacing = (h->max[axis] - h->min[axis]) / (cell ? n : n - 1);
        }
        if (isfinite(h->min[axis]))
            p->header->grid.origin[i] = h->min[axis] + (cell ? *spacing / 2 : 0);
        if (*spacing < 0) {
            *spacing = -*spacing;
            p->header->grid.direction[i][i] = -1;
        }
    }
    return true;
}

/* Computes the third axis of an image with two axes, perpendicular to both. */
static bool compute_third_direction(const struct parsing *p) {
    struct sp_grid *grid = &p->header->grid;
    double n[3], length = 0;
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        n[i] = grid->direction[j][0] * grid->direction[k][1] -
               grid->direction[k][0] * grid->direction[j][1];
        length += n[i] * n[i];
    }
    length = sqrt(length);
    if (!(length > 1e-6))
        return REFUSE(p, SP_ERR_FORMAT, NRRD_SPACE_DIRECTIONS, "the two axes are parallel");
    for (int row = 0; row < 3; row++)
        grid->direction[row][2] = n[row] / length;
    return true;
}

/* "space directions": columns whose lengths are the spacings. */
static bool set_directions(const struct parsing *p) {
    struct sp_grid *grid = &p->header->grid;
    for (unsigned axis = 0; axis < p->text->axes; axis++) {
        const double *v = p->text->direction[p->text->first + axis];
        double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        if (!isfinite(length) || !(length > 0))
            return REFUSE(p, SP_ERR_FORMAT, NRRD_SPACE_DIRECTIONS,
                          "the direction of axis %u is not a number or has length 0", axis);
        grid->spacing[axis] = length;
        for (int row = 0; row < 3; row++)
            grid->direction[row][axis] = v[row] / length;
    }
    return p->text->axes == 3 || compute_third_direction(p);
}

/* The unit of the values, with or without quotation marks. A text that is too long for a unit is
 * none. */
static void set_sample_units(const struct parsing *p) {
    const char *unit = p->text->value[NRRD_SAMPLE_UNITS];
    size_t n = unit ? strlen(unit) : 0;
    if (n >= 2 && unit[0] == '"' && unit[n - 1] == '"') {
        unit++;
        n -= 2;
    }
    if (n < SP_UNIT_BYTES)
        snprintf(p->header->value_unit, sizeof p->header->value_unit, "%.*s", (int)n,
                 unit ? unit : "");
}

static bool set_geometry(const struct parsing *p) {
    set_sizes(p);
    bool directed = p->text->value[NRRD_SPACE_DIRECTIONS] != NULL;
    if (!(directed ? set_directions(p) : set_spacings(p)))
        return false;
    if (p->text->value[NRRD_SPACE_ORIGIN])
        memcpy(p->header->grid.origin, p->text->origin,
               (p->text->space < 3 ? p->text->space : 3) * sizeof(double));
    memcpy(p->header->unit, p->text->unit, sizeof p->header->unit);
    set_sample_units(p);
    if (p->text->value[NRRD_MEASUREMENT_FRAME] && p->text->vectors >= 0)
        memcpy(p->header->frame, p->text->frame, sizeof p->header->frame);
    if (directed && p->text->anatomy[0]) /* the space names the axes of the vectors */
        import_header_set_anatomy(p->header, p->text->anatomy);
    return true;
}

static bool parse_skips(const struct parsing *p) {
    struct import_samples *s = p->samples;
    long long n;
    if (p->text->value[NRRD_LINE_SKIP]) {
        if (!import_integer(p->text->value[NRRD_LINE_SKIP], 0, 1000000, &n))
            return REFUSE(p, SP_ERR_FORMAT, NRRD_LINE_SKIP,
                          "\"%.40s\" is no whole number in [0, 1000000]",
                          p->text->value[NRRD_LINE_SKIP]);
        s->skip_lines = (uint64_t)n;
    }
    if (p->text->value[NRRD_BYTE_SKIP]) {
        if (!import_integer(p->text->value[NRRD_BYTE_SKIP], -1, INT64_C(1) << 48, &n))
            return REFUSE(p, SP_ERR_FORMAT, NRRD_BYTE_SKIP,
                          "\"%.40s\" is no whole number in [-1, 2^48]",
                          p->text->value[NRRD_BYTE_SKIP]);
        if (n < 0 && s->encoding != IMPORT_RAW)
            return REFUSE(p, SP_ERR_FORMAT, NRRD_BYTE_SKIP,
                          "-1 (the last bytes of the file) needs encoding raw");
        s->from_end = n < 0;
        s->skip_bytes = n < 0 ? 0 : (uint64_t)n;
    }
    s->rest = s->skip_lines > 0 || s->skip_bytes > 0 ? IMPORT_REST_IGNORED : IMPORT_REST_WARNED;
    return true;
}

/* Data files. */

static bool add_name(const struct parsing *p, const char *name, size_t length) {
    if (p->samples->count >= PIECES_MAX)
        return REFUSE(p, SP_ERR_FORMAT, NRRD_DATA_FILE, "names more than %d files", PIECES_MAX);
    if (!import_samples_add(p->samples, name, length))
        return sp_fail(p->err, SP_ERR_MEMORY, p->file->title, "out of memory for file names");
    return true;
}

static bool add_list(const struct parsing *p) {
    const char *at = p->text->list, *stop = p->text->text + p->text->size;
    size_t length = strlen(at); /* the text ends with 0 */
    if (at + length != stop)
        return import_fail(p->err, SP_ERR_FORMAT, p->file->title,
                           (uint64_t)(at + length - p->text->text), "data file",
                           "a file name contains a byte of value 0");
    while (*at) {
        size_t line = strcspn(at, "\n"), n = line;
        while (n > 0 && (at[n - 1] == '\r' || at[n - 1] == ' '))
            n--;
        if (n > 0 && !add_name(p, at, n))
            return false;
        at += line + (at[line] == '\n');
    }
    if (p->samples->count == 0)
        return REFUSE(p, SP_ERR_FORMAT, NRRD_DATA_FILE, "the LIST is empty");
    return true;
}

static bool add_pattern(const struct parsing *p, const struct import_pattern *f) {
    if (!import_pattern_is_sound(f))
        return REFUSE(p, SP_ERR_FORMAT, NRRD_DATA_FILE,
                      "counts from %lld to %lld by %lld; the step must lead from the first number "
                      "to the last one",
                      f->low, f->high, f->step);
    for (long long i = f->low; f->step > 0 ? i <= f->high : i >= f->high; i += f->step) {
        char name[IMPORT_PATTERN_NAME];
        import_pattern_name(f, i, name);
        if (!add_name(p, name, strlen(name)))
            return false;
    }
    return true;
}

/* Each file holds the axes below `subdim`, or a slab along the last axis if `subdim` is the
 * dimension. In both cases the files follow each other in memory. */
static bool check_pieces(const struct parsing *p, long long subdim) {
    unsigned dim = p->text->dimension;
    uint64_t pieces = p->samples->count, expected = 1;
    if (subdim < 0 || subdim > dim)
        return REFUSE(p, SP_ERR_FORMAT, NRRD_DATA_FILE, "files of %lld axes for a volume of %u",
                      subdim, dim);
    if (subdim == 0)
        subdim = dim - 1;
    for (unsigned axis = (unsigned)subdim; axis < dim; axis++)
        expected *= p->text->sizes[axis];
    if (subdim < dim ? pieces != expected : p->text->sizes[dim - 1] % pieces != 0)
        return REFUSE(p, SP_ERR_FORMAT, NRRD_DATA_FILE,
                      "names %" PRIu64 " files, but sizes need %" PRIu64, pieces,
                      subdim < dim ? expected : p->text->sizes[dim - 1]);
    return true;
}

static bool add_data_files(const struct parsing *p) {
    const char *value = p->text->value[NRRD_DATA_FILE];
    struct import_pattern pattern;
    p->samples->start = p->text->end;
    if (!value)
        return true;
    if (!*value)
        return REFUSE(p, SP_ERR_FORMAT, NRRD_DATA_FILE, "names no file");
    if (p->text->list) {
        long long subdim = 0;
        if (value[4] &&
            !import_integer(value + 4 + strspn(value + 4, " "), 1, p->text->dimension, &subdim))
            return REFUSE(p, SP_ERR_FORMAT, NRRD_DATA_FILE,
                          "LIST must be followed by a number of axes in [1, %u] or by nothing",
                          p->text->dimension);
        return add_list(p) && check_pieces(p, subdim);
    }
    if (import_pattern_parse(value, &pattern))
        return add_pattern(p, &pattern) && check_pieces(p, pattern.subdim);
    return add_name(p, value, strlen(value));
}

static void close_nrrd(void *reader) {
    struct nrrd *n = reader;
    import_samples_finish(&n->sampled.samples);
    free(n->times);
}

/* Returns the field that gave the bad part of the grid. */
static enum nrrd_field field_at_fault(const struct parsing *p) {
    char *const *value = p->text->value;
    bool directed = value[NRRD_SPACE_DIRECTIONS] != NULL;
    enum nrrd_field spacing = directed                ? NRRD_SPACE_DIRECTIONS
                              : value[NRRD_SPACINGS]  ? NRRD_SPACINGS
                              : value[NRRD_AXIS_MAXS] ? NRRD_AXIS_MAXS
                                                      : NRRD_SIZES;
    switch (sp_grid_invalid_field(&p->header->grid)) {
    case SP_GRID_SPACING:
        return spacing;
    case SP_GRID_DIRECTION:
        return NRRD_SPACE_DIRECTIONS;
    case SP_GRID_ORIGIN:
        return value[NRRD_SPACE_ORIGIN] ? NRRD_SPACE_ORIGIN
               : value[NRRD_AXIS_MINS]  ? NRRD_AXIS_MINS
                                        : spacing;
    default:
        return NRRD_SIZES;
    }
}

/* The number of the step or component that is read, along an axis. */
static uint64_t chosen_of(const struct parsing *p, unsigned axis, unsigned component) {
    const enum nrrd_role role = p->text->role[axis];
    return role == NRRD_TIME                              ? p->file->step
           : role == NRRD_COLOR || role == NRRD_COMPONENT ? component
                                                          : 0;
}

/* Components along an axis before the spatial axes alternate in the file; along a later axis they
 * follow one another. */
static bool choose_blocks(const struct parsing *p, unsigned component) {
    const struct nrrd_header *h = p->text;
    struct import_samples *s = p->samples;
    struct import_conversion *c = p->conversion;
    uint64_t components = 1, blocks = 1, number = 0, block = 0;
    for (unsigned axis = h->dimension; axis-- > 0;) {
        if (h->role[axis] == NRRD_PART || h->role[axis] == NRRD_DOMAIN ||
            h->role[axis] == NRRD_VECTOR)
            continue;
        uint64_t *count = axis < h->first ? &components : &blocks;
        uint64_t *chosen = axis < h->first ? &number : &block;
        *count *= h->sizes[axis];
        *chosen = *chosen * h->sizes[axis] + chosen_of(p, axis, component);
    }
    if (components * s->number.size > IMPORT_STREAM_CHUNK)
        return REFUSE(p, SP_ERR_UNSUPPORTED, NRRD_SIZES,
                      "%" PRIu64 " numbers per sample are too many", components);
    c->components = (unsigned)components;
    c->component = (unsigned)number;
    s->is_vectors = h->vectors >= 0;
    s->is_planar = h->vectors >= (int)(h->first + h->axes);
    s->conversion = s->is_vectors || import_conversion_is_copy(c) ? NULL : c;
    s->bytes = p->header->bytes / sp_type_size(p->header->type) * components * s->number.size;
    s->bytes *= s->is_vectors ? 3 : 1;
    return import_samples_choose_block(s, blocks, block) ||
           REFUSE(p, SP_ERR_UNSUPPORTED, NRRD_DATA_FILE,
                  "a file holds parts of several time steps or components");
}

/* The times that a program gives in keys of its own. */
static bool set_times(const struct parsing *p, uint64_t count) {
    const struct nrrd_header *h = p->text;
    *p->times = malloc(count * sizeof **p->times);
    if (!*p->times)
        return sp_fail(p->err, SP_ERR_MEMORY, p->file->title, "out of memory for the times");
    if (!nrrd_keys_read_times(h, *p->times, count)) {
        import_warn(p->file->warnings,
                    "The times of the steps (%.80s) are not %" PRIu64
                    " rising numbers; the steps are numbered.",
                    h->times, count);
        return true;
    }
    p->header->steps.times = *p->times;
    snprintf(p->header->steps.unit, SP_UNIT_BYTES, "%.*s", SP_UNIT_BYTES - 1,
             h->times_unit ? h->times_unit : h->time_unit);
    return true;
}

static bool set_steps(const struct parsing *p) {
    const struct nrrd_header *h = p->text;
    const int axis = h->time;
    if (axis < 0)
        return true;
    if (!import_header_use_steps(p->header, p->file, h->sizes[axis], p->err))
        return false;
    if (h->sizes[axis] > 1 && h->times)
        return set_times(p, h->sizes[axis]);
    if (h->sizes[axis] > 1)
        import_header_use_interval(p->header, isfinite(h->min[axis]) ? h->min[axis] : 0,
                                   h->spacing[axis], h->time_unit);
    return true;
}

/* What the samples are. Returns the number of the component that is read. */
static unsigned describe_values(const struct parsing *p) {
    const struct nrrd_header *h = p->text;
    const char *name = h->value[NRRD_CONTENT] ? h->value[NRRD_CONTENT] : "";
    *p->conversion = import_conversion_of(h->number, p->file->warnings);
    p->header->type = p->conversion->type;
    p->header->used_as = h->used_as;
    if (h->segments.are_there && h->number.kind <= IMPORT_UNSIGNED)
        p->header->meaning = SP_MEANING_LABELS;
    if (h->vectors >= 0) {
        import_header_add_vectors(p->header, name);
        import_header_use_vectors(p->header, p->file->field);
    } else if (h->components >= 0 && h->sizes[h->components] > 1) {
        return import_meaning_choose_component(
            p->file, p->header, (unsigned)h->sizes[h->components],
            h->role[h->components] == NRRD_COLOR ? IMPORT_AS_RGB : IMPORT_AS_CHANNELS,
            h->role[h->components] == NRRD_COLOR ? NULL : h->names);
    } else {
        import_name(p->header->value_name,
                    *name || !h->segments.layer_count ? name : h->segments.layer_names[0]);
    }
    return 0;
}

static bool build(const struct parsing *p) {
    struct import_samples *s = p->samples;
    const unsigned component = describe_values(p);
    s->encoding = p->text->encoding;
    s->big_endian = p->text->big_endian;
    if (!set_geometry(p) || !set_steps(p) || !parse_skips(p) || !add_data_files(p))
        return false;
    char place[SP_ERROR_PLACE];
    enum nrrd_field field = field_at_fault(p);
    import_place(place, p->file->title, p->text->byte[field], nrrd_field_name(field));
    if (!sp_grid_check(&p->header->grid, p->header->type, place, &p->header->bytes, p->err))
        return false;
    s->file = p->file;
    s->number = p->text->number;
    s->field = "sizes";
    return choose_blocks(p, component) && import_samples_check(s, p->err);
}

static bool open_nrrd(void *reader, const struct import_file *file, struct import_header *header,
                      struct sp_error *err) {
    struct nrrd *n = reader;
    struct nrrd_header text;
    if (!nrrd_header_read(file, &text, err))
        return false;
    const struct parsing p = { .file = file,
                               .text = &text,
                               .header = header,
                               .samples = &n->sampled.samples,
                               .conversion = &n->sampled.conversion,
                               .times = &n->times,
                               .err = err };
    const bool ok = build(&p);
    nrrd_header_finish(&text);
    return ok;
}

const struct import_format import_nrrd = { .name = "NRRD",
                                           .probe = probe,
                                           .reader_size = sizeof(struct nrrd),
                                           .open = open_nrrd,
                                           .read = import_sampled_read,
                                           .close = close_nrrd };
