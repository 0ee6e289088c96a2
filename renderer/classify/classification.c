/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/classification.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "classify/change.h"
#include "classify/collect.h"
#include "classify/dense.h"
#include "classify/depths.h"
#include "classify/mip.h"
#include "sp/renderer.h"

/* True if the classification may grow by `more` bytes for `count` visible voxels. */
static bool may_grow(const struct sp_classification *c, const struct sp_classify_job *job,
                     uint64_t count, uint64_t more, struct sp_error *err) {
    uint64_t need = sp_classification_bytes(c) + more;
    if (job->bytes_max == 0 || need <= job->bytes_max)
        return true;
    return sp_fail(
        err, SP_ERR_BUDGET, "/transfer_function",
        "%llu voxels are visible and need %llu bytes in addition to the volume; %llu are "
        "allowed: make fewer visible, or allow more memory",
        (unsigned long long)count, (unsigned long long)need, (unsigned long long)job->bytes_max);
}

void sp_classification_init(struct sp_classification *c, struct sp_volume *volume) {
    *c = (struct sp_classification){ .volume = sp_volume_ref(volume) };
    c->levels[0].grid = sp_volume_info(volume)->grid;
}

void sp_classification_finish(struct sp_classification *c) {
    for (int l = 0; l < SP_LEVELS; l++)
        sp_level_finish(&c->levels[l]);
    free(c->histogram);
    c->histogram = NULL;
    sp_volume_unref(&c->volume);
}

static bool need_histogram(struct sp_classification *c, const struct sp_classify_job *job,
                           struct sp_error *err) {
    const struct sp_transfer *transfer = &c->levels[0].transfer;
    if (c->histogram)
        return true;
    if (!job->counter) {
        c->histogram = sp_collect_histogram(transfer, c->volume, job->pool, err);
        return c->histogram != NULL;
    }
    c->histogram = calloc(transfer->count, sizeof *c->histogram);
    if (!c->histogram)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory while counting %u values",
                       transfer->count);
    if (job->counter->histogram(job->counter->user, c, c->histogram, err))
        return true;
    free(c->histogram);
    c->histogram = NULL;
    return false;
}

bool sp_classification_fit(struct sp_classification *c, const struct sp_transfer *to,
                           const struct sp_classify_job *job, struct sp_fit *fit,
                           struct sp_error *err) {
    const struct sp_level *all = &c->levels[0];
    *fit = (struct sp_fit){ 0 };
    if (!all->listed || !sp_change_is_possible(&all->transfer, to) || !need_histogram(c, job, err))
        return false;
    for (uint32_t k = 0; k < to->count; k++) {
        fit->visible += to->is_visible[k] ? c->histogram[k] : 0;
        fit->missing += to->is_visible[k] > all->listed[k] ? c->histogram[k] : 0;
        fit->excess += to->is_visible[k] < all->listed[k] ? c->histogram[k] : 0;
    }
    return true;
}

bool sp_fit_is_close(const struct sp_fit *fit) {
    return fit->missing == 0 && fit->excess <= fit->visible / 4;
}

/* True if the list has all voxels that `next` shows and not too many others. */
static bool keeps_list(struct sp_classification *c, const struct sp_transfer *next,
                       const struct sp_classify_job *job) {
    struct sp_fit fit;
    return sp_transfer_same_voxels(&c->levels[0].transfer, next) ||
           (sp_classification_fit(c, next, job, &fit, NULL) && sp_fit_is_close(&fit));
}

static bool update_transfer(struct sp_classification *c, const struct sp_classify_job *job,
                            struct sp_error *err) {
    struct sp_level *all = &c->levels[0];
    if (sp_transfer_function_equal(&all->transfer.tf, job->tf))
        return true;
    struct sp_transfer next;
    if (!sp_transfer_init(&next, job->tf, sp_volume_info(c->volume), &all->transfer, err))
        return false;
    if (!keeps_list(c, &next, job))
        sp_level_drop_list(all);
    for (int l = 1; l < SP_LEVELS; l++) /* they hold colours */
        sp_level_finish(&c->levels[l]);
    sp_transfer_finish(&all->transfer);
    all->transfer = next;
    all->table_made = 0;
    sp_level_drop_depths(all);
    return true;
}

