/* SPDX-License-Identifier: Apache-2.0
 *
 * Sets up a new context before its first frame, and ends it.
 */
#include <epoxy/gl.h>

#include "backend/gl/compositor.h"
#include "backend/gl/depth_order.h"
#include "backend/gl/layer_drawing.h"
#include "backend/gl/memory.h"
#include "backend/gl/state.h"
#include "base/clock.h"
#include "sp/log.h"

/* Compiles all programs except the compositors that few views need. */
static bool open_programs(struct gl_state *s, struct sp_error *err) {
    const struct gl_compositor_choices plain = { .mode = SP_COMPOSITE_SHEET };
    const struct gl_compositor_choices clipped = { .mode = SP_COMPOSITE_SHEET, .is_clipped = true };
    bool is_software = gl_context_info(s->context)->software;
    double start_ms = sp_clock_ms();
    if (!(s->project =
              gl_program_open("frame bins records gradient shade counts project", "", err)) ||
        !(s->resolve = gl_program_open("resolve", "", err)) || !gl_bins_init(&s->bins, err) ||
        !gl_residency_init(&s->residency, is_software, s->block_bytes, err) ||
        !gl_compositor_open(s, &plain, err) || !gl_compositor_open(s, &clipped, err))
        return false;
    sp_log(SP_LOG_INFO, "shaders for %s compiled in %.0f ms", gl_context_info(s->context)->renderer,
           sp_clock_ms() - start_ms);
    return true;
}

bool gl_draw_init(struct gl_state *s, struct sp_error *err) {
    s->block_bytes = gl_context_info(s->context)->limits.storage_block_bytes;
    gl_memory_limit(s);
    gl_workload_init(&s->workload);
    gl_resample_init(&s->resample);
    for (int i = 0; i < GL_IN_FLIGHT; i++)
        gl_timer_init(&s->slots[i].timer);
    return open_programs(s, err) && gl_compositor_init(s, err);
}

void gl_draw_finish(struct gl_state *s) {
    struct gl_buffer *buffers = (struct gl_buffer *)&s->buffers;
    gl_residency_finish(&s->residency);
    for (size_t i = 0; i < sizeof s->buffers / sizeof *buffers; i++)
        gl_buffer_finish(&buffers[i]);
    gl_compositor_finish(s);
    glDeleteProgram(s->project);
    gl_fragments_close(s);
    gl_surfaces_finish(s);
    gl_meshes_finish(s);
    gl_splat_layers_finish(s);
    gl_depth_order_finish(s);
    glDeleteProgram(s->resolve);
    gl_bins_finish(&s->bins);
    gl_upload_finish(&s->upload);
    gl_resample_finish(&s->resample);
    gl_buffer_finish(&s->curve.buffer);
    for (int i = 0; i < GL_IN_FLIGHT; i++) {
        gl_readback_finish(&s->slots[i].readback);
        gl_timer_finish(&s->slots[i].timer);
    }
    s->begun = 0;
}
