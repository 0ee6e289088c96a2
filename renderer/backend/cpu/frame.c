/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/cpu/frame.h"

#include <math.h>

#include "splat/adaptive.h"
#include "splat/slices.h"

_Static_assert((int)SP_MIP_LEVEL_MAX < (int)SP_LEVELS, "a level for each value of mip_level");

/* Sheets of footprints mix bricks of several levels. All other compositing draws one level: the
 * finest that some brick needs. */
static uint32_t levels_drawn(const struct cpu_frame *f) {
    bool is_mixed = f->job->view->compositing.mode == SP_COMPOSITE_SHEET;
    return is_mixed ? f->detail.levels : 1u << f->finest;
}

static bool choose_levels(struct cpu_frame *f, struct sp_error *err) {
    const struct sp_grid *grid = &sp_volume_info(f->job->volume)->grid;
    struct sp_arena *arena = &f->state->arena;
    unsigned levels = sp_detail_levels(grid->dims, SP_LEVELS);
    struct sp_detail_job job = { .camera = &f->camera,
                                 .grid = grid,
                                 .view = f->job->view,
                                 .floor = f->mip_level,
                                 .levels = levels > f->mip_level ? levels : f->mip_level + 1 };
    if (!sp_detail_choose(&job, arena, &f->detail))
        return sp_arena_fail(arena, "data", err);
    f->finest = (unsigned)__builtin_ctz(f->detail.levels);
    for (uint32_t i = 0; i < f->detail.count && !f->is_enlarged; i++)
        f->is_enlarged = f->detail.bricks[i].level == f->finest && f->detail.bricks[i].is_enlarged;
    return true;
}

static bool classify(struct cpu_frame *f, struct sp_error *err) {
    const struct sp_view *view = f->job->view;
    struct sp_classify_cache *cache = &f->state->cache;
    struct sp_classify_job job = { .tf = &view->transfer_function,
                                   .levels = levels_drawn(f),
                                   .axis = f->axis,
                                   .normals = view->shading.mode == SP_SHADING_PHONG ||
                                              view->transfer_function.gradient_count > 0 ||
                                              view->transfer_function.order == SP_TF_POST,
                                   .reach = sp_kernel_reach(&view->filter),
                                   .bytes_max = cache->limit_bytes,
                                   .pool = f->state->pool,
                                   .cancel = f->job->cancel,
                                   .pause = f->job->pause };
    const struct sp_classification *classification =
        sp_classify_cache_get(cache, f->job->volume, &job, err);
    if (!classification)
        return false;
    f->visible = classification->visible;
    f->levels = classification->levels;
    return true;
}

/* Chooses the filter of each brick of a level (adaptive). A brick whose voxels are small enough
 * gets the filter that the voxels of the finest level would have. */
static const uint8_t *choose_modes(struct cpu_frame *f, unsigned level, bool enlarged) {
    struct sp_adaptive adaptive;
    const struct sp_view *view = f->job->view;
    struct sp_filter filter = view->filter;
    const struct sp_grid *grid = &f->parts[level].level->grid;
    uint8_t *modes = sp_arena_alloc(&f->state->arena, "filter modes", sp_adaptive_count(grid), 1);
    if (!enlarged)
        filter.sigma = ldexp(filter.sigma, -(int)level);
    if (modes) {
        sp_adaptive_init(&adaptive, &f->camera, grid, view, &filter);
        sp_adaptive_fill(&adaptive, modes);
    }
    return modes;
}

static bool init_part(struct cpu_frame *f, unsigned level, bool enlarged, struct sp_error *err) {
    const struct sp_view *view = f->job->view;
    struct sp_level_frame *part = &f->parts[level];
    struct sp_ewa_frame *ewa = &part->ewa[enlarged];
    const struct sp_filter filter = sp_detail_filter(&view->filter, level, enlarged);
    part->level = &f->levels[level];
    sp_ewa_frame_init(ewa, &f->camera, &part->level->grid, view, &filter);
    sp_clip_frame_init(&ewa->clip, &f->camera, &f->levels[0].grid, &view->clip, ewa->unit);
    if (view->filter.mode == SP_FILTER_ADAPTIVE)
        part->modes[enlarged] = choose_modes(f, level, enlarged);
    return view->filter.mode != SP_FILTER_ADAPTIVE || part->modes[enlarged] ||
           sp_arena_fail(&f->state->arena, "data", err);
}

static bool init_parts(struct cpu_frame *f, struct sp_error *err) {
    uint32_t levels = levels_drawn(f);
    for (unsigned l = 0; levels >> l; l++)
        if (levels >> l & 1 && !(init_part(f, l, false, err) && init_part(f, l, true, err)))
            return false;
    f->level = f->parts[f->finest].level;
    f->ewa = &f->parts[f->finest].ewa[f->is_enlarged];
    return true;
}

/* Drops the bricks of the cut that clipping removes. Other compositing than sheets draws whole
 * lists, and drops bricks when it sorts them (draw/footprints/depth.h). */
static void drop_clipped(struct cpu_frame *f) {
    uint32_t kept = 0;
    if (f->job->view->compositing.mode != SP_COMPOSITE_SHEET || !f->ewa->clip.count)
        return;
    for (uint32_t i = 0; i < f->detail.count; i++) {
        const struct sp_detail_brick *brick = &f->detail.bricks[i];
        const struct sp_level_frame *part = &f->parts[brick->level];
        uint32_t corner[3];
        sp_visible_brick_corner(part->level->visible.bricks, brick->brick, corner);
        if (!sp_ewa_brick_is_clipped(&part->ewa[brick->is_enlarged], corner))
            f->detail.bricks[kept++] = *brick;
    }
    f->detail.count = kept;
}

bool cpu_frame_init(struct cpu_frame *f, struct cpu_state *state, const struct sp_backend_job *job,
                    struct sp_error *err) {
    const struct sp_view *view = job->view;
    *f = (struct cpu_frame){ .job = job, .state = state, .axis = SP_NO_AXIS };
    double clock = sp_job_clock_ms(job);
    /* Averaging a scalar over 4³ voxels changes what the transfer function shows. */
    bool is_post = view->transfer_function.order == SP_TF_POST;
    f->mip_level = is_post && job->mip_level > 1 ? 1 : job->mip_level;
    sp_camera_transform_init(&f->camera, &view->camera, view->size);
    if (view->compositing.mode == SP_COMPOSITE_SHEET)
        f->axis = sp_slices_major_axis(&f->camera, &sp_volume_info(job->volume)->grid);
    if (view->shading.mode == SP_SHADING_PHONG) {
        sp_shade_init(&f->shade, &f->camera, &view->shading);
        f->shading = &f->shade;
    }
    if (!choose_levels(f, err) || !classify(f, err) || !init_parts(f, err))
        return false;
    drop_clipped(f);
    cpu_frame_add_time(f, CPU_CLASSIFY, clock);
    return true;
}
