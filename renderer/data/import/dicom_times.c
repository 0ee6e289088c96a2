/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/dicom_times.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { LIST = 140 }; /* bytes of the names in a warning */

#define DAY 86400.0 /* [s] */

struct times {
    const struct dicom_slices *slices;
    uint32_t *time;       /* owned; of each slice, from 0 */
    uint32_t *order;      /* owned; the slices in the order of their keys */
    uint32_t *count;      /* owned; slices of each time, or of each plane; or the ranks of planes */
    uint32_t times, most; /* times; slices of the plane that has most */
    uint32_t places;      /* planes that have slices */
    /* Leaves out the times that lack planes, the planes that lack times, or all times but one. */
    enum { DROP_TIMES, DROP_PLANES, KEEP_TIME } rule;
    uint32_t kept; /* of KEEP_TIME, the only time that stays */
};

/* Times are at most as many as slices. Planes may be more, because some have none. */
static size_t count_groups(const struct dicom_slices *slices) {
    return slices->planes > slices->count ? slices->planes : slices->count;
}

static bool create(struct times *t, const struct dicom_slices *slices) {
    const uint32_t count = slices->count;
    *t = (struct times){ .slices = slices,
                         .time = calloc(count, sizeof *t->time),
                         .order = calloc(count, sizeof *t->order),
                         .count = calloc(count_groups(slices), sizeof *t->count) };
    for (uint32_t i = 0, run = 0; t->order && i < count; i++) {
        const bool is_next = i == 0 || slices->items[i].plane != slices->items[i - 1].plane;
        t->order[i] = i;
        t->places += is_next;
        run = is_next ? 1 : run + 1;
        t->most = run > t->most ? run : t->most;
    }
    return t->time && t->order && t->count;
}

static void finish(struct times *t) {
    free(t->time);
    free(t->order);
    free(t->count);
}

/* A key gives the times if it has as many values as the fullest place has slices. */

struct by_key {
    const struct dicom_slice *items;
    enum dicom_key key;
};

static int compare_keys(const void *a, const void *b, void *user) {
    const struct by_key *by = user;
    const double x = by->items[*(const uint32_t *)a].is.keys[by->key];
    const double y = by->items[*(const uint32_t *)b].is.keys[by->key];
    return (x > y) - (x < y);
}

static bool number_by_key(struct times *t, enum dicom_key key) {
    const struct dicom_slice *s = t->slices->items;
    struct by_key by = { s, key };
    for (uint32_t i = 0; i < t->slices->count; i++)
        if (isnan(s[i].is.keys[key]) ||
            (i > 0 && s[i].plane == s[i - 1].plane && s[i].is.keys[key] == s[i - 1].is.keys[key]))
            return false;
    qsort_r(t->order, t->slices->count, sizeof *t->order, compare_keys, &by);
    t->times = 0;
    for (uint32_t i = 0; i < t->slices->count; i++) {
        const bool is_next =
            i == 0 || s[t->order[i]].is.keys[key] != s[t->order[i - 1]].is.keys[key];
        t->times += is_next;
        t->time[t->order[i]] = t->times - 1;
    }
    return t->times == t->most;
}

/* The order of the images: one time after the other, each with its places in the same order. */

static int compare_numbers(const void *a, const void *b, void *items) {
    const struct dicom_slice *p = (const struct dicom_slice *)items + *(const uint32_t *)a;
    const struct dicom_slice *q = (const struct dicom_slice *)items + *(const uint32_t *)b;
    const double x = p->is.keys[DICOM_KEY_CLOCK], y = q->is.keys[DICOM_KEY_CLOCK];
    if (x < y || x > y)
        return x < y ? -1 : 1;
    return (p->is.instance > q->is.instance) - (p->is.instance < q->is.instance);
}

/* Where each plane comes in the first time. False if one is not there: the times stay unknown. */
static bool compute_ranks(const struct times *t, uint32_t *rank) {
    const struct dicom_slices *slices = t->slices;
    for (uint32_t i = 0; i < t->places; i++) {
        const uint32_t plane = slices->items[t->order[i]].plane;
        if (rank[plane])
            return false;
        rank[plane] = i + 1;
    }
    return true;
}

static bool number_by_order(struct times *t) {
    const struct dicom_slices *slices = t->slices;
    uint32_t *rank = t->count, before = 0;
    memset(rank, 0, count_groups(slices) * sizeof *rank);
    qsort_r(t->order, slices->count, sizeof *t->order, compare_numbers, slices->items);
    if (!compute_ranks(t, rank))
        return false;
    t->times = 1;
    for (uint32_t i = 0; i < slices->count; i++) {
        const uint32_t own = rank[slices->items[t->order[i]].plane];
        t->times += own <= before;
        before = own;
        t->time[t->order[i]] = t->times - 1;
    }
    return t->times == t->most;
}

/* What is left out. */

static uint32_t count_full(struct times *t, bool of_planes) {
    const struct dicom_slices *slices = t->slices;
    const uint32_t groups = of_planes ? slices->planes : t->times;
    const uint32_t wanted = of_planes ? t->times : t->places;
    uint32_t full = 0;
    memset(t->count, 0, count_groups(slices) * sizeof *t->count);
    for (uint32_t i = 0; i < slices->count; i++)
        t->count[of_planes ? slices->items[i].plane : t->time[i]]++;
    for (uint32_t i = 0; i < groups; i++)
        full += t->count[i] == wanted;
    return full;
}

