/* SPDX-License-Identifier: Apache-2.0
 *
 * Slices that share their place: fields and steps.
 */
#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "import/dicom_times.h"

/* More fields than the list of other fields holds become steps; segments do not. */
enum { LISTED_MAX = SP_OTHER_FIELDS_MAX + 1, FIELDS_MAX = 256, FIELD_KEYS = DICOM_KEY_OTHER + 1 };

#define LABELS "labels"

/* Fields: what slices of one place show. */

struct fields {
    bool varies[FIELD_KEYS];                     /* the keys in which slices of one place differ */
    const struct dicom_slice *slice[FIELDS_MAX]; /* the first of each field */
    unsigned count;
};

static bool is_same_key(double a, double b) {
    return a == b || (isnan(a) && isnan(b));
}

static bool is_same_field(const struct fields *fields, const struct dicom_slice *a,
                          const struct dicom_slice *b) {
    for (int key = 0; key < FIELD_KEYS; key++)
        if (fields->varies[key] && !is_same_key(a->is.keys[key], b->is.keys[key]))
            return false;
    return true;
}

/* The slices are sorted. Keys in which only slices of different places differ make no fields. */
static void find_keys(const struct dicom_slices *slices, struct fields *fields) {
    for (uint32_t i = 1; i < slices->count; i++) {
        const struct dicom_slice *a = &slices->items[i - 1], *b = &slices->items[i];
        for (int key = 0; key < FIELD_KEYS && a->plane == b->plane; key++)
            fields->varies[key] |= !is_same_key(a->is.keys[key], b->is.keys[key]);
    }
}

/* Segments are fields even where each lies in places of its own. */
static void find_fields(const struct dicom_slices *slices, struct fields *fields) {
    find_keys(slices, fields);
    fields->varies[DICOM_KEY_GROUP] |= slices->items[0].is.segment > 0;
    for (uint32_t i = 0; i < slices->count && fields->count <= FIELDS_MAX; i++) {
        unsigned n = 0;
        while (n < fields->count && n < FIELDS_MAX &&
               !is_same_field(fields, fields->slice[n], &slices->items[i]))
            n++;
        if (n < fields->count)
            continue;
        if (fields->count < FIELDS_MAX)
            fields->slice[fields->count] = &slices->items[i];
        fields->count++;
    }
}

static int by_keys(const void *a, const void *b) {
    const struct dicom_slice *const *p = a, *const *q = b;
    for (int key = 0; key < FIELD_KEYS; key++) {
        const double x = (*p)->is.keys[key], y = (*q)->is.keys[key];
        if (isnan(x) != isnan(y))
            return isnan(x) ? -1 : 1;
        if (x != y && !isnan(x))
            return x < y ? -1 : 1;
    }
    return 0;
}

/* Appends to a name what fits. */
__attribute__((format(printf, 2, 3))) static void append(char name[SP_FIELD_BYTES],
                                                         const char *format, ...) {
    char item[SP_FIELD_BYTES], all[2 * SP_FIELD_BYTES + 4];
    va_list args;
    va_start(args, format);
    vsnprintf(item, sizeof item, format, args);
    va_end(args);
    snprintf(all, sizeof all, "%.63s%s%.63s", name, *name && *item ? ", " : "", item);
    import_name(name, all);
}

static void name_field(const struct fields *fields, const struct dicom_slice *slice,
                       char name[SP_FIELD_BYTES]) {
    const struct dicom_frame *is = &slice->is;
    const double *keys = is->keys;
    name[0] = 0;
    if (fields->varies[DICOM_KEY_GROUP] || fields->varies[DICOM_KEY_OTHER])
        append(name, "%s", is->group);
    if (fields->varies[DICOM_KEY_ECHO] && !isnan(keys[DICOM_KEY_ECHO]))
        append(name, "echo %.6g ms", keys[DICOM_KEY_ECHO]);
    if (fields->varies[DICOM_KEY_DIFFUSION] && !isnan(keys[DICOM_KEY_DIFFUSION]))
        append(name, "b %.6g s/mm²", keys[DICOM_KEY_DIFFUSION]);
    if (fields->varies[DICOM_KEY_DIRECTION] && !isnan(keys[DICOM_KEY_DIRECTION]))
        append(name, "direction %.0f", keys[DICOM_KEY_DIRECTION]);
    if (!*name)
        snprintf(name, SP_FIELD_BYTES, "other");
}

