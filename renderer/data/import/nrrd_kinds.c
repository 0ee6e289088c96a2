/* SPDX-License-Identifier: Apache-2.0
 *
 * Tells the axes of a NRRD file apart: space, time, or components of a sample.
 */
#include <inttypes.h>
#include <math.h>
#include <string.h>
#include <strings.h>

#include "data/import/meaning.h"
#include "data/import/nrrd_header.h"

#define REFUSE(code, field, ...) NRRD_FAIL(err, code, file, h, field, __VA_ARGS__)

bool nrrd_next_word(const char **text, char word[64]) {
    const char *start = nrrd_skip_blanks(*text);
    size_t size = strcspn(start, " \t");
    memset(word, 0, 64);
    memcpy(word, start, size < 63 ? size : 63);
    *text = start + size;
    return size > 0;
}

/* The kinds of NRRD, and how many samples such an axis has; 0 = any number. */
static const struct {
    const char *name;
    unsigned size;
    enum nrrd_role role;
} kinds[] = {
    { "domain", 0, NRRD_DOMAIN },
    { "space", 0, NRRD_DOMAIN },
    { "time", 0, NRRD_TIME },
    { "list", 0, NRRD_TIME },
    { "vector", 0, NRRD_VECTOR },
    { "covariant-vector", 0, NRRD_VECTOR },
    { "normal", 0, NRRD_VECTOR },
    { "3-vector", 3, NRRD_VECTOR },
    { "3-gradient", 3, NRRD_VECTOR },
    { "3-normal", 3, NRRD_VECTOR },
    { "RGB-color", 3, NRRD_COLOR },
    { "RGBA-color", 4, NRRD_COLOR },
    { "3-color", 3, NRRD_COLOR },
    { "4-color", 4, NRRD_COLOR },
    { "HSV-color", 3, NRRD_COMPONENT },
    { "XYZ-color", 3, NRRD_COMPONENT },
    { "complex", 2, NRRD_PART },
    { "scalar", 1, NRRD_SINGLE },
    { "stub", 1, NRRD_SINGLE },
    { "point", 0, NRRD_COMPONENT },
    { "2-vector", 2, NRRD_COMPONENT },
    { "4-vector", 4, NRRD_COMPONENT },
    { "quaternion", 4, NRRD_COMPONENT },
    { "2D-symmetric-matrix", 3, NRRD_COMPONENT },
    { "2D-masked-symmetric-matrix", 4, NRRD_COMPONENT },
    { "2D-matrix", 4, NRRD_COMPONENT },
    { "2D-masked-matrix", 5, NRRD_COMPONENT },
    { "3D-symmetric-matrix", 6, NRRD_COMPONENT },
    { "3D-masked-symmetric-matrix", 7, NRRD_COMPONENT },
    { "3D-matrix", 9, NRRD_COMPONENT },
    { "3D-masked-matrix", 10, NRRD_COMPONENT },
};

/* SimpleITK calls alternating bytes of a colour a vector. Vectors in a volume have three
 * components. */
static enum nrrd_role role_of_vector(const struct nrrd_header *h, unsigned axis, const char *word) {
    const uint64_t size = h->sizes[axis];
    if (axis == 0 && strcasecmp(word, "vector") == 0 && h->number.size == 1 &&
        h->number.kind == IMPORT_UNSIGNED && (size == 3 || size == 4))
        return NRRD_COLOR;
    return size == 3 ? NRRD_VECTOR : NRRD_COMPONENT;
}

/* The entries of a matrix of three rows, which is symmetric or not, and may begin with a mask. */
static const char *const *names_of_matrix(uint64_t size) {
    static const char *const symmetric[] = { "mask", "xx", "xy", "xz", "yy", "yz", "zz" };
    static const char *const all[] = {
        "mask", "xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"
    };
    return size == 6 ? symmetric + 1 : size == 7 ? symmetric : size == 9 ? all + 1 : all;
}

static bool parse_kind(const struct import_file *file, struct nrrd_header *h, unsigned axis,
                       const char *word, struct sp_error *err) {
    const uint64_t size = h->sizes[axis];
    size_t i = 0;
    if (strcmp(word, "???") == 0 || strcasecmp(word, "none") == 0)
        return true;
    while (i < sizeof kinds / sizeof *kinds && strcasecmp(word, kinds[i].name) != 0)
        i++;
    if (i == sizeof kinds / sizeof *kinds)
        return REFUSE(SP_ERR_FORMAT, NRRD_KINDS, "axis %u: \"%.40s\" is not a kind of NRRD", axis,
                      word);
    if (kinds[i].size && kinds[i].size != size)
        return REFUSE(SP_ERR_FORMAT, NRRD_KINDS,
                      "axis %u is of kind %.40s and has %" PRIu64 " samples instead of %u", axis,
                      word, size, kinds[i].size);
    if (kinds[i].role == NRRD_COMPONENT && strncasecmp(word, "3D-", 3) == 0)
        h->names = names_of_matrix(size);
    h->role[axis] = kinds[i].role == NRRD_VECTOR ? role_of_vector(h, axis, word) : kinds[i].role;
    return true;
}

