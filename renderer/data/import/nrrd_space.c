/* SPDX-License-Identifier: Apache-2.0
 *
 * The fields of a NRRD header that place the samples and the vectors in a space.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "data/import/nrrd_header.h"

#define REFUSE(code, field, ...) NRRD_FAIL(err, code, file, h, field, __VA_ARGS__)

/* True for an axis of the volume; false for the axes of components and of time steps. */
static bool is_spatial(const struct nrrd_header *h, unsigned axis) {
    return axis >= h->first && axis < h->first + h->axes;
}

/* The dimension of the space in which vectors live. Some writers leave it out: it is then the
 * number of components of the first vector. 0 = there is no space. */
static bool parse_space(const struct import_file *file, struct nrrd_header *h,
                        struct sp_error *err) {
    enum { ANATOMICAL = 3 };
    static const struct {
        const char *name, *alias;
    } names[] = {
        { "right-anterior-superior", "RAS" }, { "left-anterior-superior", "LAS" },
        { "left-posterior-superior", "LPS" }, /* the anatomical spaces come first */
        { "scanner-xyz", "scanner-xyz" },     { "3D-right-handed", "3DRH" },
        { "3D-left-handed", "3DLH" },
    };
    const char *name = h->value[NRRD_SPACE], *text = h->value[NRRD_SPACE_DIMENSION];
    const char *first =
        h->value[NRRD_SPACE_DIRECTIONS] ? strchr(h->value[NRRD_SPACE_DIRECTIONS], '(') : NULL;
    enum nrrd_field field = name ? NRRD_SPACE : text ? NRRD_SPACE_DIMENSION : NRRD_SPACE_DIRECTIONS;
    uint64_t space = 0;
    if (name && text)
        return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_DIMENSION, "the field space excludes this field");
    if (name) {
        for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
            size_t n = strlen(names[i].name);
            if (strcasecmp(name, names[i].name) == 0 || strcasecmp(name, names[i].alias) == 0) {
                space = 3;
                if (i < ANATOMICAL)
                    memcpy(h->anatomy, names[i].alias, sizeof h->anatomy);
            } else if (strncasecmp(name, names[i].name, n) == 0 &&
                       strcasecmp(name + n, "-time") == 0)
                space = 4;
        }
        if (space == 0)
            return REFUSE(SP_ERR_FORMAT, NRRD_SPACE, "\"%.40s\" is not a space of NRRD", name);
    } else if (text) {
        if (!nrrd_parse_whole(&text, 8, &space) || *text || space == 0)
            return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_DIMENSION,
                          "\"%.40s\" is not a number in [1, 8]", h->value[NRRD_SPACE_DIMENSION]);
    } else if (first) {
        space = 1;
        for (const char *c = first; *c && *c != ')'; c++)
            space += *c == ',';
    }
    const bool has_more = space == 4 && h->apart >= 0;
    if (space != 0 && ((space > 3 && !has_more) || space < h->axes))
        return REFUSE(SP_ERR_UNSUPPORTED, field,
                      "a space of %" PRIu64
                      " dimensions for %u axes; 3 are supported, and 4 with time "
                      "steps or components",
                      space, h->axes);
    h->space = (unsigned)space;
    return true;
}

/* "(1,0,0)", with `count` components. */
static bool parse_vector(const char **text, unsigned count, double *out) {
    const char *t = *text;
    if (*t != '(')
        return false;
    t = nrrd_skip_blanks(t + 1);
    for (unsigned i = 0; i < count; i++) {
        if (!nrrd_parse_number(&t, ",)", &out[i]) || *t != (i + 1 < count ? ',' : ')'))
            return false;
        t = nrrd_skip_blanks(t + 1);
    }
    *text = t;
    return true;
}

/* Splits a space of four dimensions: the last dimension belongs to the axis of time or of
 * components alone. */
static bool split_space(const struct import_file *file, struct nrrd_header *h,
                        struct sp_error *err) {
    for (unsigned axis = 0; h->space == 4 && axis < h->dimension; axis++) {
        const double *v = h->direction[axis];
        const bool is_apart = (int)axis == h->apart;
        if (is_apart ? v[0] != 0 || v[1] != 0 || v[2] != 0 : v[3] != 0)
            return REFUSE(SP_ERR_UNSUPPORTED, NRRD_SPACE_DIRECTIONS,
                          "vector %u points along space and time (or components); only one of them "
                          "is supported",
                          axis + 1);
        if (is_apart)
            h->spacing[axis] = v[3];
    }
    return true;
}

static bool parse_directions(const struct import_file *file, struct nrrd_header *h,
                             struct sp_error *err) {
    const char *text = h->value[NRRD_SPACE_DIRECTIONS];
    if (!text)
        return true;
    for (unsigned axis = 0; axis < h->dimension; axis++) {
        bool is_none = strncasecmp(text, "none", 4) == 0;
        if (is_none && !is_spatial(h, axis)) {
            text = nrrd_skip_blanks(text + 4);
            continue;
        }
        if (is_none || !*text)
            return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_DIRECTIONS,
                          is_none ? "axis %u has no direction" : "has %u vectors, too few", axis);
        if (!parse_vector(&text, h->space, h->direction[axis]))
            return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_DIRECTIONS,
                          "vector %u is not of the form (x,y,z) with %u numbers", axis + 1,
                          h->space);
    }
    if (*text)
        return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_DIRECTIONS, "has more than %u vectors",
                      h->dimension);
    if (!split_space(file, h, err))
        return false;
    for (unsigned axis = h->first; axis < h->first + h->axes; axis++)
        if (isfinite(h->spacing[axis]) || isfinite(h->min[axis]) || isfinite(h->max[axis]))
            return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_DIRECTIONS,
                          "axis %u also has a spacing, axis min or axis max; remove one of them",
                          axis);
    return true;
}

