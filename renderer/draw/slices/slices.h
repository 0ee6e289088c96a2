/* SPDX-License-Identifier: Apache-2.0
 *
 * Draws slices together with the volume (README.md): the volume is drawn in convex parts, with
 * slices between them.
 */
#ifndef SP_SLICES_SLICES_H
#define SP_SLICES_SLICES_H

#include "base/interrupt.h"
#include "base/parallel_for.h"
#include "sp/frame.h"
#include "sp/view.h"
#include "sp/volume.h"

struct sp_compose_job {
    const struct sp_volume *volume;
    const struct sp_view *view; /* valid */
    struct sp_pool *workers;
    struct sp_frame_pool *frames; /* provides two temporary frames of floats */
    struct sp_interrupt interrupt;
    /* Draws the volume with this clip over a transparent background into a frame of format
     * SP_RGBAF32. */
    bool (*draw)(void *user, const struct sp_clip *clip, struct sp_frame *frame,
                 struct sp_error *err);
    void *user; /* passed to draw() */
};

/* Fills the pixels of the frame. The view must pass sp_view_draws_slices(). False with *err set:
 * the error of draw(), SP_ERR_MEMORY or SP_ERR_CANCELLED. */
bool sp_compose(const struct sp_compose_job *job, struct sp_frame *frame, struct sp_error *err);

#endif
