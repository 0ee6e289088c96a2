/* SPDX-License-Identifier: Apache-2.0 */
#include "data/default_view/labels.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/volume/sample.h"

enum {
    SLOTS = 1 << 14,        /* of the table of numbers, a power of two */
    LABELS_MAX = SLOTS / 2, /* different numbers; more are no labels */
    FIRST_LOOKS = 1 << 21,  /* samples that tell whether they are labels */
    LOOKS_MAX = 1 << 26,    /* samples that tell which labels there are */
    LISTED = 126            /* labels with points of their own: two each, and two for 0 */
};

struct label {
    double number;
    uint64_t count, pairs,
        equal; /* samples; neighbours along axis 0 that are labels; of these, alike */
};

struct table {
    struct label slots[SLOTS];
    uint32_t used;
};

/* The place of a number, which becomes one of the table. NULL = there are too many. */
static struct label *find_or_add_label(struct table *t, double number) {
    uint64_t bits;
    memcpy(&bits, &number, sizeof bits);
    uint32_t at = (uint32_t)((bits ^ bits >> 29) * UINT64_C(0x9e3779b97f4a7c15) >> 40) % SLOTS;
    while (t->slots[at].count && t->slots[at].number != number)
        at = (at + 1) % SLOTS;
    if (!t->slots[at].count) {
        if (t->used == LABELS_MAX)
            return NULL;
        t->used++;
        t->slots[at].number = number;
    }
    return &t->slots[at];
}

/* Counts rows of samples, all of them or an even choice. False if there are numbers that are no
 * labels. */
static bool count(const struct sp_volume *volume, uint64_t looks, struct table *t) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    const uint32_t *dims = info->grid.dims;
    const void *voxels = sp_volume_voxels(volume);
    const uint64_t rows = (uint64_t)dims[1] * dims[2], step = 1 + rows * dims[0] / looks;
    for (uint64_t row = step / 2; row < rows; row += step) {
        struct label *before = NULL;
        for (uint32_t i = 0; i < dims[0]; i++) {
            const double number = sp_sample(voxels, info->type, row * dims[0] + i);
            struct label *label = NULL;
            if (!isfinite(number) || number == 0) {
                before = NULL;
                continue;
            }
            if (before && before->number == number)
                label = before;
            else if (trunc(number) != number || !(label = find_or_add_label(t, number)))
                return false;
            label->count++;
            if (before) {
                label->pairs++;
                label->equal += label == before;
            }
            before = label;
        }
    }
    return t->used > 0;
}

/* Few labels are numbered without large gaps: a mask of 0 and 255 has none. */
static bool are_numbers_of_labels(const struct table *t, const struct sp_volume_info *info) {
    enum { MANY = 8, GAPS = 4 };
    return info->range[0] >= 0 &&
           (t->used >= MANY || (t->used >= 2 && info->range[1] <= t->used + GAPS));
}

bool sp_default_are_labels(const struct sp_volume *volume) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    enum { PAIRS_MIN = 8 };
    const double alike = 0.6, most = 0.9;
    if (info->meaning != SP_MEANING_UNKNOWN)
        return info->meaning == SP_MEANING_LABELS;
    if (strncmp(info->source, "demo:", 5) == 0 || info->whole.dims[0])
        return false;
    struct table *t = calloc(1, sizeof *t);
    bool ok = t && count(volume, FIRST_LOOKS, t) && are_numbers_of_labels(t, info);
    uint32_t known = 0, whole = 0;
    uint64_t pairs = 0, equal = 0;
    for (uint32_t i = 0; ok && i < SLOTS; i++) {
        const struct label *label = &t->slots[i];
        if (label->pairs < PAIRS_MIN)
            continue;
        known++;
        whole += (double)label->equal >= alike * (double)label->pairs;
        pairs += label->pairs;
        equal += label->equal;
    }
    ok = ok && known >= 2 && (double)whole >= most * known && (double)equal >= 0.8 * (double)pairs;
    free(t);
    return ok;
}

