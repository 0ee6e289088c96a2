/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/layer_drawing.h"

#include "base/clock.h"
#include "base/minmax.h"

bool gl_layer_drawing_make(struct gl_layer_drawing *l, struct gl_band *band, struct sp_error *err) {
    struct gl_state *s = band->state;
    double start_ms = sp_clock_ms();
    gl_residency_begin(&s->residency);
    if (!gl_fragments_open(s, err) || !gl_fragments_make(&l->fragments, s, band->job, err))
        return false;
    band->fragments = &l->fragments;
    band->slot->stage_ms[GL_STAGE_LAYERS] += sp_clock_ms() - start_ms;
    return true;
}

bool gl_layer_drawing_begin(struct gl_layer_drawing *l, const struct gl_band *band,
                            struct sp_error *err) {
    if (!gl_surfaces_begin(&l->surfaces, band, err) || !gl_meshes_begin(&l->meshes, band, err) ||
        !gl_splat_layers_begin(&l->splats, band, err))
        return false;
    l->fragments.grows = l->surfaces.count > 0 || l->meshes.count > 0 ||
                         (l->splats.count > 0 && !l->splats.is_alone);
    return true;
}

void gl_layer_drawing_divide(struct gl_layer_drawing *l, const struct gl_band *band) {
    if (gl_layer_drawing_rounds(l)) {
        gl_meshes_divide(&l->meshes, &band->slot->pieces);
        gl_splat_layers_divide(&l->splats, &band->slot->pieces);
    }
    l->fragments.state_words =
        sp_maxu(l->surfaces.sheet_words, sp_maxu(l->meshes.words, l->splats.words));
}

bool gl_layer_drawing_reserve(const struct gl_layer_drawing *l, const struct gl_band *band,
                              struct sp_error *err) {
    return gl_meshes_reserve(&l->meshes, band, err) &&
           gl_splat_layers_reserve(&l->splats, band, err);
}

uint64_t gl_layer_drawing_dispatches(const struct gl_layer_drawing *l) {
    return (uint64_t)l->surfaces.passes + l->meshes.dispatches + l->splats.dispatches;
}

bool gl_layer_drawing_draw(struct gl_layer_drawing *l, struct gl_band *band, struct sp_error *err) {
    return gl_surfaces_draw(&l->surfaces, band, err) && gl_meshes_draw(&l->meshes, band, err) &&
           gl_splat_layers_draw(&l->splats, band, err);
}
