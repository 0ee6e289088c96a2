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

#include "data/import/dicom_times.h"

/* More fields than the list of other fields holds become steps; segments do not. */
enum { LIST = 100 }; /* bytes of the names in a warning */
enum { LISTED_MAX = SP_OTHER_FIELDS_MAX + 1, FIELDS_MAX = 256, FIELD_KEYS = DICOM_KEY_PHASE };

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

/* Keys that tell reconstructions apart even where these have no place in common. */
static bool is_of_reconstruction(int key) {
    return key == DICOM_TEXT_KERNEL || key == DICOM_KEY_THICKNESS || key == DICOM_KEY_VOLTAGE;
}

enum { VALUES_MAX = 8 };

struct values { /* that a key has, in the order of the slices */
    double value[VALUES_MAX];
    uint32_t slices[VALUES_MAX]; /* with this value */
    uint32_t count, runs;
};

/* False if there are too many. */
static bool list_values(const struct dicom_slices *slices, int key, struct values *values) {
    *values = (struct values){ .count = 0 };
    for (uint32_t i = 0; i < slices->count; i++) {
        const double own = slices->items[i].is.keys[key];
        unsigned n = 0;
        while (n < values->count && !is_same_key(values->value[n], own))
            n++;
        if (n == VALUES_MAX)
            return false;
        if (n == values->count)
            values->value[values->count++] = own;
        values->slices[n]++;
        values->runs += i == 0 || !is_same_key(own, slices->items[i - 1].is.keys[key]);
    }
    return true;
}

/* True if different values of a key alternate along the slices, which are sorted. Nearly equal ones
 * are one value with rounding errors. */
static bool alternates(const struct dicom_slices *slices, int key) {
    struct values values;
    double low = INFINITY, high = -INFINITY;
    if (!list_values(slices, key, &values) || values.runs <= values.count)
        return false;
    for (uint32_t n = 0; n < values.count; n++) {
        low = fmin(low, values.value[n]);
        high = fmax(high, values.value[n]);
    }
    return high > 1.2 * low;
}

/* True if all values of a key have the same number of slices. */
static bool is_even(const struct dicom_slices *slices, int key) {
    struct values values;
    bool ok = list_values(slices, key, &values);
    for (uint32_t n = 1; ok && n < values.count; n++)
        ok = values.slices[n] == values.slices[0];
    return ok;
}

/* The slices are sorted. Keys in which only slices of different places differ make no fields. */
static void mark_keys(const struct dicom_slices *slices, struct fields *fields) {
    for (uint32_t i = 1; i < slices->count; i++) {
        const struct dicom_slice *a = &slices->items[i - 1], *b = &slices->items[i];
        for (int key = 0; key < FIELD_KEYS && a->plane == b->plane; key++)
            fields->varies[key] |= !is_same_key(a->is.keys[key], b->is.keys[key]);
    }
    for (int key = 0; key < FIELD_KEYS; key++)
        if (is_of_reconstruction(key) && !slices->items[0].is.segment)
            fields->varies[key] |= alternates(slices, key);
}

/* A contrast agent that is given between two of many times is part of the time. */
static bool join_agents(struct dicom_slices *slices) {
    if (is_even(slices, DICOM_TEXT_AGENT))
        return true;
    for (uint32_t i = 0; i < slices->count; i++)
        slices->items[i].is.keys[DICOM_TEXT_AGENT] = NAN;
    return slices->items[0].is.segment || dicom_slices_sort(slices);
}