static bool is_complete(const struct dicom_slice *slice, const void *user) {
    const struct times *t = user;
    const uint32_t time = t->time[slice - t->slices->items];
    return t->rule == KEEP_TIME     ? time == t->kept
           : t->rule == DROP_PLANES ? t->count[slice->plane] == t->times
                                    : t->count[time] == t->places;
}

/* The first image of the file that was opened; −1 = there is none, or a folder was opened. */
static int64_t find_opened(const struct times *t, const struct dicom_source *source) {
    const struct dicom_slices *slices = t->slices;
    for (uint32_t i = 0; i < slices->count && source->is_named; i++)
        if (*slices->items[i].name && strcmp(slices->items[i].name, source->name) == 0)
            return i;
    return -1;
}

/* True if this rule leaves images, among them the image that was opened. */
static bool try_rule(struct times *t, int64_t opened) {
    return count_full(t, t->rule == DROP_PLANES) > 0 &&
           (opened < 0 || is_complete(&t->slices->items[opened], t));
}

/* Leaves out whichever is less, since a gap in space is worse than one in time; but the image that
 * was opened stays, if need be with its own time alone. */
static bool choose_rule(struct times *t, int64_t opened) {
    const uint32_t planes = count_full(t, true) * t->times;
    const uint32_t times = count_full(t, false) * t->places;
    t->rule = 2 * times < planes ? DROP_PLANES : DROP_TIMES;
    if (times == 0 && planes == 0 && opened < 0)
        return false;
    if (try_rule(t, opened))
        return true;
    t->rule = t->rule == DROP_PLANES ? DROP_TIMES : DROP_PLANES;
    if (try_rule(t, opened))
        return true;
    t->rule = KEEP_TIME;
    t->kept = opened < 0 ? 0 : t->time[opened];
    return opened >= 0;
}

static bool leave_out(struct times *t, struct dicom_slices *slices,
                      const struct dicom_source *source, struct sp_error *err) {
    const char *const what[] = { [DROP_TIMES] = "incomplete times that lack places",
                                 [DROP_PLANES] = "incomplete places that lack times",
                                 [KEEP_TIME] = "other times than that of the file" };
    struct import_list list;
    char text[LIST] = "";
    const uint32_t before = slices->count;
    import_list_begin(&list, text, LIST);
    for (uint32_t i = 0; i < before; i++)
        if (!is_complete(&slices->items[i], t)) {
            char name[80];
            dicom_slice_name(&slices->items[i], name);
            import_list_add(&list, list.used ? ", " : "", name);
        }
    import_list_end(&list, false);
    dicom_slices_keep(slices, is_complete, t);
    import_warn(source->file->warnings, "Left out %u %s of %s: %s.", before - slices->count,
                before - slices->count > 1 ? "images" : "image", what[t->rule], text);
    return dicom_slices_sort(slices) ||
           sp_fail(err, SP_ERR_MEMORY, source->file->title, "out of memory for the slices");
}

/* The last time of the morning: the one before the widest gap, if that is longer than half a day.
 * −1 = no time is before noon, or there is no such gap. */
static double last_of_morning(const struct dicom_slices *slices) {
    const struct dicom_slice *s = slices->items;
    double last = -1;
    for (uint32_t i = 0; i < slices->count; i++)
        if (s[i].is.keys[DICOM_KEY_CLOCK] < DAY / 2)
            last = fmax(last, s[i].is.keys[DICOM_KEY_CLOCK]);
    for (uint32_t i = 0; i < slices->count; i++)
        if (s[i].is.keys[DICOM_KEY_CLOCK] > last && s[i].is.keys[DICOM_KEY_CLOCK] <= last + DAY / 2)
            return -1;
    return last;
}

void dicom_times_pass_midnight(struct dicom_slices *slices) {
    struct dicom_slice *s = slices->items;
    for (uint32_t i = 0; i < slices->count; i++)
        if (!(s[i].is.keys[DICOM_KEY_CLOCK] < DAY)) /* with a date, or not known */
            return;
    const double morning = last_of_morning(slices);
    bool has_evening = false;
    for (uint32_t i = 0; i < slices->count; i++)
        has_evening |= s[i].is.keys[DICOM_KEY_CLOCK] > morning;
    for (uint32_t i = 0; i < slices->count && has_evening; i++)
        if (s[i].is.keys[DICOM_KEY_CLOCK] <= morning)
            s[i].is.keys[DICOM_KEY_CLOCK] += DAY;
}

bool dicom_times_complete(struct dicom_slices *slices, const struct dicom_source *source,
                          struct sp_error *err) {
    static const enum dicom_key keys[] = { DICOM_KEY_PHASE, DICOM_KEY_PERCENT, DICOM_KEY_DELAY,
                                           DICOM_KEY_CLOCK, DICOM_KEY_ACQUISITION };
    struct times t;
    bool ok = create(&t, slices), is_known = false;
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, source->file->title, "out of memory for the times");
    for (size_t i = 0; ok && !is_known && i < sizeof keys / sizeof *keys; i++)
        is_known = number_by_key(&t, keys[i]);
    /* The number of a frame is only its place in the file. */
    is_known = is_known || (ok && source->image.frames <= 1 && number_by_order(&t));
    if (is_known && choose_rule(&t, find_opened(&t, source)))
        ok = leave_out(&t, slices, source, err);
    finish(&t);
    return ok;
}