static bool parse_origin(const struct import_file *file, struct nrrd_header *h,
                         struct sp_error *err) {
    const char *text = h->value[NRRD_SPACE_ORIGIN];
    if (!text)
        return true;
    if (h->space == 0)
        return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_ORIGIN, "needs the field space");
    if (!parse_vector(&text, h->space, h->origin) || *text)
        return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_ORIGIN,
                      "\"%.40s\" is not of the form (x,y,z) with %u numbers",
                      h->value[NRRD_SPACE_ORIGIN], h->space);
    for (unsigned i = 0; i < h->space; i++)
        if (!isfinite(h->origin[i]))
            return REFUSE(SP_ERR_FORMAT, NRRD_SPACE_ORIGIN, "number %u is not a number", i);
    if (h->space == 4)
        h->min[h->apart] = h->origin[3];
    return true;
}

/* One quoted string per axis, "mm" "mm" "mm", all equal or empty. */
static bool parse_units(const struct import_file *file, struct nrrd_header *h,
                        enum nrrd_field field, struct sp_error *err) {
    const char *text = h->value[field];
    unsigned count = field == NRRD_UNITS ? h->dimension : h->space;
    if (!text)
        return true;
    if (count == 0)
        return REFUSE(SP_ERR_FORMAT, field, "needs the field space");
    for (unsigned axis = 0; axis < count; axis++) {
        char unit[NRRD_VALUE_MAX + 1];
        size_t n = 0;
        if (*text++ != '"')
            return REFUSE(SP_ERR_FORMAT, field, "needs %u strings in quotation marks", count);
        for (; *text && *text != '"'; text++) {
            if (*text == '\\' && text[1])
                text++;
            unit[n++] = *text;
        }
        unit[n] = 0;
        if (*text != '"')
            return REFUSE(SP_ERR_FORMAT, field, "string %u has no closing quotation mark",
                          axis + 1);
        text = nrrd_skip_blanks(text + 1);
        const bool is_time = field == NRRD_UNITS ? !is_spatial(h, axis) : axis == 3;
        if (is_time && (field != NRRD_UNITS || (int)axis == h->time))
            snprintf(h->time_unit, sizeof h->time_unit, "%.*s", SP_UNIT_BYTES - 1, unit);
        if (n == 0 || is_time)
            continue;
        if (n >= SP_UNIT_BYTES)
            return REFUSE(SP_ERR_FORMAT, field, "a unit has at most %d bytes", SP_UNIT_BYTES - 1);
        if (h->unit[0] && strcmp(h->unit, unit) != 0)
            return REFUSE(SP_ERR_UNSUPPORTED, field,
                          "\"%.30s\" and \"%.30s\" differ; all axes must have one unit", h->unit,
                          unit);
        memcpy(h->unit, unit, n + 1);
    }
    return !*text || REFUSE(SP_ERR_FORMAT, field, "has more than %u strings", count);
}

/* "(1,0,0) (0,1,0) (0,0,1)": the axes along which vectors were measured, in the space. */
static bool parse_frame(const struct import_file *file, struct nrrd_header *h,
                        struct sp_error *err) {
    const char *text = h->value[NRRD_MEASUREMENT_FRAME];
    if (!text || h->vectors < 0)
        return true;
    if (h->space < 3)
        return REFUSE(SP_ERR_FORMAT, NRRD_MEASUREMENT_FRAME, "needs a space of 3 dimensions");
    for (unsigned column = 0; column < 3; column++) {
        double v[3];
        if (!parse_vector(&text, 3, v))
            return REFUSE(SP_ERR_FORMAT, NRRD_MEASUREMENT_FRAME,
                          "vector %u is not of the form (x,y,z)", column + 1);
        for (int row = 0; row < 3; row++) {
            if (!isfinite(v[row]))
                return REFUSE(SP_ERR_FORMAT, NRRD_MEASUREMENT_FRAME,
                              "vector %u holds something else than numbers", column + 1);
            h->frame[row][column] = v[row];
        }
    }
    return !*text || REFUSE(SP_ERR_FORMAT, NRRD_MEASUREMENT_FRAME, "has more than 3 vectors");
}

bool nrrd_space_read(const struct import_file *file, struct nrrd_header *h, struct sp_error *err) {
    return parse_space(file, h, err) && parse_directions(file, h, err) &&
           parse_frame(file, h, err) && parse_origin(file, h, err) &&
           parse_units(file, h, NRRD_UNITS, err) && parse_units(file, h, NRRD_SPACE_UNITS, err);
}
