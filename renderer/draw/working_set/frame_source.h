/* SPDX-License-Identifier: Apache-2.0
 *
 * What a frame draws: the volume, or of a volume that is larger than memory, a window of it.
 */
#ifndef SP_WORKING_SET_FRAME_SOURCE_H
#define SP_WORKING_SET_FRAME_SOURCE_H

#include "sp/renderer.h"

struct sp_frame_source {
    struct sp_volume *volume; /* a reference */
    struct sp_view view;      /* for this volume */
    unsigned mip_level;       /* to draw it with */
    struct sp_frame_bricks bricks;
};

/* What is asked for. */
struct sp_frame_source_job {
    const struct sp_view *view;
    const struct sp_render_options *options; /* say how long to wait for bricks */
    bool reads_blocks;                       /* the backend does, if the view needs nothing else */
    unsigned least;                          /* no finer level of the file is shown */
};

/* SP_ERR_CANCELLED, SP_ERR_MEMORY. */
bool sp_frame_source_choose(struct sp_volume *volume, const struct sp_frame_source_job *job,
                            struct sp_frame_source *drawn, struct sp_error *err);

/* Replaces volumes that are larger than memory, and that give streaks of shown->volume their
 * colours, by their samples around it, perhaps of a coarser level; colors: by layer. The same
 * errors. */
bool sp_frame_source_replace_colors(const struct sp_view *view,
                                    const struct sp_render_options *options,
                                    struct sp_frame_source *drawn,
                                    struct sp_volume *colors[SP_LAYERS_MAX], struct sp_error *err);

#endif