static void drop_all_lists(struct sp_classification *c) {
    sp_level_drop_list(&c->levels[0]);
    for (int l = 1; l < SP_LEVELS; l++)
        sp_level_finish(&c->levels[l]);
}

/* A list for post-classification fits one kernel radius. A larger radius needs more voxels; for a
 * much smaller radius a shorter list is faster. */
static void check_reach(struct sp_classification *c, const struct sp_classify_job *job) {
    struct sp_level *all = &c->levels[0];
    if (job->tf->order != SP_TF_POST || (job->reach <= all->reach && job->reach > 0.5 * all->reach))
        return;
    drop_all_lists(c);
    all->reach = job->reach;
}

/* Lists by key have the same length on every processor. Lists by value may be rounded differently,
 * so a processor counts the lists that it fills. */
static void check_maker(struct sp_classification *c, const struct sp_classify_job *job) {
    const struct sp_level *all = &c->levels[0];
    bool is_ours = !job->counter, was_ours = all->visible.place != NULL;
    if (all->visible.first && !all->listed && is_ours != was_ours)
        drop_all_lists(c);
}

/* Adds the keys next to the listed ones, for at most an eighth of the visible voxels: the next
 * edits are likely to show these. */
static bool widen(struct sp_classification *c, uint8_t *listed, struct sp_error *err) {
    const struct sp_transfer *t = &c->levels[0].transfer;
    uint32_t *distance = malloc(t->count * sizeof *distance), near = t->count, reach = 0;
    uint64_t *added = calloc(t->count + (size_t)1, sizeof *added), visible = 0, more = 0;
    if (!distance || !added) {
        free(distance);
        free(added);
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for %u values", t->count);
    }
    for (uint32_t k = 0; k < t->count; k++) {
        near = listed[k] ? 0 : near < t->count ? near + 1 : near;
        distance[k] = near;
    }
    near = t->count;
    for (uint32_t k = t->count; k-- > 0;) {
        near = listed[k] ? 0 : near < t->count ? near + 1 : near;
        distance[k] = near < distance[k] ? near : distance[k];
        added[distance[k]] += c->histogram[k];
    }
    visible = added[0];
    while (reach + 1 < t->count && more + added[reach + 1] <= visible / 8)
        more += added[++reach];
    for (uint32_t k = 0; k < t->count; k++)
        listed[k] = distance[k] <= reach;
    free(distance);
    free(added);
    return true;
}

/* Chooses the keys of a new list. */
static bool choose_listed(struct sp_classification *c, const struct sp_classify_job *job,
                          struct sp_error *err) {
    struct sp_level *all = &c->levels[0];
    const struct sp_transfer *t = &all->transfer;
    if (!t->table || t->tf.order == SP_TF_POST)
        return true;
    all->listed = malloc(t->count);
    if (!all->listed)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for %u values", t->count);
    memcpy(all->listed, t->is_visible, t->count);
    return !job->widens || (need_histogram(c, job, err) && widen(c, all->listed, err));
}

/* Counts the visible voxels in the finest list. */
static bool count_visible(struct sp_classification *c, const struct sp_classify_job *job,
                          struct sp_error *err) {
    const struct sp_level *all = &c->levels[0];
    const struct sp_transfer *t = &all->transfer;
    c->visible = all->visible.count;
    if (!all->listed || memcmp(all->listed, t->is_visible, t->count) == 0)
        return true;
    if (!need_histogram(c, job, err))
        return false;
    c->visible = 0;
    for (uint32_t k = 0; k < t->count; k++)
        c->visible += t->is_visible[k] ? c->histogram[k] : 0;
    return true;
}

