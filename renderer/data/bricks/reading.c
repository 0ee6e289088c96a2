/* SPDX-License-Identifier: Apache-2.0
 *
 * Reads the bricks of a subvolume. Until all of them are there, what is there is shown: subvolumes
 * that share the memory of its bricks.
 */
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "data/bricks/store_private.h"
#include "data/volume/volume.h"

/* References to the subvolumes, from which bricks are copied. */
struct known {
    struct sp_volume *volumes[BRICK_SUBVOLUMES_MAX];
    struct sp_brick_need needs[BRICK_SUBVOLUMES_MAX]; /* owned */
    uint8_t *lost[BRICK_SUBVOLUMES_MAX];
    struct sp_brick_box_samples samples[BRICK_SUBVOLUMES_MAX];
    size_t count;
};

/* With the mutex held. */
static void copy_known(struct sp_brick_store *store, unsigned level, struct known *known) {
    known->count = 0;
    for (int i = 0; i < BRICK_SUBVOLUMES_MAX; i++) {
        struct sp_brick_store_subvolume *w = &store->subvolumes[i];
        const size_t n = known->count;
        if (!w->volume || w->need.level != level)
            continue;
        const uint64_t count = sp_brick_need_count(&w->need);
        known->lost[n] = malloc(count);
        if (!known->lost[n] || !sp_brick_need_copy(&w->need, &known->needs[n])) {
            free(known->lost[n]);
            continue;
        }
        memcpy(known->lost[n], w->lost, count);
        known->volumes[n] = sp_volume_ref(w->volume);
        /* They are only read. */
        known->samples[n] = (struct sp_brick_box_samples){
            .need = &known->needs[n],
            .samples = w->need.is_sparse ? NULL : (void *)sp_volume_voxels(w->volume),
            .blocks = (struct sp_blocks *)sp_volume_blocks(w->volume),
            .vectors = sp_volume_vectors(w->volume),
            .lost = known->lost[n]
        };
        known->count++;
    }
}

static void drop_known(struct known *known) {
    for (size_t i = 0; i < known->count; i++) {
        sp_volume_unref(&known->volumes[i]);
        free(known->needs[i].wanted);
        free(known->lost[i]);
    }
}

/* A subvolume that is being filled. */
struct reading {
    struct sp_brick_store *store;
    struct sp_brick_store_subvolume *subvolume;
    const struct sp_brick_subvolume *coarser;
    struct sp_blocks *blocks; /* NULL = an array */
    double due_ms, wait_ms;   /* when the next part is shown; after which time the one after it */
};

static bool is_stopped(void *user) {
    const struct reading *r = user;
    return atomic_load_explicit(&r->store->stop, memory_order_relaxed);
}

static bool is_due(void *user) {
    const struct reading *r = user;
    return r->blocks && sp_clock_ms() >= r->due_ms;
}

/* Sets where bricks without samples have theirs. */
static void set_coarser(const struct reading *r) {
    const struct sp_brick_need *need = &r->subvolume->need;
    const struct sp_brick_header *header = sp_brick_file_header(r->store->file);
    const struct sp_brick_level *own = &header->level[need->level],
                                *from = &header->level[r->coarser->level];
    struct sp_blocks_coarse *c = &r->blocks->coarse;
    c->blocks = sp_volume_blocks(r->coarser->volume);
    c->samples = c->blocks ? NULL : sp_volume_voxels(r->coarser->volume);
    memcpy(c->dims, r->coarser->size, sizeof c->dims);
    for (int a = 0; a < 3; a++) {
        const double first = own->offset[a] + own->step[a] * need->first[a] * BRICK_SIDE;
        c->first[a] = (first - from->offset[a]) / from->step[a] - r->coarser->first[a];
        c->step[a] = own->step[a] / from->step[a];
    }
}

/* Makes the volume of a subvolume from its memory, an array or blocks, which it takes over, also on
 * failure. */
static bool derive(const struct reading *r, struct sp_brick_store_subvolume *w, void *memory,
                   uint64_t bytes, struct sp_error *err) {
    const struct sp_brick_store *store = r->store;
    const struct sp_whole_part part = sp_brick_store_part(store, &w->need);
    const bool is_mixed = sp_brick_need_coarse(&w->need) > 0;
    sp_voxel_source_release *release = w->need.is_sparse ? sp_brick_blocks_release : sp_brick_unmap;
    struct sp_grid grid;
    double *numbers;
    w->coarsest = is_mixed ? r->coarser->coarsest : w->need.level;
    if (is_mixed && !w->is_partial && r->coarser->volume != store->base)
        w->bytes += r->coarser->bytes; /* it stays as long as this one */
    w->read_ms = sp_clock_ms();
    for (uint64_t i = 0; i < sp_brick_need_count(&w->need); i++)
        w->lost_count += w->lost[i] != 0;
    if (!sp_brick_store_grid(store, &w->need, &grid, &numbers)) {
        release(memory, bytes);
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for bricks");
    }
    if (w->need.is_sparse)
        w->volume =
            sp_volume_derive_blocks(store->base, &grid, &part, memory,
                                    is_mixed ? r->coarser->volume : NULL, bytes, release, err);
    else
        w->volume = sp_volume_derive_part(store->base, &grid, &part, memory,
                                          sp_brick_store_vectors(store, &w->need, memory), bytes,
                                          release, err);
    free(numbers);
    return w->volume != NULL;
}

