/* SPDX-License-Identifier: Apache-2.0
 *
 * Slices in the image (README.md): the volume is drawn in convex parts, with slices between them.
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
    struct sp_frame_pool *frames; /* for two frames in floating point */
    struct sp_interrupt interrupt;
    /* Draws the volume with this clip over nothing into a frame of format SP_RGBAF32. */
    bool (*draw)(void *user, const struct sp_clip *clip, struct sp_frame *frame,
                 struct sp_error *err);
    void *user; /* passed to draw() */
};

/* Fills the pixels of the frame, if sp_view_draws_slices(). False: draw() failed, SP_ERR_MEMORY or
 * SP_ERR_CANCELLED. */
bool sp_compose(const struct sp_compose_job *job, struct sp_frame *frame, struct sp_error *err);

#endif
