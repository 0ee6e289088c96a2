/* SPDX-License-Identifier: Apache-2.0
 *
 * A band: the rows of tiles of a frame that are drawn, resolved and read back together.
 *
 *   reserve ─► start ─► dispatches, each followed by gl_band_follow() ─► send ─► … ─► read
 */
#ifndef GL_BAND_H
#define GL_BAND_H

#include "backend/gl/fragments.h"

enum {
    GL_QUEUED_MIN = 2, /* long dispatches that may be queued on the GPU */
    GL_QUEUED_MAX = 8  /* short ones */
};

struct gl_band {
    struct gl_state *state;
    const struct sp_backend_job *job;
    struct gl_slot *slot;
    const struct gl_fragments *fragments; /* of other layers; NULL = none */
    uint32_t columns;                     /* of tiles */
    uint32_t y, end;                      /* rows [px] */
    uint32_t layer;                       /* layer of the image, [0, 2], that is resolved */
    unsigned queued_max;       /* most dispatches that may be queued, [1, GL_QUEUED_MAX] */
    void *sent[GL_QUEUED_MAX]; /* fences */
    unsigned sent_count;
};

static inline uint32_t gl_band_pixels(const struct gl_band *band) {
    return band->job->frame->width * (band->end - band->y);
}

static inline struct gl_fragments_band gl_band_fragments(const struct gl_band *band) {
    return (struct gl_fragments_band){ band->state, band->fragments, band->job->frame->width,
                                       band->y, band->end };
}

static inline uint32_t gl_band_rows(const struct gl_band *band) {
    return gl_divide_up(band->end - band->y, GL_TILE);
}

static inline uint32_t gl_band_tiles(const struct gl_band *band) {
    return band->columns * gl_band_rows(band);
}

/* Sets the end of the band that begins at band->y: at most `rows` rows of tiles below. */
void gl_band_end(struct gl_band *band, uint32_t rows);

/* Reserves GPU memory for the pixels of the band and their fragments. SP_ERR_MEMORY, SP_ERR_BUDGET.
 * A context must be current, here and below. */
bool gl_band_reserve(struct gl_band *band, struct sp_error *err);

/* For frames without records: chooses the rows of the band that begins at band->y, and reserves its
 * memory. Errors as above. */
bool gl_band_plan(struct gl_band *band, struct sp_error *err);

/* Clears the pixels, their fragments and the counters, and starts the timer. SP_ERR_MEMORY. */
bool gl_band_start(const struct gl_band *band, struct sp_error *err);

enum { GL_LAYER_OF_MOMENTS = 3 }; /* of the image of a frame with depth */

/* Clears layer 1, 2 or 3 of the image, which has as many pixels as layer 0, to zero. */
void gl_band_clear(const struct gl_band *band, uint32_t layer);

/* Makes the writes of shaders visible to later shaders and buffer clears. */
void gl_band_barrier(void);

/* Runs the bound program, which draws a part of the layers, on each tile of the band, then calls
 * gl_band_follow(). */
bool gl_band_draw_layer(struct gl_band *band, struct sp_error *err);

/* Ends a batch or a pass with a fence, and waits for an earlier fence, so that a cancelled frame
 * leaves little queued work. SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_band_follow(struct gl_band *band, struct sp_error *err);

void gl_band_drop_fences(struct gl_band *band);

/* Resolves the pixels and starts the readback of the pixels and the counters. */
bool gl_band_send(const struct gl_band *band, struct sp_error *err);

/* Copies the slot's readback into the frame and *head. */
bool gl_band_read(struct gl_slot *slot, struct sp_frame *frame, struct gl_bins_head *head,
                  struct sp_error *err);

#endif
