/* SPDX-License-Identifier: Apache-2.0
 *
 * The description that tifffile writes: the shape of an array. Its last dimensions form a page; the
 * others number the pages. The letters of the axes decide what a dimension is, not how it is
 * stored: {"shape": [3, 32, 48], "axes": "ZYX"} may be one page with three samples.
 */
#include <ctype.h>
#include <inttypes.h>
#include <jansson.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "data/import/tiff_planes.h"

enum { RANK_MAX = 16, PAGE_RANK_MAX = 3 };

enum role { ROLE_Z, ROLE_C, ROLE_T, ROLE_COUNT };

struct dimension {
    uint64_t size;
    char letter; /* 0 = it has no name */
    enum role role;
};

/* What a dimension within a page is. */
enum part { PART_SAMPLES, PART_ROWS, PART_COLUMNS, PART_COUNT };

struct shaped {
    const struct tiff_file *tiff;
    unsigned rank; /* dimensions longer than 1 */
    unsigned own;  /* of these, how many count planes; the others lie within one */
    struct dimension dimensions[RANK_MAX];
    char letters[PART_COUNT]; /* of the dimensions of a page; 0 = it has no name */
    uint64_t pages;
    unsigned split; /* as in struct tiff_planes */
};

bool tiff_is_shaped(const char *description) {
    return strncmp(description, "{\"shape\":", 9) == 0;
}

static bool parse_shape(struct shaped *s, const json_t *shape, const char *axes,
                        struct sp_error *err) {
    const size_t rank = json_array_size(shape);
    const bool are_named = strlen(axes) == rank;
    if (rank < 1 || rank > RANK_MAX)
        return tiff_fail(s->tiff, 0, err, SP_ERR_FORMAT,
                         "the shape in the description has %zu dimensions, outside [1, %d]", rank,
                         RANK_MAX);
    if (*axes && !are_named)
        import_warn(
            s->tiff->file->warnings,
            "The description names the axes \"%.20s\", but its shape has %zu dimensions; the "
            "names were ignored.",
            axes, rank);
    for (size_t d = 0; d < rank; d++) {
        const json_int_t size = json_integer_value(json_array_get(shape, d));
        if (size < 1 || size > UINT32_MAX)
            return tiff_fail(s->tiff, 0, err, SP_ERR_FORMAT,
                             "dimension %zu of the shape in the description must be in [1, 2^32)",
                             d);
        if (size > 1)
            s->dimensions[s->rank++] =
                (struct dimension){ .size = (uint64_t)size,
                                    .letter =
                                        (char)(are_named ? toupper((unsigned char)axes[d]) : 0) };
    }
    return true;
}

/* Lists the dimensions of a page that are longer than 1, the fastest last. */
static unsigned list_parts(const struct tiff_page *page, enum part parts[PAGE_RANK_MAX],
                           uint64_t sizes[PAGE_RANK_MAX]) {
    const uint64_t all[PART_COUNT] = { page->samples, page->height, page->width };
    static const enum part planes[] = { PART_SAMPLES, PART_ROWS, PART_COLUMNS },
                           pixels[] = { PART_ROWS, PART_COLUMNS, PART_SAMPLES };
    unsigned count = 0;
    for (int i = 0; i < PAGE_RANK_MAX; i++) {
        const enum part part = (page->planes > 1 ? planes : pixels)[i];
        if (all[part] > 1) {
            parts[count] = part;
            sizes[count++] = all[part];
        }
    }
    return count;
}

/* Matches the dimensions that form a page: the last ones, or else as many as have its samples. */
static bool match_page(struct shaped *s, struct sp_error *err) {
    const struct tiff_page *page = &s->tiff->pages[0];
    const uint64_t needed = (uint64_t)page->width * page->height * page->samples;
    enum part parts[PAGE_RANK_MAX];
    uint64_t sizes[PAGE_RANK_MAX], product = 1;
    const unsigned count = list_parts(page, parts, sizes);
    s->own = s->rank;
    while (s->own > 0 && product < needed)
        product *= s->dimensions[--s->own].size;
    if (product != needed)
        return tiff_fail(s->tiff, 0, err, SP_ERR_FORMAT,
                         "the shape in the description does not end with the %" PRIu32 " x %" PRIu32
                         " pixels of %u samples of the page",
                         page->height, page->width, page->samples);
    bool is_same = s->rank - s->own == count;
    for (unsigned i = 0; i < count && is_same; i++)
        is_same = s->dimensions[s->own + i].size == sizes[i];
    for (unsigned i = 0; i < count && is_same; i++)
        s->letters[parts[i]] = s->dimensions[s->own + i].letter;
    s->pages = 1;
    for (unsigned d = 0; d < s->own; d++) {
        if (s->dimensions[d].size > UINT32_MAX / s->pages / page->samples)
            return tiff_fail(s->tiff, 0, err, SP_ERR_FORMAT,
                             "the shape in the description has more than 2^32 planes");
        s->pages *= s->dimensions[d].size;
    }
    return true;
}

/* tifffile may store three or four slices, or steps, as the samples of a pixel. */
static bool split_samples(struct shaped *s, struct tiff_planes *p, struct sp_error *err) {
    const char letter = s->letters[PART_SAMPLES];
    if (letter == 'X' || letter == 'Y')
        return tiff_fail(s->tiff, 0, err, SP_ERR_UNSUPPORTED,
                         "the description calls the samples of a pixel %c; save the array with "
                         "photometric='minisblack'",
                         letter);
    p->are_channels = letter == 'C';
    if (!letter || letter == 'C' || letter == 'S')
        return true;
    s->split = s->tiff->pages[0].samples;
    s->dimensions[s->own++] =
        (struct dimension){ .size = s->tiff->pages[0].samples, .letter = letter };
    return true;
}

