/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/compositor.h"

#include <epoxy/gl.h>
#include <stdio.h>
#include <string.h>

#include "splat/cubic.h"

static const char *sources_of(const struct gl_compositor_choices *c) {
    if (c->is_post && c->has_layers)
        return "frame bins records normal footprint shade post fragments insert composite";
    if (c->is_post)
        return "frame bins records normal footprint shade post composite";
    return c->has_layers ? "frame bins records normal footprint fragments insert composite"
                         : "bins records normal footprint composite";
}

unsigned gl_compositor_open(struct gl_state *s, const struct gl_compositor_choices *c,
                            struct sp_error *err) {
    struct gl_late_program *own = &s->composite[c->mode][c->is_flat][c->is_cubic][c->is_clipped]
                                               [c->is_linear][c->is_post][c->has_layers];
    char defines[160];
    snprintf(defines, sizeof defines,
             "#define COMPOSITING %du\n#define FLAT %d\n#define CUBIC %d\n#define CLIPPED %d\n"
             "#define LINEAR %d\n#define POST %d\n#define LAYERS %d\n",
             (int)c->mode, c->is_flat, c->is_cubic, c->is_clipped, c->is_linear, c->is_post,
             c->has_layers);
    gl_program_late(own, sources_of(c), defines, s->device, "this view", err);
    return own->program;
}

unsigned gl_compositor_choose(struct gl_state *s, const struct gl_frame *f,
                              const struct sp_view *view, bool has_layers, struct sp_error *err) {
    const struct gl_compositor_choices choices = {
        .mode = f->compositing,
        .is_flat = view->filter.mode == SP_FILTER_NONE,
        .is_cubic = view->filter.kernel == SP_KERNEL_CUBIC,
        .is_clipped = gl_frame_ewa(f)->clip.count > 0,
        .is_linear = view->compositing.attenuation == SP_ATTENUATION_LINEAR,
        .is_post = f->is_post,
        .has_layers = has_layers
    };
    return gl_compositor_open(s, &choices, err);
}

bool gl_compositor_init(struct gl_state *s, struct sp_error *err) {
    struct sp_cubic_table *table = sp_arena_alloc(&s->arena, "cubic kernel", 1, sizeof *table);
    if (!table)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the cubic kernel");
    sp_cubic_table_init(table);
    if (!gl_buffer_reserve(&s->buffers.cubic, "cubic kernel", sizeof *table, 0, GL_USE_KEPT, err))
        return false;
    gl_buffer_write(&s->buffers.cubic, table, sizeof *table);
    return true;
}

void gl_compositor_finish(struct gl_state *s) {
    struct gl_late_program *own = &s->composite[0][0][0][0][0][0][0];
    for (size_t i = 0; i < sizeof s->composite / sizeof *own; i++)
        glDeleteProgram(own[i].program);
    memset(s->composite, 0, sizeof s->composite);
}