static int compare(const void *a, const void *b) {
    const struct label *x = a, *y = b;
    return (x->number > y->number) - (x->number < y->number);
}

/* Hues that differ much for neighbouring numbers (by the golden ratio), in three degrees of
 * lightness. */
static void color_of(double number, float color[3]) {
    const double hue = fmod(fabs(number) * 0.61803398875, 1) * 6;
    const int tone = (int)fmod(fabs(number), 3);
    const double pale = tone == 1 ? 0.45 : 0.15, light = tone == 2 ? 0.75 : 1;
    for (int c = 0; c < 3; c++) {
        const double at = fmod(hue + 6 - 2 * c, 6); /* distance from the primary colour */
        const double pure = fmin(1, fmax(0, 2 - fmin(at, 6 - at)));
        color[c] = (float)(light * (pale + (1 - pale) * pure));
    }
}

/* The opacity at which a line of sight through a region as large as a cube of these samples has
 * this optical depth. */
static float opacity_of(double samples, double cell, double reference, double depth) {
    const double width = cbrt(fmax(samples, 1)) * cell;
    return (float)fmin(1 - exp(-depth * reference / width), 0.95);
}

static void add_point(struct sp_transfer_function *tf, double value, const float color[3],
                      float opacity) {
    if (tf->point_count == SP_TF_POINTS_MAX ||
        (tf->point_count && !(value > tf->points[tf->point_count - 1].value)))
        return;
    struct sp_tf_point *p = &tf->points[tf->point_count++];
    p->value = value;
    memcpy(p->color, color, sizeof p->color);
    p->opacity = opacity;
}

/* Adds labels in the order of their numbers. Where there are too many, several in a row have the
 * colour of the first one. A large label that holds most samples is seen through. */
static void add_labels(const struct label *labels, uint32_t n, const struct sp_volume_info *info,
                       struct sp_transfer_function *tf) {
    const double *spacing = info->grid.spacing, half = 0.45;
    const double cell = cbrt(spacing[0] * spacing[1] * spacing[2]);
    const float none[3] = { 0, 0, 0 };
    double all = 0;
    for (uint32_t i = 0; i < n; i++)
        all += (double)labels[i].count;
    const uint32_t group = (n + LISTED - 1) / LISTED;
    bool is_past_zero = false;
    tf->point_count = 0;
    for (uint32_t i = 0; i < n; i += group) {
        const uint32_t last = i + group < n ? i + group - 1 : n - 1;
        float color[3];
        if (labels[i].number > 0 && !is_past_zero) {
            add_point(tf, -half, none, 0);
            add_point(tf, half, none, 0);
            is_past_zero = true;
        }
        const bool is_most = n > 1 && (double)labels[i].count > 0.6 * all;
        const float opacity =
            opacity_of((double)labels[i].count, cell, tf->reference_length, is_most ? 1 : 4);
        color_of(labels[i].number, color);
        add_point(tf, labels[i].number - half, color, opacity);
        add_point(tf, labels[last].number + half, color, opacity);
    }
    if (!is_past_zero)
        add_point(tf, -half, none, 0);
}

bool sp_default_show_labels(const struct sp_volume *volume, struct sp_view *view) {
    struct sp_transfer_function *tf = &view->transfer_function;
    struct table *t = calloc(1, sizeof *t);
    const bool ok = t && count(volume, LOOKS_MAX, t);
    if (ok) {
        uint32_t n = 0;
        for (uint32_t i = 0; i < SLOTS; i++)
            if (t->slots[i].count)
                t->slots[n++] = t->slots[i];
        qsort(t->slots, n, sizeof *t->slots, compare);
        add_labels(t->slots, n, sp_volume_info(volume), tf);
        tf->order = SP_TF_PRE;
    }
    free(t);
    return ok;
}
