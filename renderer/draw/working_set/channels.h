/* SPDX-License-Identifier: Apache-2.0
 *
 * What a frame draws of its channels: volumes on the grid of the view's volume, each with a
 * transfer function of its own (draw/resample/README.md, "Channels").
 */
#ifndef SP_WORKING_SET_CHANNELS_H
#define SP_WORKING_SET_CHANNELS_H

#include "draw/working_set/frame_source.h"

/* Checks that the visible channels of the job's view have the grid of `volume`; channels: by layer.
 * Replaces each by what the frame draws of it: itself, or a window. All windows have one level, but
 * perhaps show different parts. Where they would have different levels, replaces *shown, too.
 * SP_ERR_INVALID, SP_ERR_CANCELLED, SP_ERR_MEMORY. */
bool sp_channels_choose_sources(struct sp_volume *volume, const struct sp_frame_source_job *job,
                                struct sp_frame_source *drawn,
                                struct sp_volume *channels[SP_LAYERS_MAX], struct sp_error *err);

#endif
