/* SPDX-License-Identifier: Apache-2.0
 *
 * The description that ImageJ writes into its TIFF: one KEY=VALUE per line. What a key means is
 * defined by ImageJ's ij/io/Opener, FileOpener and measure/Calibration.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "data/import/tiff_planes.h"
#include "data/volume/unit.h"

enum { VALUE_BYTES = 64 };

struct imagej {
    struct tiff_planes *planes;
    const struct tiff_file *tiff;
    const char *description;
    struct sp_error *err;
    long images, channels, slices, frames;
};

bool tiff_is_imagej(const char *description) {
    return strncmp(description, "ImageJ=", 7) == 0;
}

/* Finds a line "KEY=VALUE". NULL if there is none. */
static const char *find_value(const struct imagej *j, const char *key, char out[VALUE_BYTES]) {
    const size_t n = strlen(key);
    for (const char *line = j->description; *line; line += *line == '\n') {
        size_t length = strcspn(line, "\n");
        const char *next = line + length;
        while (length > 0 && strchr(" \t\r", line[length - 1]))
            length--;
        if (length > n && strncmp(line, key, n) == 0 && line[n] == '=') {
            snprintf(out, VALUE_BYTES, "%.*s", (int)(length - n - 1), line + n + 1);
            return out;
        }
        line = next;
    }
    return NULL;
}

static long read_count(const struct imagej *j, const char *key, long missing) {
    char value[VALUE_BYTES];
    return find_value(j, key, value) ? strtol(value, NULL, 10) : missing;
}

/* 0 if there is none, or if it is no number. */
static double read_number(const struct imagej *j, const char *key) {
    char value[VALUE_BYTES];
    const double number = find_value(j, key, value) ? strtod(value, NULL) : 0;
    return isfinite(number) ? number : 0;
}

/* Finds a unit of length. "" = pixels, or none. */
static bool find_unit(const struct imagej *j, const char *key, char out[SP_UNIT_BYTES]) {
    /* As Java escapes them, in Latin-1, and as UTF-8 that was encoded twice. */
    static const char *const known[][2] = { { "\\u00B5m", "um" }, { "\\u00b5m", "um" },
                                            { "\xb5m", "um" },    { "\xc3\x82\xc2\xb5m", "um" },
                                            { "\\u00C5", "A" },   { "\xc5", "A" },
                                            { "inches", "in" },   { "pixel", "" },
                                            { "pixels", "" },     { "null", "" } };
    char value[VALUE_BYTES];
    if (!find_value(j, key, value))
        return false;
    const struct sp_unit *unit = sp_unit_find(value);
    snprintf(out, SP_UNIT_BYTES, "%.31s", unit ? unit->symbol : value);
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (strcmp(value, known[i][0]) == 0)
            snprintf(out, SP_UNIT_BYTES, "%s", known[i][1]);
    return true;
}

/* Converts y or z, whose unit may differ from the unit of x. */
static void convert_axis(const struct imagej *j, int axis, const char *key) {
    char own[SP_UNIT_BYTES];
    if (find_unit(j, key, own))
        tiff_planes_convert(j->planes, j->tiff->file, axis, own);
}

/* If ImageJ gives no unit, the unit of the tags is used, also for slices. */
static void read_spacing(const struct imagej *j) {
    enum { INCHES = 2, CENTIMETRES = 3 };
    struct tiff_planes *p = j->planes;
    double x, y, tag, factor = 1;
    char value[VALUE_BYTES];
    p->spacing[2] = fabs(read_number(j, "spacing"));
    const bool has_resolution = tiff_resolution(j->tiff, &j->tiff->pages[0], &x, &y, &tag);
    p->has_own_unit = find_unit(j, "unit", p->unit);
    if (!has_resolution)
        return;
    if (!p->has_own_unit && (tag == INCHES || tag == CENTIMETRES)) {
        factor = tag == INCHES ? 25.4 : 10;
        p->spacing[2] *= factor;
        snprintf(p->unit, sizeof p->unit, "mm");
    } else if (tag == CENTIMETRES && find_value(j, "unit", value) && strcmp(value, "um") == 0) {
        factor = 1e4; /* ImageJ does the same: "um" is only what it shows */
    }
    p->spacing[0] = factor / x;
    p->spacing[1] = factor / y;
    convert_axis(j, 1, "yunit");
    convert_axis(j, 2, "zunit");
}

/* Origins are places in the image [px]. */
static void read_place(const struct imagej *j) {
    static const char *const keys[3] = { "xorigin", "yorigin", "zorigin" };
    struct tiff_planes *p = j->planes;
    char value[VALUE_BYTES];
    const bool is_upward = find_value(j, "inverty", value) && strcmp(value, "true") == 0;
    double at[3];
    for (int a = 0; a < 3; a++)
        at[a] = -read_number(j, keys[a]);
    if (is_upward)
        at[1] = at[1] != 0 ? -at[1] : j->tiff->pages[0].height - 1.0;
    p->has_place = at[0] != 0 || at[1] != 0 || at[2] != 0;
    for (int a = 0; a < 3 && p->has_place; a++) {
        const double spacing = p->spacing[a] > 0   ? p->spacing[a]
                               : p->spacing[0] > 0 ? p->spacing[0]
                                                   : 1;
        p->origin[a] = at[a] * spacing;
        p->direction[a][a] = a == 1 && is_upward ? -1 : 1;
    }
}