/* Different fields may have one label; then their numbers follow it. */
static void name_fields(const struct fields *fields, char names[FIELDS_MAX][SP_FIELD_BYTES]) {
    for (unsigned n = 0; n < fields->count; n++) {
        unsigned same = 0;
        name_field(fields, fields->slice[n], names[n]);
        for (unsigned i = 0; i < n; i++) {
            char other[SP_FIELD_BYTES];
            name_field(fields, fields->slice[i], other);
            same += strcmp(other, names[n]) == 0;
        }
        if (same)
            append(names[n], "%u", same + 1);
    }
}

struct kept_field {
    const struct fields *fields;
    struct dicom_slice slice; /* a copy: the slices move */
};

static bool is_in_field(const struct dicom_slice *slice, const void *user) {
    const struct kept_field *kept = user;
    return is_same_field(kept->fields, slice, &kept->slice);
}

/* Too many for the list of fields: they become steps, in the order of their keys. */
static bool use_steps(const struct dicom_slices *slices, const struct dicom_source *source,
                      const struct fields *fields) {
    if (fields->count <= LISTED_MAX || slices->items[0].is.segment)
        return false;
    import_warn(source->file->warnings,
                "The steps are different images of one place, such as directions of diffusion, "
                "not times: there are more than %d of them.",
                LISTED_MAX);
    return true;
}

/* The field of the file that was opened, or else the first one. */
static unsigned find_opened(const struct dicom_slices *slices, const struct dicom_source *source,
                            const struct fields *fields) {
    if (source->file->is_folder || source->image.frames > 1)
        return 0;
    for (uint32_t i = 0; i < slices->count; i++)
        if (strcmp(slices->items[i].name, source->name) == 0)
            for (unsigned n = 0; n < fields->count; n++)
                if (is_same_field(fields, fields->slice[n], &slices->items[i]))
                    return n;
    return 0;
}

bool dicom_slices_take_field(struct dicom_slices *slices, const struct dicom_source *source,
                             struct import_header *header, struct sp_error *err) {
    char names[FIELDS_MAX][SP_FIELD_BYTES];
    struct fields fields = { .count = 0 };
    const bool are_labels = source->image.is_labels && slices->items[0].is.segment > 0;
    const char *wanted = source->file->field;
    find_fields(slices, &fields);
    if (use_steps(slices, source, &fields) || (fields.count < 2 && !are_labels))
        return true;
    if (fields.count > FIELDS_MAX)
        fields.count = FIELDS_MAX;
    qsort(fields.slice, fields.count, sizeof *fields.slice, by_keys);
    name_fields(&fields, names);
    unsigned chosen = are_labels ? fields.count : find_opened(slices, source, &fields);
    for (unsigned n = 0; n < fields.count; n++)
        if (strcmp(names[n], wanted) == 0)
            chosen = n;
    if (are_labels && chosen == fields.count)
        slices->are_together = true;
    import_name(header->value_name, slices->are_together ? LABELS : names[chosen]);
    if (are_labels && !slices->are_together)
        import_header_add_other(header, LABELS);
    for (unsigned n = 0; n < fields.count; n++)
        if (n != chosen)
            import_header_add_other(header, names[n]);
    if (slices->are_together)
        return true;
    const struct kept_field kept = { &fields, *fields.slice[chosen] };
    dicom_slices_keep(slices, is_in_field, &kept);
    return slices->items[0].is.segment || dicom_slices_sort(slices) ||
           sp_fail(err, SP_ERR_MEMORY, source->file->shown, "out of memory for the slices");
}

/* Steps: slices of one place at several times. */

/* True if slices of one place have numbers that tell them apart. */
static bool are_apart(const struct dicom_slice *a, const struct dicom_slice *b) {
    for (int key = 0; key < DICOM_KEY_COUNT; key++)
        if (!is_same_key(a->is.keys[key], b->is.keys[key]))
            return true;
    return a->is.instance != b->is.instance;
}

/* If every place has the same number of slices, which are told apart, those are the steps.
 * Returns how many there are; 0 = the places differ. The slices are sorted. */
