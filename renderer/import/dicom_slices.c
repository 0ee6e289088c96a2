/* SPDX-License-Identifier: Apache-2.0 */
#include "import/dicom_slices.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/vec.h"

#define SAME_PLACE 1e-4 /* mm */

bool dicom_slices_add(struct dicom_slices *slices, const char *name, uint32_t frame,
                      const struct dicom_frame *is) {
    if (slices->count == slices->capacity) {
        const uint32_t wanted = slices->capacity ? 2 * slices->capacity : 256;
        struct dicom_slice *larger = realloc(slices->items, wanted * sizeof *larger);
        if (!larger)
            return false;
        slices->items = larger;
        slices->capacity = wanted;
    }
    struct dicom_slice *s = &slices->items[slices->count];
    *s = (struct dicom_slice){ .name = strdup(name), .frame = frame, .is = *is };
    slices->count += s->name != NULL;
    return s->name != NULL;
}

void dicom_slices_finish(struct dicom_slices *slices) {
    for (uint32_t i = 0; i < slices->count; i++)
        free(slices->items[i].name);
    free(slices->items);
    *slices = (struct dicom_slices){ 0 };
}

/* Numbers before NaN, so that the order is total. */
static int compare_numbers(double a, double b) {
    if (isnan(a) || isnan(b))
        return isnan(a) - isnan(b);
    return (a > b) - (a < b);
}

static int by_place(const void *a, const void *b) {
    const struct dicom_slice *p = a, *q = b;
    int order = compare_numbers(p->place, q->place);
    for (int key = 0; order == 0 && key < DICOM_KEY_COUNT; key++)
        order = compare_numbers(p->is.keys[key], q->is.keys[key]);
    if (order == 0)
        order = (p->is.instance > q->is.instance) - (p->is.instance < q->is.instance);
    if (order == 0)
        order = strcmp(p->name, q->name);
    return order ? order : (p->frame > q->frame) - (p->frame < q->frame);
}

static bool is_same_place(const struct dicom_slice *a, const struct dicom_slice *b) {
    return fabs(a->place - b->place) <= SAME_PLACE;
}

/* Slices of one place get the same one, so that sorting goes on with their keys. */
static void join_places(struct dicom_slices *slices) {
    for (uint32_t i = 1; i < slices->count; i++)
        if (is_same_place(&slices->items[i - 1], &slices->items[i]))
            slices->items[i].place = slices->items[i - 1].place;
}

void dicom_slices_sort(struct dicom_slices *slices) {
    if (slices->count == 0)
        return;
    const struct dicom_frame *first = &slices->items[0].is;
    const struct sp_vec3 normal =
        sp_vec3_cross(sp_vec3_from(first->along[0]), sp_vec3_from(first->along[1]));
    for (uint32_t i = 0; i < slices->count; i++) {
        struct dicom_slice *s = &slices->items[i];
        s->place = !s->is.is_placed ? (double)s->is.instance
                                    : sp_vec3_dot(sp_vec3_from(s->is.position), normal);
    }
    qsort(slices->items, slices->count, sizeof *slices->items, by_place);
    if (!first->is_placed)
        return;
    join_places(slices);
    qsort(slices->items, slices->count, sizeof *slices->items, by_place);
}

/* If every place has the same number of slices, of different numbers, those are the steps of a time
 * series, or of echoes. Returns how many steps there are. The slices are sorted. */
static uint32_t count_steps(const struct dicom_slices *slices) {
    const struct dicom_slice *s = slices->items;
    uint32_t steps = 1;
    while (steps < slices->count && is_same_place(&s[0], &s[steps]))
        steps++;
    for (uint32_t i = 1; i < slices->count; i++) {
        const bool is_next = i % steps != 0;
        if (is_same_place(&s[i - 1], &s[i]) != is_next ||
            (is_next && s[i - 1].is.instance == s[i].is.instance))
            return 1;
    }
    return s[0].is.is_placed && slices->count % steps == 0 ? steps : 1;
}

/* Slices of one place belong to several times or echoes. */
static bool check_places(const struct dicom_slices *slices, const struct dicom_source *source,
                         struct sp_error *err) {
    for (uint32_t i = 1; i < slices->count; i++) {
        const struct dicom_slice *a = &slices->items[i - 1], *b = &slices->items[i];
        char text[SP_ERROR_TEXT];
        if (!is_same_place(a, b) || !(a->is.is_placed || a->is.instance))
            continue;
        snprintf(text, sizeof text,
                 "%.60s and %.60s show the same place (%.6g): a duplicate, or a series whose "
                 "places have different numbers of times or echoes",
                 a->name, b->name, b->place);
        return dicom_fail(source, SP_ERR_UNSUPPORTED, a->name, text, err);
    }
    return true;
}

bool dicom_slices_take_step(struct dicom_slices *slices, const struct dicom_source *source,
                            struct import_header *header, struct sp_error *err) {
    const uint32_t steps = count_steps(slices), count = slices->count;
    if (!import_header_use_steps(header, source->file, steps, err))
        return false;
    slices->count = 0;
    for (uint32_t i = 0; i < count; i++)
        if (i % steps == source->file->step)
            slices->items[slices->count++] = slices->items[i];
        else
            free(slices->items[i].name);
    return check_places(slices, source, err);
}
