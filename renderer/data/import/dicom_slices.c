/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/dicom_slices.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/grow.h"
#include "base/vec.h"

/* Slices closer than this part of a pixel have one place. Without a pixel size the limit is
 * SAME_PLACE [mm]. */
#define SAME_SHARE 0.01
#define SAME_PLACE 1e-4

bool dicom_slices_add(struct dicom_slices *slices, const char *name, uint32_t frame, bool is_frame,
                      const struct dicom_frame *is) {
    struct dicom_slice slice = {
        .name = strdup(name), .frame = frame, .is_frame = is_frame, .is = *is
    };
    if (!slice.name || !sp_grow(&slices->items, slices->count, sizeof slice)) {
        free(slice.name);
        return false;
    }
    slices->items[slices->count++] = slice; /* `is` may have been in the array */
    return true;
}

void dicom_slices_finish(struct dicom_slices *slices) {
    for (uint32_t i = 0; i < slices->count; i++)
        free(slices->items[i].name);
    free(slices->items);
    free(slices->plane);
    free(slices->times);
    *slices = (struct dicom_slices){ 0 };
}

struct by_text {
    const struct dicom_slice *items;
    enum dicom_trait text;
};

static int compare_texts(const void *a, const void *b, void *user) {
    const struct by_text *by = user;
    const uint32_t i = *(const uint32_t *)a, k = *(const uint32_t *)b;
    const int order = strcmp(by->items[i].is.texts[by->text], by->items[k].is.texts[by->text]);
    return order ? order : (i > k) - (i < k);
}

/* `order` is memory for as many numbers as slices. */
static void rank_text(struct dicom_slices *slices, enum dicom_trait text, uint32_t *order) {
    struct dicom_slice *s = slices->items;
    struct by_text by = { s, text };
    const int key = text == DICOM_TEXT_DIRECTION ? DICOM_KEY_DIRECTION : (int)text;
    uint32_t count = 0;
    double rank = 0;
    for (uint32_t i = 0; i < slices->count; i++)
        if (s[i].is.texts[text][0] && isnan(s[i].is.keys[key]))
            order[count++] = i;
    qsort_r(order, count, sizeof *order, compare_texts, &by);
    for (uint32_t i = 0; i < count; i++) {
        const char *own = s[order[i]].is.texts[text];
        const bool is_next = i == 0 || strcmp(own, s[order[i - 1]].is.texts[text]) != 0;
        rank += is_next;
        s[order[i]].is.keys[key] = rank;
    }
}

/* Directions have no order of their own: they are numbered as they come. The ranks are whole. */
static void number_directions(struct dicom_slices *slices, uint32_t *number) {
    uint32_t next = 0;
    memset(number, 0, slices->count * sizeof *number);
    for (uint32_t i = 0; i < slices->count; i++) {
        double *key = &slices->items[i].is.keys[DICOM_KEY_DIRECTION];
        if (!(*key >= 1 && *key <= slices->count))
            continue;
        uint32_t *own = &number[(uint32_t)*key - 1];
        *own = *own ? *own : ++next;
        *key = *own;
    }
}

bool dicom_slices_rank(struct dicom_slices *slices) {
    uint32_t *order = calloc(slices->count ? slices->count : 1, sizeof *order);
    for (int text = 0; order && text < DICOM_TEXT_COUNT; text++)
        rank_text(slices, (enum dicom_trait)text, order);
    if (order)
        number_directions(slices, order);
    const bool ok = order != NULL;
    free(order);
    return ok;
}

static int by_place(const void *a, const void *b) {
    const struct dicom_slice *p = a, *q = b;
    int order = dicom_compare_numbers(p->place, q->place);
    for (int key = 0; order == 0 && key < DICOM_KEYS_OF_ORDER; key++)
        order = dicom_compare_numbers(p->is.keys[key], q->is.keys[key]);
    if (order == 0)
        order = (p->is.instance > q->is.instance) - (p->is.instance < q->is.instance);
    if (order == 0)
        order = strcmp(p->name, q->name);
    return order ? order : (p->frame > q->frame) - (p->frame < q->frame);
}

void dicom_slices_keep(struct dicom_slices *slices,
                       bool (*is_kept)(const struct dicom_slice *slice, const void *user),
                       const void *user) {
    const uint32_t count = slices->count;
    slices->count = 0;
    for (uint32_t i = 0; i < count; i++)
        if (is_kept(&slices->items[i], user))
            slices->items[slices->count++] = slices->items[i];
        else
            free(slices->items[i].name);
}