/* Columns, rows and slices lie along x, y and z, unless the description names other axes. Sets the
 * directions if so. Returns the letter of the axis of slices. */
static char set_directions(const struct shaped *s, struct tiff_planes *p) {
    static const char letters[] = "XYZ";
    const char of_columns = s->letters[PART_COLUMNS], of_rows = s->letters[PART_ROWS];
    const char *columns = of_columns ? strchr(letters, of_columns) : NULL;
    const char *rows = of_rows ? strchr(letters, of_rows) : NULL;
    if (!columns || !rows || columns == rows || (of_columns == 'X' && of_rows == 'Y'))
        return 'Z';
    const ptrdiff_t axes[3] = { columns - letters, rows - letters,
                                3 - (columns - letters) - (rows - letters) };
    for (int a = 0; a < 3; a++)
        p->direction[axes[a]][a] = 1;
    p->has_place = true;
    return letters[axes[2]];
}

/* Axes without a name are z, channels and time, the last one first. Samples, exposures (L) and
 * wavelengths (E) are channels, because they are no space. */
static bool assign_roles(struct shaped *s, char slices, struct sp_error *err) {
    const char letters[] = { slices, 'C', 'T' };
    bool is_taken[ROLE_COUNT] = { false }, is_set[RANK_MAX] = { false };
    for (unsigned d = 0; d < s->own; d++) {
        const char letter_of = s->dimensions[d].letter;
        const char own = letter_of && strchr("SLE", letter_of) ? 'C' : letter_of;
        const char *letter = own ? memchr(letters, own, ROLE_COUNT) : NULL;
        if (letter && !is_taken[letter - letters]) {
            s->dimensions[d].role = (enum role)(letter - letters);
            is_taken[s->dimensions[d].role] = is_set[d] = true;
        }
    }
    for (unsigned d = s->own; d-- > 0;) {
        enum role role = ROLE_Z;
        while (!is_set[d] && role < ROLE_COUNT && is_taken[role])
            role++;
        if (role == ROLE_COUNT)
            return tiff_fail(s->tiff, 0, err, SP_ERR_UNSUPPORTED,
                             "the description has more dimensions than z, channels and time; save "
                             "parts of it as files of their own");
        if (!is_set[d]) {
            s->dimensions[d].role = role;
            is_taken[role] = true;
        }
    }
    return true;
}

static bool assign_planes(const struct shaped *s, struct tiff_planes *p, struct sp_error *err) {
    uint32_t *const sizes[ROLE_COUNT] = { &p->slices, &p->channels, &p->steps };
    const uint32_t pages = s->tiff->count, per_page = s->split ? s->split : 1;
    for (unsigned d = 0; d < s->own; d++)
        *sizes[s->dimensions[d].role] = (uint32_t)s->dimensions[d].size;
    const bool is_hidden = s->pages > pages && tiff_planes_hide(p, s->tiff, s->pages);
    const uint64_t there = is_hidden || s->pages < pages ? s->pages : pages;
    p->split = s->split;
    if (!tiff_planes_allocate(p, s->tiff->file, (uint32_t)(there * per_page), err))
        return false;
    for (uint64_t i = 0; i < there * per_page; i++) {
        uint64_t rest = i, at[ROLE_COUNT] = { 0 };
        for (unsigned d = s->own; d-- > 0; rest /= s->dimensions[d].size)
            at[s->dimensions[d].role] = rest % s->dimensions[d].size;
        p->pages[(at[ROLE_T] * p->channels + at[ROLE_C]) * p->slices + at[ROLE_Z]] = (uint32_t)i;
    }
    if (s->pages < pages)
        import_warn(s->tiff->file->warnings,
                    "Only the first array of the file, of %" PRIu64 " pages, was read; %" PRIu64
                    " more pages were left out.",
                    s->pages, pages - s->pages);
    return true;
}

bool tiff_shaped_parse(struct tiff_planes *p, const struct tiff_file *tiff, const char *description,
                       struct sp_error *err) {
    struct shaped s = { .tiff = tiff };
    json_error_t why;
    json_t *json = json_loads(description, 0, &why);
    if (!json_is_object(json)) {
        json_decref(json);
        return tiff_fail(tiff, 0, err, SP_ERR_FORMAT, "the description of tifffile is not JSON: %s",
                         why.text);
    }
    const char *axes = json_string_value(json_object_get(json, "axes"));
    const double interval = json_number_value(json_object_get(json, "finterval"));
    const double spacing = json_number_value(json_object_get(json, "spacing"));
    const char *unit = json_string_value(json_object_get(json, "unit"));
    p->slices = p->channels = p->steps = 1;
    p->interval = interval > 0 ? interval : 0;
    p->spacing[2] = spacing > 0 ? spacing : 0;
    snprintf(p->unit, sizeof p->unit, "%.31s", unit ? unit : "");
    const bool ok = parse_shape(&s, json_object_get(json, "shape"), axes ? axes : "", err) &&
                    match_page(&s, err) && split_samples(&s, p, err) &&
                    assign_roles(&s, set_directions(&s, p), err) && assign_planes(&s, p, err);
    json_decref(json);
    return ok;
}
