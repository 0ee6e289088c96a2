/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/working_set/working_set.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/bricks/places.h"
#include "data/volume/grid.h"

/* A fraction of the whole volume along axis a, as a fraction of the subvolume. */
static double convert(const struct sp_brick_header *header,
                      const struct sp_brick_subvolume *subvolume, int a, double fraction) {
    double whole[2], own[2];
    sp_grid_extent(&header->info.grid, (unsigned)a, whole);
    sp_grid_extent(&sp_volume_info(subvolume->volume)->grid, (unsigned)a, own);
    const double first = sp_brick_distance(header, subvolume->level, a, subvolume->first[a]);
    const double distance = whole[0] + fraction * (whole[1] - whole[0]);
    return (distance - first - own[0]) / (own[1] - own[0]);
}

void sp_working_set_view(const struct sp_brick_header *header,
                         const struct sp_brick_subvolume *subvolume, const struct sp_view *view,
                         struct sp_view *out) {
    *out = *view;
    for (int a = 0; a < 3; a++)
        for (int side = 0; side < 2; side++) {
            const double own = convert(header, subvolume, a, view->clip.box[side][a]);
            out->clip.box[side][a] = fmin(fmax(own, 0), 1);
            for (uint32_t e = 0; e < view->edit_count; e++)
                if (view->edits[e].type == SP_EDIT_BOX) {
                    const double edge = convert(header, subvolume, a, view->edits[e].box[side][a]);
                    out->edits[e].box[side][a] = fmin(fmax(edge, 0), 1);
                }
        }
}

bool sp_working_set_needs_whole(const struct sp_view *view) {
    return view->edit_count > 0 || (view->shading.mode != SP_SHADING_NONE &&
                                    (view->shading.occlusion > 0 || view->shading.shadow > 0));
}

/* True if a need fits into a subvolume: as an array, which is read faster, or only as blocks.
 * Chunks may come slowly, and blocks show what is there, so that they are preferred then. */
static bool fits(const struct sp_working_set_job *job, struct sp_brick_need *need,
                 uint64_t bytes_max) {
    const struct sp_brick_file *file = sp_brick_store_file(job->store);
    const bool prefers_blocks = job->reads_blocks && sp_brick_file_chunks(file);
    need->is_sparse = prefers_blocks;
    if (sp_brick_need_cost(file, need) <= bytes_max)
        return true;
    need->is_sparse = job->reads_blocks && !prefers_blocks;
    return need->is_sparse != prefers_blocks && sp_brick_need_cost(file, need) <= bytes_max;
}

/* Leaves the least important bricks of a need that does not fit to the next coarser level. False if
 * fewer than a quarter of them would be left: then the coarser level is shown alone. Also false
 * without memory. */
static bool shorten(const struct sp_working_set_job *job, struct sp_brick_need *need,
                    uint64_t bytes_max) {
    const struct sp_brick_file *file = sp_brick_store_file(job->store);
    struct sp_brick_need coarser = { .count = { 0 } };
    size_t count;
    need->is_sparse = true;
    if (need->level + 1 < sp_brick_store_base(job->store) &&
        !sp_brick_store_coarsen(job->store, need, 1, &coarser))
        return false;
    const uint64_t bricks = sp_brick_blocks_bytes(file, need);
    const uint64_t rest = sp_brick_need_cost(file, need) - bricks +
                          (coarser.wanted ? sp_brick_need_cost(file, &coarser) : 0);
    free(coarser.wanted);
    uint32_t *order = sp_brick_order(need->wanted, sp_brick_need_count(need), &count);
    const uint64_t kept = rest < bytes_max ? (bytes_max - rest) / (bricks / count) : 0;
    for (uint64_t n = kept; order && n < count; n++)
        need->wanted[order[n]] = BRICK_COARSE;
    free(order);
    return order && kept >= count / 4 + 1;
}

/* Chooses the need of the finest level, from `level` on, that fits into a subvolume. The bricks of
 * all the volume are taken where they fit, so that turning it needs no others. False without
 * memory. */
static bool choose_need(const struct sp_working_set_job *job, struct sp_brick_need *need) {
    const struct sp_brick_file *file = sp_brick_store_file(job->store);
    const uint64_t bytes_max = sp_brick_store_subvolume_max(job->store);
    const unsigned base = sp_brick_store_base(job->store);
    const unsigned end = job->least > base ? job->least + 1 : base;
    /* Chunks that are not seen are not read: reading is slow, and their ranges are unknown. */
    const bool prefers_whole = !sp_brick_file_chunks(file);
    /* It takes all memory that there is. And channels have one level. */
    const bool may_shorten = job->reads_blocks && sp_brick_store_is_alone(job->store) &&
                             !sp_view_has_channels(job->view);
    for (unsigned level = job->level; level < end; level++)
        for (int turn = 0; turn < 2; turn++) {
            const bool is_whole = (turn == 0) == prefers_whole;
            if (!is_whole && sp_working_set_needs_whole(job->view))
                continue;
            if (!sp_working_set_need(file, job->view, level, is_whole, need))
                return false;
            if (!need->count[0] || fits(job, need, bytes_max))
                return true;
            if (may_shorten && !is_whole && level < base && shorten(job, need, bytes_max))
                return true;
            free(need->wanted);
        }
    *need = (struct sp_brick_need){ .level = base };
    return true;
}

bool sp_working_set_choose(const struct sp_working_set_job *job, struct sp_working_set *set,
                           struct sp_brick_subvolume *subvolume, struct sp_error *err) {
    struct sp_brick_need need;
    *set = (struct sp_working_set){ .volume = NULL };
    if (!choose_need(job, &need))
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the bricks of a frame");
    set->asked = need.level;
    set->is_empty = !need.count[0] && need.level < sp_brick_store_base(job->store);
    if (!need.count[0]) { /* the volume that was opened has all, or nothing is seen */
        const struct sp_brick_file *file = sp_brick_store_file(job->store);
        sp_brick_store_get_base(job->store, sp_working_set_needs_vectors(file, job->view),
                                subvolume);
        subvolume->is_wanted = true;
        subvolume->lost = set->is_empty ? 0 : subvolume->lost;
    } else {
        set->wanted = sp_brick_need_wanted(&need);
        bool ok = sp_brick_store_get(job->store, &need, job->wait_ms, job->takes_parts,
                                     job->is_cancelled, job->user, subvolume, err);
        free(need.wanted);
        if (!ok)
            return false;
    }
    set->volume = subvolume->volume;
    set->level = subvolume->level;
    set->is_being_read = !subvolume->is_wanted;
    set->is_complete = subvolume->is_wanted && subvolume->lost == 0;
    if (subvolume->is_wanted || (subvolume->level == need.level && !set->is_empty))
        set->resident = set->wanted - subvolume->lost - subvolume->missing;
    set->coarsest = subvolume->coarsest;
    return true;
}
