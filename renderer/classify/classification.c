/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/classification.h"

#include <assert.h>
#include <stdlib.h>

#include "classify/coarse.h"
#include "classify/collect.h"

bool sp_classify_cancelled(const struct sp_classify_job *job, struct sp_error *err) {
    if (!job->cancel || !atomic_load_explicit(job->cancel, memory_order_relaxed))
        return false;
    sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    return true;
}

/* May the classification grow by `more` bytes for `count` visible voxels? */
static bool may_grow(const struct sp_classification *c, const struct sp_classify_job *job,
                     uint64_t count, uint64_t more, struct sp_error *err) {
    uint64_t need = sp_classification_bytes(c) + more;
    if (job->bytes_max == 0 || need <= job->bytes_max)
        return true;
    return sp_fail(
        err, SP_ERR_BUDGET, "/transfer_function",
        "%llu voxels are visible, which takes %llu bytes beside the volume, and %llu are "
        "allowed: make fewer visible, or allow more memory",
        (unsigned long long)count, (unsigned long long)need, (unsigned long long)job->bytes_max);
}

static void drop_lists(struct sp_level *level) {
    sp_visible_finish(&level->visible);
    free(level->cells);
    level->cells = NULL;
}

void sp_level_finish(struct sp_level *level) {
    drop_lists(level);
    sp_transfer_finish(&level->transfer);
    for (int axis = 0; axis < 3; axis++)
        free(level->coordinates[axis]);
    free(level->ranges);
    *level = (struct sp_level){ 0 };
}

void sp_classification_init(struct sp_classification *c, struct sp_volume *volume) {
    *c = (struct sp_classification){ .volume = sp_volume_ref(volume) };
    c->levels[0].grid = sp_volume_info(volume)->grid;
}

void sp_classification_finish(struct sp_classification *c) {
    for (int l = 0; l < SP_LEVELS; l++)
        sp_level_finish(&c->levels[l]);
    sp_volume_unref(&c->volume);
}

static bool update_transfer(struct sp_classification *c, const struct sp_transfer_function *tf,
                            struct sp_error *err) {
    struct sp_level *all = &c->levels[0];
    if (sp_transfer_function_equal(&all->transfer.tf, tf))
        return true;
    struct sp_transfer next;
    if (!sp_transfer_init(&next, tf, sp_volume_info(c->volume), err))
        return false;
    if (!sp_transfer_same_voxels(&all->transfer, &next))
        drop_lists(all);
    for (int l = 1; l < SP_LEVELS; l++) /* they hold colours */
        sp_level_finish(&c->levels[l]);
    sp_transfer_finish(&all->transfer);
    all->transfer = next;
    return true;
}

/* Lists for post-classification are made for a kernel: a wider one needs more voxels, and for a
 * much narrower one it pays to leave some out. */
static void check_reach(struct sp_classification *c, const struct sp_classify_job *job) {
    struct sp_level *all = &c->levels[0];
    if (job->tf->order != SP_TF_POST || (job->reach <= all->reach && job->reach > 0.5 * all->reach))
        return;
    drop_lists(all);
    for (int l = 1; l < SP_LEVELS; l++)
        sp_level_finish(&c->levels[l]);
    all->reach = job->reach;
}

static bool collect_from(struct sp_classification *c, const struct sp_classify_job *job,
                         struct sp_collect_source *source, struct sp_error *err) {
    struct sp_level *all = &c->levels[0];
    struct sp_visible *list = &all->visible;
    if (!sp_collect_count(all, c->volume, job, source, err))
        return false;
    /* All that will follow is asked for at once, so that a refusal costs a pass and no memory. */
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

/* The list of all voxels, with normals if they are asked for. */
static bool update_all(struct sp_classification *c, const struct sp_classify_job *job,
                       struct sp_error *err) {
    struct sp_visible *list = &c->levels[0].visible;
    if (!list->first && !collect_voxels(c, job, err)) {
        drop_lists(&c->levels[0]);
        return false;
    }
    bool wide = sp_transfer_wants_magnitudes(job->tf);
    if (!job->normals || (list->normal && (!wide || list->normal_bytes == 4)))
        return true;
    free(list->normal);
    list->normal = NULL;
    list->normal_bytes = wide ? 4 : list->normal_bytes;
    return may_grow(c, job, list->count, list->count * list->normal_bytes, err) &&
           sp_collect_normals(&c->levels[0], c->volume, job, err);
}

/* The same of a coarse level, from the next finer one. */
static bool update_coarse(struct sp_classification *c, unsigned l,
                          const struct sp_classify_job *job, struct sp_error *err) {
    struct sp_level *level = &c->levels[l];
    if (level->visible.first && (!job->normals || level->visible.normal))
        return true;
    sp_level_finish(level);
    struct sp_classify_job rest = *job;
    uint64_t have = sp_classification_bytes(c);
    if (job->bytes_max)
        rest.bytes_max = have < job->bytes_max ? job->bytes_max - have : 1;
    if (sp_coarse_make(level, &c->levels[l - 1], &rest, err))
        return true;
    sp_level_finish(level);
    return false;
}

static bool turn(const struct sp_visible *list, const struct sp_classify_job *job,
                 struct sp_error *err) {
    unsigned axis = job->axis < SP_NO_AXIS ? job->axis : 2;
    return sp_visible_turn(list, axis, job->pool, job->cancel) ||
           sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
}

bool sp_classification_update(struct sp_classification *c, const struct sp_classify_job *job,
                              struct sp_error *err) {
    assert(job->axis <= SP_NO_AXIS && job->level < SP_LEVELS);
    if (!update_transfer(c, job->tf, err))
        return false;
    check_reach(c, job);
    if (!update_all(c, job, err))
        return false;
    for (unsigned l = 1; l <= job->level; l++)
        if (!update_coarse(c, l, job, err))
            return false;
    return turn(&c->levels[job->level].visible, job, err);
}

uint64_t sp_classification_bytes(const struct sp_classification *c) {
    uint64_t bytes = 0;
    for (int l = 0; l < SP_LEVELS; l++) {
        const struct sp_level *level = &c->levels[l];
        bytes += level->transfer.count * (uint64_t)(sizeof(struct sp_class) + 1) +
                 sp_visible_bytes(&level->visible);
        if (level->ranges)
            bytes += sp_visible_bricks(&level->visible) * (uint64_t)sizeof *level->ranges;
    }
    return bytes;
}
