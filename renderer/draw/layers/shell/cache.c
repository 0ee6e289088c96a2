/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/shell/cache.h"

#include <stdlib.h>
#include <string.h>

#include "data/volume/volume.h"

enum { REPEATS = 8 }; /* frames of one shell after which its edits have stopped */

static void finish_slot(void *pointer) {
    struct sp_shell_slot *slot = pointer;
    sp_voxel_list_finish(&slot->list);
    sp_voxel_list_finish(&slot->clipped);
    sp_shell_masks_finish(&slot->masks);
    sp_transfer_finish(&slot->transfer);
}

static uint64_t slot_bytes(const void *pointer) {
    const struct sp_shell_slot *slot = pointer;
    uint64_t bytes = sp_voxel_list_bytes(&slot->list) + sp_voxel_list_bytes(&slot->clipped);
    if (slot->masks.ranges)
        bytes += sp_shell_masks_bytes(slot->masks.dims);
    if (slot->transfer.table)
        bytes += slot->transfer.count * (sizeof *slot->transfer.table + 1);
    return bytes;
}

static const struct sp_slots slots = { SP_SHELL_SLOTS, sizeof(struct sp_shell_slot), finish_slot,
                                       slot_bytes };

void sp_shell_evict(struct sp_shell_cache *cache, const struct sp_volume *volume) {
    sp_slots_evict(&slots, cache->slots, volume);
}

uint64_t sp_shell_bytes(const struct sp_shell_cache *cache, const struct sp_volume *volume) {
    return sp_slots_bytes(&slots, cache->slots, volume);
}

/* The order and the reference length have no influence on a shell. */
static bool has_tf(const struct sp_shell_slot *slot, const struct sp_transfer_function *tf) {
    struct sp_transfer_function wanted = *tf;
    wanted.order = slot->transfer.tf.order;
    wanted.reference_length = slot->transfer.tf.reference_length;
    return sp_transfer_function_equal(&slot->transfer.tf, &wanted);
}

static bool is_wanted(const struct sp_shell_slot *slot, const struct sp_shell_job *job) {
    return slot->base.volume == job->volume && slot->low == job->low && slot->high == job->high &&
           has_tf(slot, job->tf);
}

static bool start_masks(struct sp_shell_slot *slot, const struct sp_shell_slot *like,
                        const struct sp_shell_job *job, struct sp_error *err) {
    const uint32_t *dims = sp_volume_info(job->volume)->grid.dims;
    uint64_t bytes = sp_shell_masks_bytes(dims);
    if (bytes > job->bytes_max)
        return sp_fail(err, SP_ERR_BUDGET, "/layers",
                       "the shell's masks need %llu bytes, %llu may be used",
                       (unsigned long long)bytes, (unsigned long long)job->bytes_max);
    if (!sp_shell_masks_init(&slot->masks, dims, err))
        return false;
    size_t blocks = (size_t)slot->masks.words * slot->masks.sides[0] * slot->masks.sides[1];
    if (like)
        memcpy(slot->masks.ranges, like->masks.ranges, blocks * sizeof *slot->masks.ranges);
    else
        sp_shell_masks_measure(&slot->masks, job->volume, job->pool, &job->interrupt);
    return true;
}

/* The input of an update of a slot. */
struct update {
    struct sp_transfer transfer; /* the new one */
    struct sp_shell_states from, to;
    uint8_t *changed;
};

static void finish_update(struct update *u) {
    sp_shell_states_finish(&u->from);
    sp_shell_states_finish(&u->to);
    free(u->changed);
    sp_transfer_finish(&u->transfer);
}

static bool init_update(struct update *u, const struct sp_shell_slot *slot,
                        const struct sp_shell_job *job, struct sp_error *err) {
    const struct sp_transfer *like = slot->transfer.tf.point_count ? &slot->transfer : NULL;
    size_t sides = (size_t)slot->masks.sides[0] * slot->masks.sides[1];
    *u = (struct update){ 0 };
    if (!sp_transfer_init(&u->transfer, job->tf, sp_volume_info(job->volume), like, err) ||
        !sp_shell_states_init(&u->to, &u->transfer, job->low, job->high, err) ||
        (slot->list.first &&
         !sp_shell_states_init(&u->from, &slot->transfer, slot->low, slot->high, err)))
        return false;
    u->changed = malloc(sides);
    return u->changed ||
           sp_fail(err, SP_ERR_MEMORY, "/layers", "out of memory for %zu blocks", sides);
}

