/* SPDX-License-Identifier: Apache-2.0
 *
 * Chooses the data that a frame draws of its channels. Channels are volumes on the grid of the
 * view's volume, each with a transfer function of its own (draw/resample/README.md, "Channels").
 */
#ifndef SP_WORKING_SET_CHANNELS_H
#define SP_WORKING_SET_CHANNELS_H

#include "draw/working_set/frame_source.h"

/* Checks that the visible channels of the job's view have the grid of `volume`; channels: by layer.
 * Replaces each channel by the volume that the frame draws: the channel itself, or a subvolume of
 * it. All subvolumes have the same level, but may cover different parts. If the levels would
 * differ, also replaces *drawn. SP_ERR_INVALID, SP_ERR_CANCELLED, SP_ERR_MEMORY. */
bool sp_channels_choose_sources(struct sp_volume *volume, const struct sp_frame_source_job *job,
                                struct sp_frame_source *drawn,
                                struct sp_volume *channels[SP_LAYERS_MAX], struct sp_error *err);

#endif