/* Counts a list through job->counter, whose owner holds the entries. */
static bool count_elsewhere(struct sp_classification *c, unsigned l, uint32_t key_bytes,
                            uint32_t normal_bytes, const struct sp_classify_job *job,
                            struct sp_error *err) {
    struct sp_level *level = &c->levels[l];
    struct sp_visible *list = &level->visible;
    if (!sp_visible_init(list, level->grid.dims, key_bytes, normal_bytes, err) ||
        !job->counter->count(job->counter->user, c, l, list->first + 1, err))
        return false;
    sp_visible_sum(list);
    return true;
}

static bool collect_from(struct sp_classification *c, const struct sp_classify_job *job,
                         struct sp_collect_source *source, struct sp_error *err) {
    struct sp_level *all = &c->levels[0];
    struct sp_visible *list = &all->visible;
    if (!choose_listed(c, job, err))
        return false;
    uint32_t key_bytes = sp_transfer_key_bytes(&all->transfer);
    if (job->counter)
        return count_elsewhere(c, 0, key_bytes,
                               key_bytes > 2 || sp_transfer_wants_magnitudes(job->tf) ? 4 : 2, job,
                               err);
    if (!sp_collect_count(all, c->volume, job, source, err))
        return false;
    /* The budget for all of the following is checked at once, so that a refusal costs one pass but
     * no memory. */
    uint64_t count = list->count, more = sp_visible_entry_bytes(list, count, job->normals);
    list->count = 0; /* not there yet */
    if (!may_grow(c, job, count, more, err))
        return false;
    list->count = count;
    return sp_collect_fill(all, c->volume, job, source, err);
}

static bool collect_voxels(struct sp_classification *c, const struct sp_classify_job *job,
                           struct sp_error *err) {
    struct sp_collect_source source = { 0 };
    bool ok = collect_from(c, job, &source, err);
    sp_change_finish(&source.change);
    return ok;
}

/* A list, widened if there is memory for it. */
static bool make_list(struct sp_classification *c, const struct sp_classify_job *job,
                      struct sp_error *err) {
    struct sp_classify_job exact = *job;
    struct sp_error why = { 0 };
    exact.widens = false;
    if (collect_voxels(c, job, &why))
        return true;
    sp_level_drop_list(&c->levels[0]);
    bool was_widened = job->widens && why.code == SP_ERR_BUDGET;
    if (was_widened && collect_voxels(c, &exact, &why))
        return true;
    sp_level_drop_list(&c->levels[0]);
    if (err)
        *err = why;
    return false;
}

/* The entries of a list that was counted elsewhere. */
static bool fill_list(struct sp_classification *c, const struct sp_classify_job *job,
                      struct sp_error *err) {
    struct sp_level *all = &c->levels[0];
    const struct sp_collect_source source = { 0 };
    uint64_t count = all->visible.count;
    if (may_grow(c, job, count, sp_visible_entry_bytes(&all->visible, count, job->normals), err) &&
        sp_collect_fill(all, c->volume, job, &source, err))
        return true;
    sp_level_drop_list(all);
    return false;
}

/* The list of all voxels, with normals if they are asked for. */
static bool update_all(struct sp_classification *c, const struct sp_classify_job *job,
                       struct sp_error *err) {
    struct sp_visible *list = &c->levels[0].visible;
    bool wide = sp_transfer_wants_magnitudes(job->tf);
    if (!list->first && !make_list(c, job, err))
        return false;
    if (wide && list->normal_bytes < 4) {
        free(list->normal);
        list->normal = NULL;
        list->normal_bytes = 4;
    }
    if (job->counter)
        return true;
    if (!list->place && !fill_list(c, job, err))
        return false;
    if (!job->normals || list->normal)
        return true;
    c->levels[0].list_made = 0;
    return may_grow(c, job, list->count, list->count * list->normal_bytes, err) &&
           sp_collect_normals(&c->levels[0], c->volume, job, err);
}

static bool has_list(const struct sp_level *level, const struct sp_classify_job *job) {
    const struct sp_visible *list = &level->visible;
    return list->first && (job->counter || (list->place && (!job->normals || list->normal)));
}

