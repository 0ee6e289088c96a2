/* SPDX-License-Identifier: Apache-2.0
 *
 * What gives the colours of streaks (color_by), if it is larger than memory: a subvolume of it
 * around the samples that the frame shows.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/bricks/store.h"
#include "draw/working_set/frame_source.h"

/* The level of a file that has the samples of a part. False if there is none: other levels. */
static bool find_level(const struct sp_brick_header *header, const uint32_t dims[3],
                       unsigned *level) {
    for (*level = 0; *level < header->levels; (*level)++)
        if (memcmp(header->level[*level].dims, dims, sizeof header->level->dims) == 0)
            return true;
    return false;
}

/* The box of bricks of a level around the samples that the frame shows. */
static void compute_box(const struct sp_volume_info *drawn, struct sp_brick_need *need) {
    const struct sp_whole_part *part = &drawn->whole.part;
    for (int a = 0; a < 3; a++) {
        const uint32_t first = part->dims[0] > 0 ? part->first[a] : 0,
                       last = first + drawn->grid.dims[a] - 1;
        need->first[a] = first / BRICK_SIDE;
        need->count[a] = last / BRICK_SIDE - need->first[a] + 1;
    }
}

/* Chooses the bricks around the samples that the frame shows, at their level or at the finest
 * coarser one for which the memory suffices. need->count is 0 if only the volume that was opened is
 * coarse enough. `level`: the level of the frame; the file may have another number for the same
 * samples. *steps: by how many levels the colours are coarser. False without memory. */
static bool choose_need(const struct sp_brick_store *store, const struct sp_volume_info *drawn,
                        unsigned level, struct sp_brick_need *need, unsigned *steps) {
    const struct sp_brick_file *file = sp_brick_store_file(store);
    const struct sp_brick_header *header = sp_brick_file_header(file);
    const bool is_part = drawn->whole.part.dims[0] > 0;
    const unsigned base = sp_brick_store_base(store);
    unsigned own;
    *need = (struct sp_brick_need){ .level = 0 };
    const bool has_level =
        find_level(header, is_part ? drawn->whole.part.dims : drawn->grid.dims, &own);
    if (has_level) {
        compute_box(drawn, need);
        level = own;
    }
    *steps = 0;
    for (need->level = level; has_level && (*steps == 0 || need->level < base); ++*steps) {
        if (!sp_brick_need_allocate(need, BRICK_WANTED))
            return false;
        if (sp_brick_need_cost(file, need) <= sp_brick_store_subvolume_max(store))
            return true;
        free(need->wanted);
        if (need->level + 1 == header->levels)
            break;
        for (int a = 0; a < 3; a++)
            sp_brick_level_map(&header->level[need->level], &header->level[need->level + 1], a,
                               &need->first[a], &need->count[a]);
        need->level++;
    }
    *need = (struct sp_brick_need){ .level = 0 };
    *steps = base > level ? base - level : 0;
    return true;
}

static bool is_cancelled(void *user) {
    const struct sp_render_options *options = user;
    return options->cancel && atomic_load_explicit(options->cancel, memory_order_relaxed);
}

/* Replaces a volume that is larger than memory by its part around the samples that the frame shows.
 */
static bool replace(struct sp_volume **colors, const struct sp_render_options *options,
                    unsigned level, struct sp_frame_source *drawn, struct sp_error *err) {
    struct sp_brick_store *store = sp_brick_store_of(*colors);
    const double wait_ms = options->wait_ms == 0 ? (double)INFINITY : fmax(options->wait_ms, 0);
    struct sp_brick_subvolume subvolume;
    struct sp_brick_need need;
    unsigned steps;
    if (!choose_need(store, sp_volume_info(drawn->volume), level, &need, &steps))
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the bricks of a frame");
    if (level + steps > drawn->bricks.level)
        drawn->bricks.level = level + steps;
    if (!need.count[0])
        return true;
    const bool ok = sp_brick_store_get(store, &need, wait_ms, false, is_cancelled, (void *)options,
                                       &subvolume, err);
    free(need.wanted);
    if (!ok)
        return false;
    sp_volume_unref(colors);
    *colors = subvolume.volume;
    drawn->bricks.is_incomplete |= !subvolume.is_wanted || subvolume.lost > 0;
    return true;
}

bool sp_frame_source_replace_colors(const struct sp_view *view,
                                    const struct sp_render_options *options,
                                    struct sp_frame_source *drawn,
                                    struct sp_volume *colors[SP_LAYERS_MAX], struct sp_error *err) {
    const unsigned level = drawn->bricks.level;
    for (uint32_t i = 0; i < view->layer_count; i++) {
        const struct sp_layer *layer = &view->layers[i];
        if (colors[i] && layer->visible && layer->type == SP_LAYER_VECTORS && !layer->id[0] &&
            sp_brick_store_of(colors[i]) && !replace(&colors[i], options, level, drawn, err))
            return false;
    }
    return true;
}