static bool parse_words(const struct import_file *file, struct nrrd_header *h,
                        struct sp_error *err) {
    const char *text = h->value[NRRD_KINDS];
    char word[64];
    for (unsigned axis = 0; axis < h->dimension; axis++) {
        if (!nrrd_next_word(&text, word))
            return REFUSE(SP_ERR_FORMAT, NRRD_KINDS, "has %u words instead of %u", axis,
                          h->dimension);
        if (!parse_kind(file, h, axis, word, err))
            return false;
    }
    return !nrrd_next_word(&text, word) ||
           REFUSE(SP_ERR_FORMAT, NRRD_KINDS, "has more than the %u words of the dimension",
                  h->dimension);
}

static unsigned count_domains(const struct nrrd_header *h) {
    unsigned count = 0;
    for (unsigned axis = 0; axis < h->dimension; axis++)
        count += h->role[axis] == NRRD_DOMAIN;
    return count;
}

/* True if the first axis has no place in space, and the others have. */
static bool is_first_apart(const struct nrrd_header *h) {
    const char *directions = h->value[NRRD_SPACE_DIRECTIONS];
    bool is_only = h->value[NRRD_SPACINGS] && isnan(h->spacing[0]);
    for (unsigned axis = 1; axis < h->dimension; axis++)
        is_only &= isfinite(h->spacing[axis]);
    return is_only || (directions && strncasecmp(directions, "none", 4) == 0);
}

/* Of four axes without another role, the first one is time if it has no place in space, else the
 * last one. Of three axes, a short first one without a place holds the components. */
static void assign_time(const struct import_file *file, struct nrrd_header *h) {
    enum { COLORS_MAX = 4 };
    unsigned axis = 0, last = h->dimension - 1;
    const unsigned domains = count_domains(h);
    const bool is_apart = h->role[0] == NRRD_DOMAIN && is_first_apart(h);
    if (domains == 3 && h->dimension == 3 && !h->value[NRRD_KINDS] && is_apart &&
        h->sizes[0] <= COLORS_MAX)
        h->role[0] = NRRD_COMPONENT;
    if (domains != 4)
        return;
    while (h->role[axis] != NRRD_DOMAIN)
        axis++;
    while (h->role[last] != NRRD_DOMAIN)
        last--;
    axis = is_apart ? 0 : last;
    const char *space = h->value[NRRD_SPACE];
    const bool is_said = h->value[NRRD_KINDS] || (space && strcasestr(space, "-time"));
    h->role[axis] = NRRD_TIME;
    if (!is_said && h->sizes[axis] > 1 && file->selection.as == IMPORT_AS_FILE &&
        !h->segments.are_there)
        import_warn(file->warnings,
                    "The file does not say what axis %u is (kinds); its %" PRIu64
                    " entries are read as time steps. ?as=channels makes them fields.",
                    axis, h->sizes[axis]);
}

/* In diffusion files the axis of the gradients is a list of volumes, even if it is called vector.
 */
static void list_gradients(struct nrrd_header *h) {
    for (unsigned axis = 0; axis < h->dimension && h->is_diffusion; axis++)
        if (h->role[axis] == NRRD_VECTOR || h->role[axis] == NRRD_COMPONENT ||
            h->role[axis] == NRRD_COLOR)
            h->role[axis] = NRRD_TIME;
}

/* In segmentations the axis of the layers is a list of labels, whatever its kind. */
static void list_layers(struct nrrd_header *h) {
    for (unsigned axis = 0; axis < h->dimension && h->segments.are_there; axis++)
        if (h->role[axis] == NRRD_TIME || h->role[axis] == NRRD_VECTOR ||
            h->role[axis] == NRRD_COLOR)
            h->role[axis] = NRRD_COMPONENT;
}

/* Layers are named by their segments. */
static void name_layers(struct nrrd_header *h) {
    const uint64_t count = h->components >= 0 ? h->sizes[h->components] : 1;
    if (!h->segments.are_there || h->time >= 0 || h->vectors >= 0 || count > NRRD_LAYERS_MAX)
        return;
    nrrd_keys_name_layers(&h->segments, (unsigned)count);
    h->names = h->segments.layer_list;
}

/* The meaning of an axis without a place in space. */
static enum import_as as_of(enum nrrd_role role) {
    return role == NRRD_TIME        ? IMPORT_AS_TIME
           : role == NRRD_VECTOR    ? IMPORT_AS_VECTORS
           : role == NRRD_COLOR     ? IMPORT_AS_RGB
           : role == NRRD_COMPONENT ? IMPORT_AS_CHANNELS
                                    : IMPORT_AS_FILE;
}

static enum nrrd_role role_of(enum import_as as) {
    return as == IMPORT_AS_TIME      ? NRRD_TIME
           : as == IMPORT_AS_VECTORS ? NRRD_VECTOR
           : as == IMPORT_AS_RGB     ? NRRD_COLOR
                                     : NRRD_COMPONENT;
}