static bool count_coarse(struct sp_classification *c, unsigned l, const struct sp_classify_job *job,
                         struct sp_error *err) {
    struct sp_level *level = &c->levels[l];
    bool is_post = job->tf->order == SP_TF_POST;
    level->transfer.base = is_post ? sp_transfer_base(&c->levels[l - 1].transfer) : 0;
    if (sp_mip_grid(level, &c->levels[l - 1].grid, err) &&
        count_elsewhere(c, l, 4, is_post ? 4 : sizeof(struct sp_microflakes), job, err))
        return true;
    sp_level_finish(level);
    return false;
}

/* The same of a coarse level, from the next finer one. */
static bool update_coarse(struct sp_classification *c, unsigned l,
                          const struct sp_classify_job *job, struct sp_error *err) {
    struct sp_level *level = &c->levels[l];
    if (has_list(level, job))
        return true;
    sp_level_finish(level);
    if (job->counter)
        return count_coarse(c, l, job, err);
    struct sp_classify_job rest = *job;
    uint64_t have = sp_classification_bytes(c);
    if (job->bytes_max)
        rest.bytes_max = have < job->bytes_max ? job->bytes_max - have : 1;
    if (sp_mip_make(level, &c->levels[l - 1], &rest, err))
        return true;
    sp_level_finish(level);
    return false;
}

static bool turn(struct sp_classification *c, unsigned l, const struct sp_classify_job *job,
                 struct sp_error *err) {
    const struct sp_visible *list = &c->levels[l].visible;
    struct sp_class *classes = l > 0 ? c->levels[l].transfer.table : NULL; /* of its entries */
    unsigned axis = job->axis < SP_NO_AXIS ? job->axis : 2;
    return !list->place || sp_dense_turn(list, classes, axis, job->pool, job->cancel) ||
           sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
}

/* Only sheets need the depths of their slices. */
static bool update_depths(struct sp_level *level, const struct sp_classify_job *job,
                          struct sp_error *err) {
    bool is_needed = job->axis < SP_NO_AXIS && job->tf->order == SP_TF_PRE;
    return !is_needed || !level->visible.place || sp_depths_update(level, job, err);
}

/* Assigns serial numbers to the new lists and tables. */
static void count_made(struct sp_level *level, uint64_t *made) {
    if (made && !level->list_made)
        level->list_made = ++*made;
    if (made && !level->table_made)
        level->table_made = ++*made;
}

bool sp_classification_update(struct sp_classification *c, const struct sp_classify_job *job,
                              struct sp_error *err) {
    assert(job->axis <= SP_NO_AXIS && job->levels && job->levels < 1u << SP_LEVELS);
    assert(!job->counter || job->made);
    if (!update_transfer(c, job, err))
        return false;
    check_reach(c, job);
    check_maker(c, job);
    if (!update_all(c, job, err) || !count_visible(c, job, err))
        return false;
    count_made(&c->levels[0], job->made);
    for (unsigned l = 1; job->levels >> l;
         l++) { /* each level is computed from the next finer one */
        if (!update_coarse(c, l, job, err))
            return false;
        count_made(&c->levels[l], job->made);
    }
    for (unsigned l = 0; job->levels >> l; l++)
        if (job->levels >> l & 1 &&
            !(turn(c, l, job, err) && update_depths(&c->levels[l], job, err)))
            return false;
    return true;
}

uint64_t sp_classification_bytes(const struct sp_classification *c) {
    const struct sp_transfer *t = &c->levels[0].transfer;
    uint64_t bytes = c->histogram ? t->count * (uint64_t)sizeof *c->histogram : 0;
    for (int l = 0; l < SP_LEVELS; l++) {
        const struct sp_level *level = &c->levels[l];
        bytes += level->transfer.count * (uint64_t)(sizeof(struct sp_class) + 1) +
                 sp_visible_bytes(&level->visible);
        bytes += level->listed ? level->transfer.count : 0;
        for (int axis = 0; axis < 3; axis++)
            if (level->depths[axis])
                bytes += sp_visible_bricks(&level->visible) * (uint64_t)sizeof *level->depths[0];
        if (level->ranges)
            bytes += sp_visible_bricks(&level->visible) * (uint64_t)sizeof *level->ranges;
    }
    return bytes;
}
