/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/cache.h"

#include "data/volume/volume.h"

enum { REPEATS = 8 }; /* frames of one transfer function after which its edits have stopped */

static void finish_slot(void *pointer) {
    struct sp_classify_slot *slot = pointer;
    sp_classification_finish(&slot->c);
}

static uint64_t slot_bytes(const void *pointer) {
    const struct sp_classify_slot *slot = pointer;
    return sp_classification_bytes(&slot->c);
}

static const struct sp_slots slots = { SP_CLASSIFY_SLOTS, sizeof(struct sp_classify_slot),
                                       finish_slot, slot_bytes };

static struct sp_classify_slot *find_exact(struct sp_classify_cache *cache,
                                           const struct sp_volume *volume,
                                           const struct sp_transfer_function *tf) {
    for (int i = 0; i < SP_CLASSIFY_SLOTS; i++) {
        struct sp_classify_slot *slot = &cache->slots[i];
        if (slot->base.volume == volume &&
            sp_transfer_function_equal(&slot->c.levels[0].transfer.tf, tf))
            return slot;
    }
    return NULL;
}

/* How well the cached slots fit a transfer function that has no slot of its own. */
struct match {
    struct sp_classify_slot *serving; /* its list serves unchanged; NULL = none */
    struct sp_classify_slot
        *nearest; /* the slot whose list differs least; NULL = none can be compared */
    uint64_t serving_excess, differs, visible; /* voxels */
};

static void match_slot(struct match *m, struct sp_classify_slot *slot,
                       const struct sp_transfer *transfer, const struct sp_classify_job *job) {
    struct sp_fit fit;
    if (sp_transfer_same_voxels(&slot->c.levels[0].transfer, transfer) && !m->serving) {
        m->serving = slot;
        m->serving_excess = UINT64_MAX;
    }
    if (!sp_classification_fit(&slot->c, transfer, job, &fit, NULL))
        return;
    if (sp_fit_is_close(&fit) && (!m->serving || fit.excess < m->serving_excess)) {
        m->serving = slot;
        m->serving_excess = fit.excess;
    }
    if (!m->nearest || fit.missing + fit.excess < m->differs) {
        m->nearest = slot;
        m->differs = fit.missing + fit.excess;
        m->visible = fit.visible;
    }
}

static bool choose_match(struct sp_classify_cache *cache, const struct sp_volume *volume,
                         const struct sp_classify_job *job, struct match *match,
                         struct sp_error *err) {
    struct sp_transfer transfer;
    const struct sp_classify_slot *newest = sp_slots_newest(&slots, cache->slots, volume);
    const struct sp_transfer *like = newest ? &newest->c.levels[0].transfer : NULL;
    *match = (struct match){ 0 };
    if (!newest)
        return true;
    if (!sp_transfer_init(&transfer, job->tf, sp_volume_info(volume), like, err))
        return false;
    for (int i = 0; i < SP_CLASSIFY_SLOTS; i++)
        if (cache->slots[i].base.volume == volume)
            match_slot(match, &cache->slots[i], &transfer, job);
    sp_transfer_finish(&transfer);
    return true;
}

/* Rebuilds the lists in the slot from those it has. */
static bool renew(struct sp_classify_slot *slot, struct sp_volume *volume,
                  const struct sp_classify_job *job, bool widens, struct sp_error *err) {
    struct sp_classification next;
    struct sp_classify_job derive = *job;
    derive.from = &slot->c;
    derive.widens = widens;
    sp_classification_init(&next, volume);
    next.histogram = slot->c.histogram;
    slot->c.histogram = NULL;
    if (!sp_classification_update(&next, &derive, err)) {
        slot->c.histogram = next.histogram;
        next.histogram = NULL;
        sp_classification_finish(&next);
        return false;
    }
    sp_classification_finish(&slot->c);
    slot->c = next;
    return true;
}

/* Returns the slot of exactly this transfer function. When edits have stopped, its list is reduced
 * to the visible voxels. */
static bool use_again(struct sp_classify_slot *slot, struct sp_volume *volume,
                      const struct sp_classify_job *job, struct sp_error *err) {
    const struct sp_classification *c = &slot->c;
    uint64_t excess = c->levels[0].visible.count - c->visible;
    slot->repeats += slot->repeats < REPEATS;
    if (slot->repeats == REPEATS && excess > c->visible / 16)
        return renew(slot, volume, job, false, err);
    return sp_classification_update(&slot->c, job, err);
}

/* Returns a slot for a transfer function that no slot serves. A transfer function that differs
 * little from the most similar one is an edit of it and replaces it. */
static struct sp_classify_slot *fill_slot(struct sp_classify_cache *cache, struct sp_volume *volume,
                                          const struct sp_classify_job *job,
                                          const struct match *match, bool *ok,
                                          struct sp_error *err) {
    struct sp_classify_slot *source = match->nearest
                                          ? match->nearest
                                          : sp_slots_newest(&slots, cache->slots, volume),
                            *slot;
    if (match->nearest && match->differs <= match->visible / 2) {
        *ok = renew(source, volume, job, true, err);
        return source;
    }
    struct sp_classify_job derive = *job;
    slot = sp_slots_acquire(&slots, cache->slots, UINT64_MAX, source);
    slot->base.volume = sp_volume_ref(volume);
    sp_classification_init(&slot->c, volume);
    derive.from = source ? &source->c : NULL;
    *ok = sp_classification_update(&slot->c, &derive, err);
    return slot;
}

struct sp_classification *sp_classify_cache_get(struct sp_classify_cache *cache,
                                                struct sp_volume *volume,
                                                const struct sp_classify_job *wanted,
                                                struct sp_error *err) {
    struct sp_classify_job counted = *wanted, *job = &counted;
    counted.made = &cache->made;
    struct sp_classify_slot *slot = find_exact(cache, volume, job->tf);
    bool ok;
    if (slot) {
        ok = use_again(slot, volume, job, err);
    } else {
        struct match match;
        if (!choose_match(cache, volume, job, &match, err))
            return NULL;
        slot = match.serving;
        if (slot)
            ok = sp_classification_update(&slot->c, job, err);
        else
            slot = fill_slot(cache, volume, job, &match, &ok, err);
        slot->repeats = 0;
    }
    slot->base.used = ++cache->clock;
    if (ok)
        sp_slots_trim(&slots, cache->slots, cache->limit_bytes, UINT64_MAX, slot);
    else if (!slot->c.levels[0].visible.first)
        sp_slots_empty(&slots, slot);
    return ok ? &slot->c : NULL;
}

void sp_classify_cache_evict(struct sp_classify_cache *cache, const struct sp_volume *volume) {
    sp_slots_evict(&slots, cache->slots, volume);
}

uint64_t sp_classify_cache_bytes(const struct sp_classify_cache *cache,
                                 const struct sp_volume *volume) {
    return sp_slots_bytes(&slots, cache->slots, volume);
}