static uint32_t count_steps(const struct dicom_slices *slices) {
    const struct dicom_slice *s = slices->items;
    uint32_t steps = 1;
    while (steps < slices->count && s[0].plane == s[steps].plane)
        steps++;
    for (uint32_t i = 1; i < slices->count; i++) {
        const bool is_next = i % steps != 0;
        if ((s[i - 1].plane == s[i].plane) != is_next || (is_next && !are_apart(&s[i - 1], &s[i])))
            return 0;
    }
    return slices->count % steps == 0 ? steps : 0;
}

static bool fail_uneven(const struct dicom_slices *slices, const struct dicom_source *source,
                        struct sp_error *err) {
    for (uint32_t i = 1; i < slices->count; i++) {
        const struct dicom_slice *a = &slices->items[i - 1], *b = &slices->items[i];
        char text[SP_ERROR_TEXT], first[80], second[80];
        if (a->plane != b->plane)
            continue;
        dicom_slice_name(a, first);
        dicom_slice_name(b, second);
        snprintf(text, sizeof text,
                 "%s and %s show the same place (%.6g mm), other places have another number of "
                 "images, and nothing tells which times they belong to",
                 first, second, slices->is_falling ? -b->place : b->place);
        return dicom_fail(source, SP_ERR_UNSUPPORTED, a->name, text, err);
    }
    return true;
}

/* The number that a key of all slices of a step has, the smallest one where they differ. */
static double step_number(const struct dicom_slices *slices, uint32_t steps, uint32_t step,
                          enum dicom_key key) {
    double least = INFINITY;
    for (uint32_t i = step; i < slices->count; i += steps)
        least = fmin(least, isnan(slices->items[i].is.keys[key]) ? -INFINITY
                                                                 : slices->items[i].is.keys[key]);
    return least;
}

static bool fill_times(const struct dicom_slices *slices, uint32_t steps, enum dicom_key key,
                       double *times) {
    const double first = key == DICOM_KEY_CLOCK ? step_number(slices, steps, 0, key) : 0;
    for (uint32_t n = 0; n < steps; n++) {
        times[n] = step_number(slices, steps, n, key) - first;
        if (!isfinite(times[n]) || (n > 0 && !(times[n] > times[n - 1])))
            return false;
    }
    return true;
}

/* The times of the steps, by the first key that has them. */
static bool take_times(struct dicom_slices *slices, const struct dicom_source *source,
                       uint32_t steps, struct import_header *header) {
    static const struct {
        enum dicom_key key;
        const char *unit;
    } keys[] = { { DICOM_KEY_DELAY, "s" },
                 { DICOM_KEY_CLOCK, "s" },
                 { DICOM_KEY_ECHO, "ms" },
                 { DICOM_KEY_DIFFUSION, "s/mm²" } };
    slices->times = malloc(steps * sizeof *slices->times);
    for (size_t i = 0; slices->times && i < sizeof keys / sizeof *keys; i++) {
        if (!fill_times(slices, steps, keys[i].key, slices->times))
            continue;
        header->steps.times = slices->times;
        snprintf(header->steps.unit, sizeof header->steps.unit, "%s", keys[i].unit);
        return true;
    }
    import_header_use_interval(header, 0, source->image.frame_time, "s");
    return slices->times != NULL;
}

bool dicom_slices_take_step(struct dicom_slices *slices, const struct dicom_source *source,
                            struct import_header *header, struct sp_error *err) {
    uint32_t steps = slices->are_together ? 1 : count_steps(slices);
    if (steps == 0 && !dicom_times_complete(slices, source, err))
        return false;
    if (steps == 0)
        steps = count_steps(slices);
    if (steps == 0)
        return fail_uneven(slices, source, err);
    if (!import_header_use_steps(header, source->file, steps, err))
        return false;
    if (steps == 1)
        return true;
    if (!take_times(slices, source, steps, header))
        return sp_fail(err, SP_ERR_MEMORY, source->file->shown, "out of memory for the times");
    const uint32_t count = slices->count;
    slices->count = 0;
    for (uint32_t i = 0; i < count; i++)
        if (i % steps == source->file->step)
            slices->items[slices->count++] = slices->items[i];
        else
            free(slices->items[i].name);
    return true;
}
