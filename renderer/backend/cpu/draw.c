/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/cpu/draw.h"

#include "backend/cpu/general.h"

/* Draws the frame by the fast path if that is worthwhile; *is_drawn says whether it did. */
static bool draw_fast(struct cpu_frame *f, bool *is_drawn, struct sp_error *err) {
    struct cpu_state *state = f->state;
    struct sp_postconv postconv;
    struct sp_postconv_input input = { .view = f->job->view,
                                       .frame = f->job->frame,
                                       .interrupt = sp_job_interrupt(f->job),
                                       .tables = &state->postconv,
                                       .camera = &f->camera,
                                       .shade = f->shading,
                                       .grid = &f->levels[0].grid,
                                       .parts = f->parts,
                                       .detail = &f->detail,
                                       .axis = f->axis,
                                       .classify_ms = f->stage_ms[CPU_CLASSIFY],
                                       .draw_tile = state->kernels.postconv_tile,
                                       .pool = state->pool,
                                       .arena = &state->arena };
    if (!sp_postconv_prepare(&input, &postconv, err))
        return false;
    f->stage_ms[CPU_SPLAT] += postconv.prepare_ms;
    *is_drawn = sp_postconv_is_worthwhile(&postconv);
    if (!*is_drawn)
        return true;
    cpu_frame_write_stats(f);
    return sp_postconv_draw(&input, &postconv, err);
}

bool cpu_draw(struct cpu_state *state, const struct sp_backend_job *job, struct sp_error *err) {
    struct cpu_frame frame;
    const struct sp_grid *grid = &sp_volume_info(job->volume)->grid;
    bool can_be_fast = state->kernels.has_fast_path && sp_postconv_can_draw(job->view, grid);
    bool is_drawn = false;
    sp_arena_reset(&state->arena);
    if (!cpu_frame_init(&frame, state, job, err))
        return false;
    if (can_be_fast && !draw_fast(&frame, &is_drawn, err))
        return false;
    return is_drawn || cpu_general_draw(&frame, err);
}