/* value = c0 + c1 · number. ImageJ keeps 16-bit numbers with a sign as number + 32768. */
static void read_scale(const struct imagej *j) {
    enum { STRAIGHT_LINE = 0, NONE = 20, SIGNED = 2 };
    struct tiff_planes *p = j->planes;
    const struct tiff_page *page = &j->tiff->pages[0];
    char value[VALUE_BYTES], c0[VALUE_BYTES], c1[VALUE_BYTES];
    const char *unit = find_value(j, "vunit", value);
    if (unit && strcasecmp(unit, "gray value") != 0)
        snprintf(p->value_unit, sizeof p->value_unit, "%.31s", unit);
    const long function = read_count(j, "cf", NONE);
    if (!unit || page->bits > 16 || page->samples > 1 || function == NONE)
        return; /* as ImageJ does */
    const double offset = read_number(j, "c0"), slope = read_number(j, "c1");
    if (function != STRAIGHT_LINE || !find_value(j, "c0", c0) || !find_value(j, "c1", c1) ||
        slope == 0) {
        p->value_unit[0] = 0;
        import_warn(j->tiff->file->warnings,
                    "The calibration of ImageJ is no straight line (cf=%ld, c1=%g), and it was not "
                    "applied: the samples are the numbers of the file.",
                    function, slope);
        return;
    }
    const bool is_shifted = page->bits == 16 && page->format == SIGNED;
    p->has_scale = true;
    p->slope = slope;
    p->offset = offset + (is_shifted ? 32768 * slope : 0);
    if (find_value(j, "zeroclip", value) && strcmp(value, "true") == 0)
        import_warn(j->tiff->file->warnings,
                    "ImageJ shows calibrated values below 0 as 0; here they are kept.");
}

static void read_times(const struct imagej *j) {
    static const char *const known[][2] = { { "sec", "s" },       { "seconds", "s" },
                                            { "second", "s" },    { "msec", "ms" },
                                            { "minutes", "min" }, { "hour", "h" },
                                            { "hours", "h" } };
    struct tiff_planes *p = j->planes;
    char value[VALUE_BYTES] = "s";
    p->interval = fmax(read_number(j, "finterval"), 0);
    find_value(j, "tunit", value);
    snprintf(p->time_unit, sizeof p->time_unit, "%.31s", value);
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (strcmp(value, known[i][0]) == 0)
            snprintf(p->time_unit, sizeof p->time_unit, "%s", known[i][1]);
}

/* Colours of a pixel are channels without pages of their own. Frames without slices are read as
 * slices if no time is between them: many programs write stacks like that. */
static bool check_counts(struct imagej *j) {
    const struct tiff_page *page = &j->tiff->pages[0];
    const bool is_sane = j->channels >= 1 && j->slices >= 1 && j->frames >= 1;
    const double product = (double)j->channels * (double)j->slices * (double)j->frames;
    if (page->samples > 1 && j->channels == (long)page->samples && product != (double)j->images)
        j->channels = 1;
    if (j->channels <= 1 && (j->frames <= 1 || j->slices <= 1)) {
        const bool are_times = j->frames == j->images && j->planes->interval > 0;
        if (j->frames > 1 && !are_times)
            import_warn(j->tiff->file->warnings,
                        "ImageJ calls the %ld images frames without a time between them; they are "
                        "read as slices. ?as=time makes them steps.",
                        j->images);
        j->channels = 1;
        j->slices = are_times ? 1 : j->images;
        j->frames = are_times ? j->images : 1;
    }
    return (is_sane &&
            (double)j->channels * (double)j->slices * (double)j->frames == (double)j->images) ||
           tiff_fail(j->tiff, 0, j->err, SP_ERR_FORMAT,
                     "ImageJ declares %ld channels, %ld slices and %ld frames in %ld images; "
                     "save it again with ImageJ",
                     j->channels, j->slices, j->frames, j->images);
}

/* Channels are the fastest in a hyperstack, then slices. */
static bool assign_planes(const struct imagej *j) {
    struct tiff_planes *p = j->planes;
    p->slices = (uint32_t)j->slices;
    p->channels = (uint32_t)j->channels;
    p->steps = (uint32_t)j->frames;
    if (!tiff_planes_allocate(p, j->tiff->file, (uint32_t)j->images, j->err))
        return false;
    for (uint32_t i = 0; i < (uint32_t)j->images; i++) {
        const uint32_t c = i % p->channels, kt = i / p->channels;
        const uint32_t k = kt % p->slices, step = kt / p->slices;
        p->pages[((size_t)step * p->channels + c) * p->slices + k] = i;
    }
    return true;
}

bool tiff_imagej_parse(struct tiff_planes *p, const struct tiff_file *t, const char *description,
                       struct sp_error *err) {
    struct imagej j = { .planes = p, .tiff = t, .description = description, .err = err };
    j.images = read_count(&j, "images", t->count);
    j.channels = read_count(&j, "channels", 1);
    j.slices = read_count(&j, "slices", 1);
    j.frames = read_count(&j, "frames", 1);
    /* Above 4 GB, ImageJ writes the first directory only. */
    if (j.images < 1 || j.images > INT32_MAX ||
        ((uint32_t)j.images != t->count && !tiff_planes_hide(p, t, (uint64_t)j.images)))
        return tiff_fail(t, 0, err, SP_ERR_UNSUPPORTED,
                         "ImageJ declares %ld images, but the file has %" PRIu32
                         " pages, and their pixels do not fit behind the first page; save it again "
                         "with ImageJ, or as NRRD",
                         j.images, t->count);
    p->are_indices = true; /* a palette is a lookup table */
    read_spacing(&j);
    read_place(&j);
    read_scale(&j);
    read_times(&j);
    return check_counts(&j) && assign_planes(&j);
}
