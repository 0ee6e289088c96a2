/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/layer_volumes.h"

#include <stdio.h>
#include <string.h>

/* Finds the volume of an id; NULL with *err set. */
static struct sp_volume *find_volume(const struct sp_render_options *o, const char *id,
                                     const char *place, struct sp_error *err) {
    struct sp_volume *volume = o->find ? o->find(o->user, id) : NULL;
    if (!volume)
        sp_fail(err, SP_ERR_VOLUME_UNKNOWN, place,
                "no volume \"%s\" is loaded: load it, or remove the layer", id);
    return volume;
}

/* The size of all samples, of which struct sp_volume may have a coarse level. */
static const uint32_t *dims_of(const struct sp_volume_info *info) {
    return info->whole.dims[0] ? info->whole.dims : info->grid.dims;
}

/* Finds the volume that gives the colours of a layer of `volume`. */
static bool find_colors(const struct sp_view *view, uint32_t i, const struct sp_volume *volume,
                        const struct sp_render_options *o, struct sp_volume **colors,
                        struct sp_error *err) {
    const struct sp_layer *layer = &view->layers[i];
    char place[32];
    snprintf(place, sizeof place, "/layers/%u/color_by", i);
    if ((layer->type != SP_LAYER_VECTORS && layer->type != SP_LAYER_POINTS) ||
        !layer->color_by[0] || strcmp(layer->color_by, SP_COLOR_BY_LENGTH) == 0)
        return true;
    *colors = find_volume(o, layer->color_by, place, err);
    if (!*colors)
        return false;
    const struct sp_volume_info *a = sp_volume_info(*colors), *b = sp_volume_info(volume);
    return (a->elements.kind == b->elements.kind && a->elements.count == b->elements.count &&
            memcmp(dims_of(a), dims_of(b), sizeof a->grid.dims) == 0) ||
           sp_fail(err, SP_ERR_INVALID, place,
                   "\"%s\" has other samples than the volume of the layer: name another field of "
                   "its file",
                   layer->color_by);
}

bool sp_layer_volumes_find(const struct sp_view *view, const struct sp_volume *volume,
                           const struct sp_render_options *o, struct sp_layer_volumes *others,
                           struct sp_error *err) {
    for (uint32_t i = 0; i < view->layer_count; i++) {
        const struct sp_layer *layer = &view->layers[i];
        char place[32];
        snprintf(place, sizeof place, "/layers/%u/id", i);
        if (!layer->visible)
            continue;
        if (layer->type >= SP_LAYER_POINTS && layer->id[0]) {
            others->volumes[i] = find_volume(o, layer->id, place, err);
            if (!others->volumes[i] ||
                !sp_view_layer_fits(view, i, sp_volume_info(others->volumes[i]), err))
                return false;
        }
        if (!find_colors(view, i, others->volumes[i] ? others->volumes[i] : volume, o,
                         &others->colors[i], err))
            return false;
    }
    return true;
}

void sp_layer_volumes_finish(struct sp_layer_volumes *others) {
    for (int i = 0; i < SP_LAYERS_MAX; i++) {
        sp_volume_unref(&others->volumes[i]);
        sp_volume_unref(&others->colors[i]);
    }
}
