/* SPDX-License-Identifier: Apache-2.0
 *
 * The description that tifffile writes: the shape of an array whose last dimensions are those of a
 * page. Pages are in the order of the others.
 */
#include <inttypes.h>
#include <jansson.h>
#include <stdio.h>
#include <string.h>

#include "import/tiff_planes.h"

enum { RANK_MAX = 16 };

enum role { ROLE_Z, ROLE_C, ROLE_T, ROLE_COUNT };

struct shaped {
    const struct tiff_file *tiff;
    unsigned rank;             /* dimensions before those of a page, without those of length 1 */
    uint64_t sizes[RANK_MAX];  /* of each */
    char letters[RANK_MAX];    /* 0 = it has no name */
    enum role roles[RANK_MAX]; /* of each */
    uint64_t planes;
};

bool tiff_is_shaped(const char *description) {
    return strncmp(description, "{\"shape\":", 9) == 0;
}

/* Takes the dimensions before those of a page. */
static bool take_shape(struct shaped *s, const json_t *shape, const char *axes,
                       struct sp_error *err) {
    const struct tiff_page *page = &s->tiff->pages[0];
    const size_t rank = json_array_size(shape);
    const uint64_t needed = (uint64_t)page->width * page->height * page->samples;
    uint64_t product = 1;
    size_t own = rank; /* dimensions before this one are not those of a page */
    if (rank < 1 || rank > RANK_MAX)
        return tiff_fail(s->tiff, 0, err, SP_ERR_FORMAT,
                         "the shape in the description has %zu dimensions, outside [1, %d]", rank,
                         RANK_MAX);
    for (size_t d = rank; d-- > 0;) {
        const json_int_t size = json_integer_value(json_array_get(shape, d));
        if (size < 1 || size > UINT32_MAX)
            return tiff_fail(s->tiff, 0, err, SP_ERR_FORMAT,
                             "dimension %zu of the shape in the description must be in [1, 2^32)",
                             d);
        if (product < needed) {
            product *= (uint64_t)size;
            own = d;
        }
    }
    s->planes = 1;
    for (size_t d = 0; d < own; d++) {
        const uint64_t size = (uint64_t)json_integer_value(json_array_get(shape, d));
        if (size > UINT32_MAX / s->planes)
            return tiff_fail(s->tiff, 0, err, SP_ERR_FORMAT,
                             "the shape in the description has more than 2^32 planes");
        s->planes *= size;
        if (size > 1) {
            s->letters[s->rank] = strlen(axes) == rank ? axes[d] : 0;
            s->sizes[s->rank++] = size;
        }
    }
    return product == needed ||
           tiff_fail(s->tiff, 0, err, SP_ERR_FORMAT,
                     "the shape in the description does not end with the %" PRIu32 " x %" PRIu32
                     " pixels of %u samples of the page",
                     page->height, page->width, page->samples);
}

/* Axes without a name are z, channels and time, the last one first. */
static bool take_roles(struct shaped *s, struct sp_error *err) {
    static const char letters[] = "ZCT";
    bool is_taken[ROLE_COUNT] = { false }, is_set[RANK_MAX] = { false };
    for (unsigned d = 0; d < s->rank; d++) {
        const char *letter = s->letters[d] ? strchr(letters, s->letters[d]) : NULL;
        if (s->letters[d] == 'S')
            letter = letters + ROLE_C;
        if (letter && !is_taken[letter - letters]) {
            s->roles[d] = (enum role)(letter - letters);
            is_taken[s->roles[d]] = is_set[d] = true;
        }
    }
    for (unsigned d = s->rank; d-- > 0;) {
        enum role role = ROLE_Z;
        while (!is_set[d] && role < ROLE_COUNT && is_taken[role])
            role++;
        if (role == ROLE_COUNT)
            return tiff_fail(s->tiff, 0, err, SP_ERR_UNSUPPORTED,
                             "the description has more dimensions than z, channels and time; save "
                             "parts of it as files of their own");
        if (!is_set[d]) {
            s->roles[d] = role;
            is_taken[role] = true;
        }
    }
    return true;
}

static bool take_planes(const struct shaped *s, struct tiff_planes *p, struct sp_error *err) {
    uint32_t *const sizes[ROLE_COUNT] = { &p->slices, &p->channels, &p->steps };
    const uint32_t pages = s->tiff->count;
    for (unsigned d = 0; d < s->rank; d++)
        *sizes[s->roles[d]] = (uint32_t)s->sizes[d];
    const bool is_hidden = s->planes > pages && tiff_planes_hide(p, s->tiff, s->planes);
    if (!tiff_planes_allocate(p, s->tiff->file, is_hidden ? (uint32_t)s->planes : pages, err))
        return false;
    for (uint64_t i = 0; i < s->planes && (is_hidden || i < pages); i++) {
        uint64_t rest = i, at[ROLE_COUNT] = { 0 };
        for (unsigned d = s->rank; d-- > 0; rest /= s->sizes[d])
            at[s->roles[d]] = rest % s->sizes[d];
        p->pages[(at[ROLE_T] * p->channels + at[ROLE_C]) * p->slices + at[ROLE_Z]] = (uint32_t)i;
    }
    if (s->planes < pages)
        import_warn(s->tiff->file->warnings,
                    "Only the first array of the file, of %" PRIu64 " pages, was read; %" PRIu64
                    " more pages were left out.",
                    s->planes, pages - s->planes);
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
    const bool ok = take_shape(&s, json_object_get(json, "shape"), axes ? axes : "", err) &&
                    take_roles(&s, err) && take_planes(&s, p, err);
    json_decref(json);
    return ok;
}