/* Shows the bricks that are there. If memory runs out, they are shown later. */
static void publish_partial(void *user, const uint8_t *has) {
    struct reading *r = user;
    struct sp_brick_store *store = r->store;
    const struct sp_brick_need *need = &r->subvolume->need;
    const uint64_t count = sp_brick_need_count(need);
    struct sp_error err;
    struct sp_brick_store_subvolume part = { .lost = malloc(count),
                                             .bytes = sp_brick_need_cost(store->file, need) -
                                                      sp_brick_blocks_bytes(store->file, need),
                                             .is_partial = true };
    r->due_ms = sp_clock_ms() + r->wait_ms;
    r->wait_ms *= 2;
    struct sp_blocks *blocks = sp_brick_blocks_share(store->file, need, r->blocks, has, &err);
    if (!blocks || !part.lost || !sp_brick_need_copy(need, &part.need)) {
        sp_brick_blocks_release(blocks, 0);
        free(part.lost);
        return;
    }
    memcpy(part.lost, r->subvolume->lost, count);
    for (uint64_t i = 0; i < count; i++)
        if (part.need.wanted[i] >= BRICK_WANTED && !has[i])
            part.need.wanted[i] = BRICK_COARSE;
    if (!derive(r, &part, blocks, part.bytes, &err)) {
        sp_brick_subvolume_clear(&part);
        return;
    }
    pthread_mutex_lock(&store->memory->mutex);
    sp_brick_store_publish(store, &part);
    pthread_mutex_unlock(&store->memory->mutex);
}

/* Fills the memory of a subvolume. */
static bool fill(struct reading *r, void *samples, struct sp_error *err) {
    struct sp_brick_store *store = r->store;
    struct sp_brick_store_subvolume *w = r->subvolume;
    struct sp_error why = { .code = SP_OK };
    struct known known;
    pthread_mutex_lock(&store->memory->mutex);
    copy_known(store, w->need.level, &known);
    pthread_mutex_unlock(&store->memory->mutex);
    const struct sp_brick_fill_job job = {
        .file = store->file,
        .need = &w->need,
        .coarse = { .need = &store->base_need,
                    .samples = (void *)sp_volume_voxels(store->base), /* only read */
                    .vectors = sp_volume_vectors(store->base),
                    .lost = store->base_lost },
        .known = known.samples,
        .known_count = known.count,
        .pool = store->pool,
        .is_cancelled = is_stopped,
        .is_due = is_due,
        .progress = publish_partial,
        .user = r,
        .samples = samples,
        .blocks = r->blocks,
        .vectors = (float(*)[3])sp_brick_store_vectors(store, &w->need, samples),
        .lost = w->lost,
    };
    const bool ok = sp_brick_fill(&job, &why, err);
    drop_known(&known);
    pthread_mutex_lock(&store->memory->mutex);
    if (ok)
        sp_brick_store_heal(store, &w->need, w->lost);
    if (why.code != SP_OK)
        sp_brick_store_note(store, &w->need, w->lost, &why);
    pthread_mutex_unlock(&store->memory->mutex);
    return ok;
}

static bool fill_blocks(struct reading *r, struct sp_error *err) {
    struct sp_brick_store_subvolume *w = r->subvolume;
    if (!(r->blocks = sp_brick_blocks_create(r->store->file, &w->need, err)))
        return false;
    set_coarser(r);
    if (fill(r, NULL, err))
        return derive(r, w, r->blocks, w->bytes, err);
    sp_brick_blocks_release(r->blocks, 0);
    return false;
}

static bool fill_array(struct reading *r, struct sp_error *err) {
    const uint64_t bytes = sp_brick_need_bytes(r->store->file, &r->subvolume->need);
    void *samples = sp_brick_map(bytes, err);
    if (!samples)
        return false;
    if (fill(r, samples, err))
        return derive(r, r->subvolume, samples, bytes, err);
    sp_brick_unmap(samples, bytes);
    return false;
}

bool sp_brick_store_fill(struct sp_brick_store *store, struct sp_brick_need *need,
                         const struct sp_brick_subvolume *coarser,
                         struct sp_brick_store_subvolume *w, struct sp_error *err) {
    struct reading reading = { .store = store,
                               .subvolume = w,
                               .coarser = coarser,
                               .due_ms = sp_clock_ms() + store->publish_ms,
                               .wait_ms = 2 * store->publish_ms };
    *w = (struct sp_brick_store_subvolume){ .need = *need,
                                            .bytes = sp_brick_need_cost(store->file, need),
                                            .lost = calloc(1, sp_brick_need_count(need)) };
    need->wanted = NULL;
    if (!w->lost)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for bricks");
    return w->need.is_sparse ? fill_blocks(&reading, err) : fill_array(&reading, err);
}
