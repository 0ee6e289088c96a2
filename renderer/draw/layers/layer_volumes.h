/* SPDX-License-Identifier: Apache-2.0
 *
 * The other volumes of a frame: those that layers name by their ids.
 */
#ifndef SP_LAYERS_LAYER_VOLUMES_H
#define SP_LAYERS_LAYER_VOLUMES_H

#include "sp/renderer.h"

/* By layer of the view; one reference each, NULL = the layer names none. */
struct sp_layer_volumes {
    struct sp_volume *shown[SP_LAYERS_MAX];  /* whose elements it shows: id */
    struct sp_volume *colors[SP_LAYERS_MAX]; /* whose samples give its colours: color_by */
};

/* Finds the volumes that the visible layers of a view of `volume` name, by options->find(), and
 * checks that they suit. *others was all NULL. SP_ERR_VOLUME_UNKNOWN, SP_ERR_INVALID, with the JSON
 * pointer as the place; volumes found until then stay in *others for sp_layer_volumes_finish(). */
bool sp_layer_volumes_find(const struct sp_view *view, const struct sp_volume *volume,
                           const struct sp_render_options *options, struct sp_layer_volumes *others,
                           struct sp_error *err);
void sp_layer_volumes_finish(struct sp_layer_volumes *others);

#endif
