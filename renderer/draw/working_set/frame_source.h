/* SPDX-License-Identifier: Apache-2.0
 *
 * Chooses the volume that a frame draws: the view's volume, or a subvolume of it if it is larger
 * than memory.
 */
#ifndef SP_WORKING_SET_FRAME_SOURCE_H
#define SP_WORKING_SET_FRAME_SOURCE_H

#include "sp/renderer.h"

struct sp_frame_source {
    struct sp_volume *volume; /* one reference, owned */
    struct sp_view view;      /* the view, converted for this volume */
    unsigned mip_level;       /* level of detail for drawing it */
    struct sp_frame_bricks bricks;
};

/* The request of a frame. */
struct sp_frame_source_job {
    const struct sp_view *view;
    const struct sp_render_options *options; /* wait_ms: how long to wait for bricks */
    bool reads_blocks; /* the backend can draw volumes whose samples lie in blocks */
    unsigned least;    /* finest level of the file that may be shown */
};

/* Fills *drawn; the caller releases drawn->volume. SP_ERR_CANCELLED, SP_ERR_MEMORY. */
bool sp_frame_source_choose(struct sp_volume *volume, const struct sp_frame_source_job *job,
                            struct sp_frame_source *drawn, struct sp_error *err);

/* Replaces the volumes that give the streaks of drawn->volume their colours, if they are larger
 * than memory, by subvolumes of their samples around drawn->volume. A subvolume may have a coarser
 * level. colors: by layer. SP_ERR_CANCELLED, SP_ERR_MEMORY. */
bool sp_frame_source_replace_colors(const struct sp_view *view,
                                    const struct sp_render_options *options,
                                    struct sp_frame_source *drawn,
                                    struct sp_volume *colors[SP_LAYERS_MAX], struct sp_error *err);

#endif
