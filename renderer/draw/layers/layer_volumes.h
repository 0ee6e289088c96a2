/* SPDX-License-Identifier: Apache-2.0
 *
 * The other volumes of a frame: the volumes that layers name by their ids.
 */
#ifndef SP_LAYERS_LAYER_VOLUMES_H
#define SP_LAYERS_LAYER_VOLUMES_H

#include "sp/renderer.h"

/* By layer of the view: one reference to each volume, owned; NULL = the layer names no volume. */
struct sp_layer_volumes {
    struct sp_volume *volumes[SP_LAYERS_MAX]; /* whose elements the layer shows: id */
    struct sp_volume *colors[SP_LAYERS_MAX];  /* whose samples give its colours: color_by */
};

/* Finds the volumes that the visible layers of a view of `volume` name, with options->find(), and
 * checks that they suit. *others must be all NULL before. SP_ERR_VOLUME_UNKNOWN, SP_ERR_INVALID,
 * with the JSON pointer as the place. Call sp_layer_volumes_finish() also after a failure. */
bool sp_layer_volumes_find(const struct sp_view *view, const struct sp_volume *volume,
                           const struct sp_render_options *options, struct sp_layer_volumes *others,
                           struct sp_error *err);
void sp_layer_volumes_finish(struct sp_layer_volumes *others);

#endif
