/* SPDX-License-Identifier: Apache-2.0
 *
 * The bricks of a store that could not be read.
 */
#include <math.h>

#include "data/bricks/store_private.h"
#include "sp/log.h"

void sp_brick_store_box(const struct sp_brick_store *store, unsigned level, uint64_t number,
                        uint32_t box[2][3]) {
    const struct sp_brick_header *header = sp_brick_file_header(store->file);
    const struct sp_brick_level *own = &header->level[level];
    uint32_t first[3], size[3];
    sp_brick_box(own, number, first, size);
    for (int a = 0; a < 3; a++) {
        const double begin = own->offset[a] + own->step[a] * (first[a] - 0.5) + 0.5;
        const double dim = header->level[0].dims[a];
        box[0][a] = (uint32_t)fmin(fmax(floor(begin), 0), dim - 1);
        box[1][a] = (uint32_t)fmin(fmax(ceil(begin + own->step[a] * size[a]), 1), dim);
    }
}

/* Number of the first brick of a level among the bricks of all levels. */
static uint64_t first_of(const struct sp_brick_store *store, unsigned level) {
    const struct sp_brick_header *header = sp_brick_file_header(store->file);
    uint64_t first = 0;
    for (unsigned l = 0; l < level; l++)
        first += sp_brick_count(&header->level[l]);
    return first;
}

void sp_brick_store_heal(struct sp_brick_store *store, const struct sp_brick_need *need,
                         const uint8_t *lost) {
    const struct sp_brick_level *own = &sp_brick_file_header(store->file)->level[need->level];
    const unsigned arrays = sp_brick_need_arrays(need);
    uint8_t *damaged = store->damaged + first_of(store, need->level);
    for (uint64_t i = 0; store->damage.count && i < sp_brick_need_count(need); i++) {
        const uint64_t number = sp_brick_need_at(need, own, i);
        if (need->wanted[i] < BRICK_WANTED || !damaged[number])
            continue;
        damaged[number] &= (uint8_t)(~arrays | lost[i]); /* what was not read stays */
        store->damage.count -= !damaged[number];
    }
}

void sp_brick_store_note(struct sp_brick_store *store, const struct sp_brick_need *need,
                         const uint8_t *lost, const struct sp_error *why) {
    const struct sp_brick_header *header = sp_brick_file_header(store->file);
    const uint64_t begin = first_of(store, need->level);
    for (uint64_t i = 0; i < sp_brick_need_count(need); i++) {
        const uint64_t number = sp_brick_need_at(need, &header->level[need->level], i);
        const bool is_new = lost[i] && !store->damaged[begin + number];
        store->damaged[begin + number] |= lost[i];
        if (!is_new || store->damage.count++)
            continue;
        store->damage.level = need->level;
        store->damage.why = *why;
        sp_brick_store_box(store, need->level, number, store->damage.box);
        sp_log(SP_LOG_WARN, "%s: %s; a coarser level is shown there", why->place, why->text);
    }
}

bool sp_bricks_get_damage(const struct sp_volume *volume, struct sp_bricks_damage *damage) {
    struct sp_brick_store *store = sp_brick_store_of(volume);
    if (!store)
        return false;
    pthread_mutex_lock(&store->memory->mutex);
    *damage = store->damage;
    pthread_mutex_unlock(&store->memory->mutex);
    return damage->count > 0;
}