/* Applies the choice of the source about an axis outside of space: the axis of the components or,
 * without one, the axis of the steps. */
static bool apply_choice(const struct import_file *file, struct nrrd_header *h,
                         struct sp_error *err) {
    struct import_header header = { .used_as = false };
    struct import_extra extra = { .count = 0 };
    enum import_as as;
    int chosen = -1;
    for (unsigned axis = 0; axis < h->dimension; axis++) {
        if (as_of(h->role[axis]) == IMPORT_AS_FILE || h->sizes[axis] < 2)
            continue;
        extra.are_parts = chosen >= 0;
        if (chosen < 0 || h->role[axis] != NRRD_TIME)
            chosen = (int)axis;
    }
    if (chosen >= 0) {
        extra.count = h->sizes[chosen];
        extra.meaning = as_of(h->role[chosen]);
    }
    if (!import_meaning_choose(file, &extra, &header, &as, err))
        return false;
    h->used_as = header.used_as;
    if (chosen >= 0)
        h->role[chosen] = role_of(as);
    return true;
}

/* One axis at most has each other role. */
static bool assign_axis(const struct import_file *file, struct nrrd_header *h, unsigned axis,
                        struct sp_error *err) {
    const enum nrrd_role role = h->role[axis];
    int *place = role == NRRD_TIME                              ? &h->time
                 : role == NRRD_VECTOR                          ? &h->vectors
                 : role == NRRD_COLOR || role == NRRD_COMPONENT ? &h->components
                                                                : NULL;
    if (role == NRRD_PART && axis > 0)
        return REFUSE(SP_ERR_UNSUPPORTED, NRRD_KINDS,
                      "axis %u is of kind complex; only the first axis may be", axis);
    if (place && (*place >= 0 || (place != &h->time && (h->vectors >= 0 || h->components >= 0))))
        return REFUSE(SP_ERR_UNSUPPORTED, NRRD_KINDS,
                      "axis %u is a second one of %s; one is supported", axis,
                      role == NRRD_TIME ? "time steps" : "components");
    if (place)
        *place = (int)axis;
    return true;
}

/* A complex number is a number of its own. */
static bool join_parts(const struct import_file *file, struct nrrd_header *h,
                       struct sp_error *err) {
    if (h->role[0] != NRRD_PART)
        return true;
    if (h->number.kind == IMPORT_UNSIGNED)
        return REFUSE(SP_ERR_UNSUPPORTED, NRRD_TYPE,
                      "complex numbers of a type without a sign are not supported");
    h->number.kind = h->number.kind == IMPORT_FLOAT ? IMPORT_COMPLEX : IMPORT_COMPLEX_SIGNED;
    h->number.size *= 2;
    return true;
}

/* Vectors are read as a whole, so their components lie side by side or one after another. */
static bool check_vectors(const struct import_file *file, struct nrrd_header *h,
                          struct sp_error *err) {
    const unsigned axis = (unsigned)h->vectors, after = h->first + h->axes;
    const bool is_between = h->time >= 0 && h->sizes[h->time] > 1 &&
                            (axis < h->first ? (unsigned)h->time < h->first
                                             : (unsigned)h->time < axis && h->time >= (int)after);
    return h->vectors < 0 || !is_between ||
           REFUSE(SP_ERR_UNSUPPORTED, NRRD_KINDS,
                  "the components of vectors and the time steps alternate; make the time the last "
                  "axis");
}

bool nrrd_kinds_read(const struct import_file *file, struct nrrd_header *h, struct sp_error *err) {
    h->time = h->vectors = h->components = -1;
    if (h->value[NRRD_KINDS] && !parse_words(file, h, err))
        return false;
    list_gradients(h);
    assign_time(file, h);
    list_layers(h);
    if (!apply_choice(file, h, err))
        return false;
    h->axes = count_domains(h);
    if (h->axes < 2 || h->axes > 3)
        return REFUSE(SP_ERR_UNSUPPORTED, NRRD_DIMENSION,
                      "%u axes, %u of them in space; a volume has three, or two for a single "
                      "slice, and vectors and time steps one more axis, of a kind such as vector "
                      "or time",
                      h->dimension, h->axes);
    while (h->role[h->first] != NRRD_DOMAIN)
        h->first++;
    for (unsigned axis = 0; axis < h->dimension; axis++) {
        const bool is_inside = axis >= h->first && axis < h->first + h->axes;
        if (is_inside != (h->role[axis] == NRRD_DOMAIN))
            return REFUSE(SP_ERR_UNSUPPORTED, NRRD_KINDS,
                          "axis %u lies between the axes of the volume; make it the first or the "
                          "last one",
                          is_inside ? axis : h->first + 1);
        if (!assign_axis(file, h, axis, err))
            return false;
    }
    h->apart = h->time >= 0 ? h->time : h->vectors >= 0 ? h->vectors : h->components;
    name_layers(h);
    return check_vectors(file, h, err) && join_parts(file, h, err);
}