/* Segments are fields even where each lies in places of its own. */
static void list_fields(const struct dicom_slices *slices, struct fields *fields) {
    mark_keys(slices, fields);
    fields->varies[DICOM_KEY_FLAVOUR] |= slices->items[0].is.segment > 0;
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

/* How names tell the keys of a field. */
static const struct {
    int key;
    const char *text;   /* before the text of a key that numbers texts */
    const char *number; /* of another key */
    bool is_weak;       /* named only where nothing else differs */
} labels[] = {
    { DICOM_TEXT_FLAVOUR, "", NULL, false },
    { DICOM_TEXT_QUANTITY, "", NULL, false },
    { DICOM_TEXT_OTHER, "", NULL, false },
    { DICOM_KEY_ECHO, NULL, "echo %.6g ms", false },
    { DICOM_KEY_ECHO_NUMBER, NULL, "echo %.6g", false },
    { DICOM_KEY_DIFFUSION, NULL, "b %.6g s/mm²", false },
    { DICOM_KEY_DIRECTION, NULL, "direction %.0f", false },
    { DICOM_KEY_VOLTAGE, NULL, "%.6g kV", false },
    { DICOM_KEY_FLIP, NULL, "flip angle %.6g°", false },
    { DICOM_KEY_INVERSION, NULL, "inversion %.6g ms", false },
    { DICOM_TEXT_KERNEL, "kernel ", NULL, false },
    { DICOM_KEY_THICKNESS, NULL, "%.6g mm thick", false },
    { DICOM_TEXT_FILTER, "filter ", NULL, false },
    { DICOM_TEXT_METHOD, "", NULL, false },
    { DICOM_TEXT_CORRECTION, "corrected ", NULL, false },
    { DICOM_TEXT_AGENT, "contrast ", NULL, false },
    { DICOM_TEXT_COIL, "coil ", NULL, false },
    { DICOM_TEXT_UNIT, "", NULL, true },
    { DICOM_TEXT_ORIGIN, "", NULL, true },
    { DICOM_TEXT_DESCRIPTION, "", NULL, true },
};

static void name_field(const struct fields *fields, const struct dicom_slice *slice,
                       char name[SP_FIELD_BYTES]) {
    bool has_strong = false;
    name[0] = 0;
    for (size_t i = 0; i < sizeof labels / sizeof *labels; i++) {
        const int key = labels[i].key;
        const double number = slice->is.keys[key];
        has_strong |= fields->varies[key] && !labels[i].is_weak;
        if (!fields->varies[key] || isnan(number) || (labels[i].is_weak && has_strong))
            continue;
        if (labels[i].text)
            append(name, "%s%s", labels[i].text, slice->is.texts[key]);
        else
            append(name, labels[i].number, number);
    }
    if (!*name)
        snprintf(name, SP_FIELD_BYTES, "%s",
                 fields->varies[DICOM_TEXT_AGENT] ? "no contrast" : "other");
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

static bool is_one_file(const struct dicom_slices *slices) {
    for (uint32_t i = 1; i < slices->count; i++)
        if (strcmp(slices->items[i].name, slices->items[0].name) != 0)
            return false;
    return true;
}

/* Says that files of one series show several things: a viewer of slices may show only one. */
static void warn_of_fields(const struct dicom_slices *slices, const struct dicom_source *source,
                           char names[FIELDS_MAX][SP_FIELD_BYTES], unsigned count,
                           unsigned chosen) {
    char text[LIST] = "";
    struct import_list list;
    if (is_one_file(slices))
        return;
    import_list_begin(&list, text, sizeof text);
    for (unsigned n = 0; n < count; n++)
        if (n != chosen)
            import_list_add(&list, list.used ? ", " : "", names[n]);
    import_list_end(&list, false);
    import_warn(source->file->warnings,
                "The images of one place differ: \"%s\" is shown, %s left out (%s). ?field= "
                "chooses.",
                names[chosen], count > 2 ? "others are" : "another is", text);
}

/* The field with the most slices; of equal ones, and of segments, the first. */
static unsigned find_largest(const struct dicom_slices *slices, const struct fields *fields) {
    uint32_t most = 0;
    unsigned largest = 0;
    for (unsigned n = 0; n < fields->count && !slices->items[0].is.segment; n++) {
        uint32_t count = 0;
        for (uint32_t i = 0; i < slices->count; i++)
            count += is_same_field(fields, fields->slice[n], &slices->items[i]);
        largest = count > most ? n : largest;
        most = count > most ? count : most;
    }
    return largest;
}

/* The field of the file that was opened, or else the largest one. */
static unsigned find_opened(const struct dicom_slices *slices, const struct dicom_source *source,
                            const struct fields *fields) {
    if (!source->is_named || is_one_file(slices))
        return find_largest(slices, fields);
    for (uint32_t i = 0; i < slices->count; i++)
        if (strcmp(slices->items[i].name, source->name) == 0)
            for (unsigned n = 0; n < fields->count; n++)
                if (is_same_field(fields, fields->slice[n], &slices->items[i]))
                    return n;
    return 0;
}

bool dicom_slices_choose_field(struct dicom_slices *slices, const struct dicom_source *source,
                               struct import_header *header, struct sp_error *err) {
    char names[FIELDS_MAX][SP_FIELD_BYTES];
    struct fields fields = { .count = 0 };
    const bool are_labels = source->image.is_labels && slices->items[0].is.segment > 0;
    const char *wanted = source->file->field;
    if (!join_agents(slices))
        return sp_fail(err, SP_ERR_MEMORY, source->file->title, "out of memory for the slices");
    list_fields(slices, &fields);
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
    if (!slices->items[0].is.segment && !*wanted)
        warn_of_fields(slices, source, names, fields.count, chosen);
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
           sp_fail(err, SP_ERR_MEMORY, source->file->title, "out of memory for the slices");
}

/* Steps: slices of one place at several times. */

/* True if two images of one place differ in a key of [from, to). */
static bool differ(const struct dicom_slices *slices, int from, int to) {
    const struct dicom_slice *a = &slices->items[0], *b = &slices->items[1];
    for (int key = from; key < to; key++)
        if (!is_same_key(a->is.keys[key], b->is.keys[key]))
            return true;
    return false;
}

/* Says that only a number, or the time when they were made, tells the images of one place apart.
 * `has_times`: this time rises with the number. */
static void warn_of_numbers(const struct dicom_slices *slices, const struct dicom_source *source,
                            uint32_t steps, bool has_times) {
    if (differ(slices, 0, DICOM_KEY_ACQUISITION))
        return;
    const char *number = differ(slices, DICOM_KEY_ACQUISITION, DICOM_KEYS_OF_ORDER)
                             ? "AcquisitionNumber"
                         : is_one_file(slices) ? "of frames"
                                               : "InstanceNumber";
    const bool is_made = differ(slices, DICOM_KEY_CONTENT, DICOM_KEY_CONTENT + 1);
    if (has_times && is_made)
        import_warn(source->file->warnings,
                    "The times of the steps are those at which the images were made (ContentTime): "
                    "the files give no others.");
    else
        import_warn(
            source->file->warnings,
            "Each place has %u images, and only their numbers (%s) differ%s: they are shown "
            "as steps in this order, which may be no times.",
            steps, number, is_made ? ", and ContentTime in another order" : "");
}

/* True if slices of one place have numbers that tell them apart. */
static bool are_apart(const struct dicom_slice *a, const struct dicom_slice *b) {
    for (int key = 0; key < DICOM_KEYS_OF_ORDER; key++)
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
                 "%s and %s show the same place (%.6g mm), %s, and nothing tells which times they "
                 "belong to",
                 first, second, slices->is_falling ? -b->place : b->place,
                 slices->planes == 1 ? "their numbers (InstanceNumber) are the same"
                                     : "other places have another number of images");
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
    const bool is_clock = key == DICOM_KEY_CLOCK || key == DICOM_KEY_CONTENT;
    const double first = is_clock ? step_number(slices, steps, 0, key) : 0;
    for (uint32_t n = 0; n < steps; n++) {
        times[n] = step_number(slices, steps, n, key) - first;
        if (!isfinite(times[n]) || (n > 0 && !(times[n] > times[n - 1])))
            return false;
    }
    return true;
}

/* The times of the steps, by the first key that has them. When the images were made counts only
 * where nothing but numbers tells them apart. */
static bool set_times(struct dicom_slices *slices, const struct dicom_source *source,
                      uint32_t steps, struct import_header *header) {
    static const struct {
        enum dicom_key key;
        const char *unit;
    } keys[] = { { DICOM_KEY_DELAY, "s" },      { DICOM_KEY_PERCENT, "%" },
                 { DICOM_KEY_CLOCK, "s" },      { DICOM_KEY_ECHO, "ms" },
                 { DICOM_KEY_INVERSION, "ms" }, { DICOM_KEY_DIFFUSION, "s/mm²" },
                 { DICOM_KEY_CONTENT, "s" } };
    const bool is_made =
        !(source->image.frame_time > 0) && !differ(slices, 0, DICOM_KEY_ACQUISITION);
    slices->times = malloc(steps * sizeof *slices->times);
    for (size_t i = 0; slices->times && i < sizeof keys / sizeof *keys; i++) {
        if ((keys[i].key == DICOM_KEY_CONTENT && !is_made) ||
            !fill_times(slices, steps, keys[i].key, slices->times))
            continue;
        header->steps.times = slices->times;
        snprintf(header->steps.unit, sizeof header->steps.unit, "%s", keys[i].unit);
        return true;
    }
    import_header_use_interval(header, 0, source->image.frame_time, "s");
    return slices->times != NULL;
}

/* Returns the wanted step, or else the step that has the file which was opened by its name. Slice i
 * belongs to step i % `steps`. */
static uint32_t choose_step(const struct dicom_slices *slices, const struct dicom_source *source,
                            uint32_t steps) {
    const bool is_asked = source->file->has_step || !source->is_named || is_one_file(slices);
    for (uint32_t i = 0; !is_asked && i < slices->count; i++)
        if (strcmp(slices->items[i].name, source->name) == 0)
            return i % steps;
    return source->file->step;
}

bool dicom_slices_choose_step(struct dicom_slices *slices, const struct dicom_source *source,
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
    if (!set_times(slices, source, steps, header))
        return sp_fail(err, SP_ERR_MEMORY, source->file->title, "out of memory for the times");
    warn_of_numbers(slices, source, steps, header->steps.times != NULL);
    const uint32_t count = slices->count;
    header->steps.index = choose_step(slices, source, steps);
    slices->count = 0;
    for (uint32_t i = 0; i < count; i++)
        if (i % steps == header->steps.index)
            slices->items[slices->count++] = slices->items[i];
        else
            free(slices->items[i].name);
    return true;
}