/* Slices that are closer to each other than this share their place [mm]. */
static double same_place(const struct dicom_frame *is) {
    const double pixel = fmin(is->spacing[0], is->spacing[1]);
    return pixel > 0 ? SAME_SHARE * pixel : SAME_PLACE;
}

/* Slices of one place get the same one, so that sorting goes on with their keys. */
static void join_places(struct dicom_slices *slices) {
    const struct dicom_frame *first = &slices->items[0].is;
    const double near = first->is_placed ? same_place(first) : 0;
    struct dicom_slice *s = slices->items;
    slices->planes = 1;
    s[0].plane = 0;
    for (uint32_t i = 1; i < slices->count; i++) {
        if (s[i].place - s[i - 1].place <= near)
            s[i].place = s[i - 1].place;
        else
            slices->planes++;
        s[i].plane = slices->planes - 1;
    }
}

/* The number of the last plane at this distance from each other; 0 = they do not fit. */
static uint32_t last_of_grid(const struct dicom_slices *slices, double step) {
    for (uint32_t i = 1; i < slices->planes; i++) {
        const double n = (slices->plane[i].place - slices->plane[0].place) / step;
        if (!(n < SP_DIM_MAX - 0.5) || fabs(n - round(n)) > 0.05)
            return 0;
    }
    return (uint32_t)round((slices->plane[slices->planes - 1].place - slices->plane[0].place) /
                           step);
}

/* Adds planes without slices where places lie on a grid of their smallest distance, as files leave
 * out empty frames of segments. False if there is no memory. */
static bool fill_gaps(struct dicom_slices *slices) {
    const struct dicom_frame *first = &slices->items[0].is;
    double step = first->is_spaced ? fabs(first->spacing[2]) : INFINITY;
    for (uint32_t i = 1; i < slices->planes; i++)
        if (slices->plane[i].place - slices->plane[i - 1].place < step)
            step = slices->plane[i].place - slices->plane[i - 1].place;
    const uint32_t last = slices->planes > 1 ? last_of_grid(slices, step) : 0;
    if (last < slices->planes)
        return true;
    struct dicom_plane *filled = malloc((last + 1) * sizeof *filled);
    if (!filled)
        return false;
    const struct dicom_plane *a = &slices->plane[0], *b = &slices->plane[slices->planes - 1];
    for (uint32_t i = 0; i <= last; i++) {
        const double share = (double)i / last;
        filled[i].place = a->place + share * (b->place - a->place);
        for (int row = 0; row < 3; row++)
            filled[i].position[row] =
                a->position[row] + share * (b->position[row] - a->position[row]);
    }
    for (uint32_t i = 0; i < slices->count; i++) {
        struct dicom_slice *s = &slices->items[i];
        s->plane = (uint32_t)round((s->place - a->place) / (b->place - a->place) * last);
    }
    free(slices->plane);
    slices->plane = filled;
    slices->planes = last + 1;
    return true;
}

bool dicom_slices_sort(struct dicom_slices *slices) {
    if (slices->count == 0)
        return true;
    const struct dicom_frame *first = &slices->items[0].is;
    const struct sp_vec3 normal =
        sp_vec3_cross(sp_vec3_from(first->along[0]), sp_vec3_from(first->along[1]));
    for (uint32_t i = 0; i < slices->count; i++) {
        struct dicom_slice *s = &slices->items[i];
        const double place = sp_vec3_dot(sp_vec3_from(s->is.position), normal);
        s->place = !s->is.is_placed ? s->is.slot : slices->is_falling ? -place : place;
    }
    qsort(slices->items, slices->count, sizeof *slices->items, by_place);
    join_places(slices);
    qsort(slices->items, slices->count, sizeof *slices->items, by_place);
    free(slices->plane);
    slices->plane = malloc(slices->planes * sizeof *slices->plane);
    for (uint32_t i = slices->count; slices->plane && i-- > 0;) {
        const struct dicom_slice *s = &slices->items[i];
        slices->plane[s->plane].place = s->place;
        memcpy(slices->plane[s->plane].position, s->is.position, sizeof s->is.position);
    }
    return slices->plane && (!slices->has_gaps || fill_gaps(slices));
}

void dicom_slice_name(const struct dicom_slice *slice, char out[80]) {
    if (*slice->name && slice->is_frame)
        snprintf(out, 80, "frame %u of %.50s", slice->frame + 1, slice->name);
    else if (*slice->name)
        snprintf(out, 80, "%.60s", slice->name);
    else
        snprintf(out, 80, "frame %u", slice->frame + 1);
}
