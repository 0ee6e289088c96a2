/* SPDX-License-Identifier: Apache-2.0
 *
 * Fragments of other layers (frame/fragments.h) on the GPU: the fragments of one band. The shaders
 * of the volume insert them between the parts of the volume (shaders/fragments.glsl).
 */
#ifndef GL_FRAGMENTS_H
#define GL_FRAGMENTS_H

#include "backend/gl/state.h"
#include "draw/footprints/insert.h"

enum { GL_FRAGMENTS = 8 /* binding of the buffer */ };

/* The fragments of a frame's other layers. `insert` tells between which sheets, slabs or splats of
 * the volume a depth lies. Resampled sheets, and frames without a volume, do not use `insert`. */
struct gl_fragments {
    struct gl_layers_made made;
    struct sp_insert insert;
    bool grows;           /* the frame will have fragments */
    uint32_t state_words; /* words of four per pixel between passes of other layers */
};

/* Prepares the layers of a frame (draw/layers/layers.h) in the state's arena. SP_ERR_MEMORY,
 * SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool gl_fragments_make(struct gl_fragments *fragments, struct gl_state *state,
                       const struct sp_backend_job *job, struct sp_error *err);

/* Relates the depths of fragments to the layers of the frame's partition. SP_ERR_MEMORY. */
bool gl_fragments_relate(struct gl_fragments *fragments, const struct gl_frame *frame,
                         struct gl_state *state, struct sp_error *err);

/* The fragments of a band: rows [y, end) of the image. */
struct gl_fragments_band {
    struct gl_state *state;
    const struct gl_fragments *fragments; /* NULL = the frame has none: the functions do nothing */
    uint32_t width, y, end;               /* px */
};

/* Compiles the program at the first use. SP_ERR_UNSUPPORTED. A context must be current, here and
 * below. */
bool gl_fragments_open(struct gl_state *state, struct sp_error *err);
void gl_fragments_close(struct gl_state *state);

/* Reserves memory for the fragments of a band. SP_ERR_MEMORY, SP_ERR_BUDGET. */
bool gl_fragments_reserve(const struct gl_fragments_band *band, struct sp_error *err);

/* Empties the lists of all pixels. Sets *most to the number of fragments that fit the memory.
 * SP_ERR_MEMORY. */
bool gl_fragments_start(const struct gl_fragments_band *band, uint32_t *most, struct sp_error *err);

/* Call after a band was drawn: true if its `stored` fragments fit the memory for `most` fragments.
 * Otherwise the next attempt reserves more memory. */
bool gl_fragments_fit(struct gl_state *state, uint32_t stored, uint32_t most, uint64_t pixels);

/* Binds the buffer and sets the uniforms of shaders/insert.glsl. */
void gl_fragments_use(const struct gl_fragments_band *band);

/* Composites the fragments behind the volume, or all of them if there is none. */
void gl_fragments_finish(const struct gl_fragments_band *band);

#endif
