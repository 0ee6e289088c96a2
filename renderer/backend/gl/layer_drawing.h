/* SPDX-License-Identifier: Apache-2.0
 *
 * Draws the layers of a frame other than the volume, in the order in which they make fragments:
 * layers with few fragments come first, as in draw/layers/layers.c.
 *
 *   make ─► (the volume) ─► begin ─► per band: divide ─► reserve ─► draw
 */
#ifndef GL_LAYER_DRAWING_H
#define GL_LAYER_DRAWING_H

#include "backend/gl/meshes.h"
#include "backend/gl/splat_layers.h"
#include "backend/gl/surfaces.h"

struct gl_layer_drawing {
    struct gl_fragments fragments;
    struct gl_surfaces surfaces;
    struct gl_meshes meshes;
    struct gl_splat_layers splats;
};

/* Prepares the layers of a frame and sets band->fragments. SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED, SP_ERR_UNSUPPORTED. A context must be current, here and below. */
bool gl_layer_drawing_make(struct gl_layer_drawing *layers, struct gl_band *band,
                           struct sp_error *err);

/* Uploads the data of the layers, after the data of the volume. Errors as above. */
bool gl_layer_drawing_begin(struct gl_layer_drawing *layers, const struct gl_band *band,
                            struct sp_error *err);

/* Cost of drawing one splat or triangle on one tile, in rounds of the shader's loop. It bounds the
 * size of a dispatch. 0 = the layers have neither splats nor triangles. */
static inline uint32_t gl_layer_drawing_rounds(const struct gl_layer_drawing *layers) {
    return layers->meshes.count ? GL_MESH_ROUNDS : layers->splats.count ? GL_SPLAT_ROUNDS : 0;
}

/* Divides records into dispatches by the slot's pieces, before the band's memory is reserved. */
void gl_layer_drawing_divide(struct gl_layer_drawing *layers, const struct gl_band *band);

/* Reserves memory for the records of a band. SP_ERR_MEMORY, SP_ERR_BUDGET. */
bool gl_layer_drawing_reserve(const struct gl_layer_drawing *layers, const struct gl_band *band,
                              struct sp_error *err);

/* Returns the approximate number of dispatches per band. */
uint64_t gl_layer_drawing_dispatches(const struct gl_layer_drawing *layers);

/* Adds all layers to a band that was started. SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_layer_drawing_draw(struct gl_layer_drawing *layers, struct gl_band *band,
                           struct sp_error *err);

#endif
