/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/working_set/frame_source.h"

#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "draw/resample/resample.h"
#include "draw/working_set/working_set.h"

static bool is_cancelled(void *user) {
    const struct sp_render_options *options = user;
    return options->cancel && atomic_load_explicit(options->cancel, memory_order_relaxed);
}

/* Finds the coarsest level whose samples are at most as wide as the samples of a mip level. */
static unsigned find_level(const struct sp_brick_header *header, unsigned mip_level) {
    static const double tolerance = 0.1; /* dims that are odd make uneven steps */
    unsigned level = 0;
    while (level + 1 < header->levels &&
           sp_brick_level_width(&header->level[level + 1]) <= mip_level + tolerance)
        level++;
    return level;
}

/* The finest level that the frame asks for. */
static unsigned choose_level(const struct sp_brick_header *header, const struct sp_view *view,
                             unsigned mip_level) {
    struct sp_camera_transform camera;
    if (view->level_of_detail == SP_LOD_OFF)
        return find_level(header, mip_level);
    sp_camera_transform_init(&camera, &view->camera, view->size);
    const unsigned level = sp_resample_level(&header->info.grid, &camera);
    return find_level(header, level > mip_level ? level : mip_level);
}

/* True if the view may be drawn from a volume whose samples lie in blocks: interpolated sheets or a
 * projection, and nothing else. */
static bool may_read_blocks(const struct sp_view *v) {
    const enum sp_tf_order order = v->transfer_function.order;
    const bool is_sheet = v->compositing.mode == SP_COMPOSITE_SHEET;
    if (sp_working_set_needs_whole(v) || sp_view_draws_slices(v))
        return false;
    for (uint32_t i = 0; i < v->layer_count; i++)
        if (v->layers[i].visible && v->layers[i].type != SP_LAYER_VOLUME &&
            v->layers[i].type != SP_LAYER_CHANNEL)
            return false;
    if (sp_compositing_is_projection(v->compositing.mode))
        return true;
    if (v->compositing.mode == SP_COMPOSITE_SPLAT || order == SP_TF_PRE)
        return false;
    if (order == SP_TF_AUTO && v->level_of_detail == SP_LOD_OFF)
        return false; /* the samples may be so small that splats are drawn */
    return (is_sheet && order == SP_TF_POST) || sp_view_has_default_filter(v);
}

/* How long the frame waits for bricks [ms]. At a level coarser than the base it has nothing else to
 * draw, and few bytes are read then. */
static double wait_for(const struct sp_render_options *options, bool is_coarse) {
    return is_coarse || options->wait_ms == 0 ? (double)INFINITY : fmax(options->wait_ms, 0);
}

bool sp_frame_source_choose(struct sp_volume *volume, const struct sp_frame_source_job *wanted,
                            struct sp_frame_source *drawn, struct sp_error *err) {
    const struct sp_view *view = wanted->view;
    const struct sp_render_options *options = wanted->options;
    const unsigned least = wanted->least;
    struct sp_brick_store *store = sp_brick_store_of(volume);
    struct sp_working_set set;
    struct sp_brick_subvolume subvolume;
    *drawn = (struct sp_frame_source){ .view = *view, .mip_level = options->mip_level };
    if (!store) {
        drawn->volume = sp_volume_ref(volume);
        return true;
    }
    const struct sp_brick_header *header = sp_brick_file_header(sp_brick_store_file(store));
    const unsigned asked = choose_level(header, view, options->mip_level);
    const unsigned base = sp_brick_store_base(store);
    const struct sp_working_set_job job = {
        .store = store,
        .view = view,
        .level = asked > least ? asked : least,
        .least = least,
        .reads_blocks = wanted->reads_blocks && may_read_blocks(view),
        .takes_parts = options->takes_parts,
        .wait_ms = wait_for(options, least > base),
        .is_cancelled = is_cancelled,
        .user = (void *)options, /* only read */
    };
    if (!sp_working_set_choose(&job, &set, &subvolume, err))
        return false;
    sp_working_set_view(header, &subvolume, view, &drawn->view);
    drawn->volume = set.volume;
    const double left = options->mip_level - sp_brick_level_width(&header->level[set.level]);
    drawn->mip_level = left > 0 ? (unsigned)lround(left) : 0;
    uint64_t bricks, bytes;
    sp_brick_store_usage(store, &bricks, &bytes);
    drawn->bricks =
        (struct sp_frame_bricks){ .is_incomplete = !set.is_complete,
                                  .is_being_read = set.is_being_read,
                                  .level = set.is_empty ? set.asked : set.coarsest,
                                  .asked = asked < base ? asked : base,
                                  .wanted = set.wanted,
                                  .resident = set.resident,
                                  .lost = subvolume.lost,
                                  .memory_bytes = bytes + sp_volume_info(volume)->voxel_bytes };
    memcpy(drawn->bricks.lost_box, subvolume.lost_box, sizeof subvolume.lost_box);
    return true;
}