/* Brings the masks and the list of a slot up to date; the slot is useless after a failure. */
static bool update_slot(struct sp_shell_slot *slot, const struct sp_shell_job *job,
                        struct update *u, struct sp_error *err) {
    bool is_new = !slot->list.first;
    struct sp_voxel_list list;
    sp_shell_masks_update(&slot->masks, job->volume, is_new ? NULL : &u->from, &u->to, u->changed,
                          job->pool, &job->interrupt);
    struct sp_shell_extract extract = { .masks = &slot->masks,
                                        .states = &u->to,
                                        .volume = job->volume,
                                        .from = is_new ? NULL : &slot->list,
                                        .changed = u->changed,
                                        .same_classes = !is_new && has_tf(slot, job->tf),
                                        .bytes_max =
                                            job->bytes_max - sp_shell_masks_bytes(slot->masks.dims),
                                        .pool = job->pool,
                                        .interrupt = &job->interrupt };
    if (!sp_shell_extract(&extract, &list, err))
        return false;
    sp_voxel_list_finish(&slot->list);
    sp_voxel_list_finish(&slot->clipped);
    slot->list = list;
    struct sp_transfer old = slot->transfer;
    slot->transfer = u->transfer;
    u->transfer = old;
    slot->low = job->low;
    slot->high = job->high;
    return true;
}

static bool renew(struct sp_shell_slot *slot, const struct sp_shell_job *job,
                  struct sp_error *err) {
    struct update update;
    bool ok = init_update(&update, slot, job, err) && update_slot(slot, job, &update, err);
    finish_update(&update);
    return ok;
}

/* Returns the slot with the whole shell, or NULL. */
static struct sp_shell_slot *get_shell(struct sp_shell_cache *cache, const struct sp_shell_job *job,
                                       struct sp_error *err) {
    for (int i = 0; i < SP_SHELL_SLOTS; i++)
        if (is_wanted(&cache->slots[i], job)) {
            cache->slots[i].repeats++;
            return &cache->slots[i];
        }
    struct sp_shell_slot *newest = sp_slots_newest(&slots, cache->slots, job->volume),
                         *slot = newest;
    bool ok = true;
    if (!newest || newest->repeats >= REPEATS) {
        slot = sp_slots_acquire(&slots, cache->slots, UINT64_MAX, newest);
        slot->base.volume = sp_volume_ref(job->volume);
        ok = start_masks(slot, newest, job, err);
    }
    ok = ok && renew(slot, job, err);
    slot->repeats = 0;
    if (!ok)
        sp_slots_empty(&slots, slot);
    return ok ? slot : NULL;
}

static bool clip(struct sp_shell_slot *slot, const struct sp_shell_job *job, struct sp_error *err) {
    const struct sp_grid *grid = &sp_volume_info(job->volume)->grid;
    struct sp_shell_states states;
    struct sp_voxel_interval *rows = malloc((size_t)grid->dims[1] * grid->dims[2] * sizeof *rows);
    sp_voxel_list_finish(&slot->clipped);
    uint64_t used = slot_bytes(slot);
    if (!rows || !sp_shell_states_init(&states, &slot->transfer, slot->low, slot->high, NULL)) {
        free(rows);
        return sp_fail(err, SP_ERR_MEMORY, "/clip", "out of memory for the clipped shell");
    }
    sp_voxel_clip_rows(job->clip, grid, rows);
    struct sp_shell_extract extract = { .masks = &slot->masks,
                                        .states = &states,
                                        .volume = job->volume,
                                        .from = &slot->list,
                                        .clip = rows,
                                        .same_classes = true,
                                        .bytes_max =
                                            job->bytes_max > used ? job->bytes_max - used : 0,
                                        .pool = job->pool,
                                        .interrupt = &job->interrupt };
    bool ok = sp_shell_extract(&extract, &slot->clipped, err);
    slot->clip = *job->clip;
    sp_shell_states_finish(&states);
    free(rows);
    return ok;
}

const struct sp_voxel_list *sp_shell_cache_get(struct sp_shell_cache *cache,
                                               const struct sp_shell_job *job,
                                               struct sp_error *err) {
    struct sp_shell_slot *slot = get_shell(cache, job, err);
    bool clips = job->clip && sp_voxel_clips(job->clip);
    if (!slot)
        return NULL;
    slot->base.used = ++cache->clock;
    if (clips && !(slot->clipped.first && sp_voxel_clip_equal(&slot->clip, job->clip)) &&
        !clip(slot, job, err))
        return NULL;
    sp_slots_trim(&slots, cache->slots, job->bytes_max, UINT64_MAX, slot);
    return clips ? &slot->clipped : &slot->list;
}
