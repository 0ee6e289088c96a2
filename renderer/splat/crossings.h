/* SPDX-License-Identifier: Apache-2.0
 *
 * Finds where a ray crosses the visible iso-surfaces of a view, in order along the ray.
 *
 * The surface of value v is the set f = v, where f is the trilinear interpolant of the samples.
 * Points with f >= v are inside. Along a ray, f is a cubic polynomial in each cell between samples.
 * Its roots are computed up to rounding. As in the image, a surface ends at the outermost samples
 * and at the clip, and a cell with a sample that is not finite has no surface.
 */
#ifndef SP_SPLAT_CROSSINGS_H
#define SP_SPLAT_CROSSINGS_H

#include "sp/volume.h"
#include "splat/ray.h"

struct sp_crossing {
    double t; /* along the ray, world units */
    const struct sp_layer *layer;
};

struct sp_crossings {
    struct sp_ray ray; /* only the part between the outermost samples */
    struct sp_ray_walk walk;
    const void *voxels;
    enum sp_type type;
    const struct sp_layer *layers[SP_LAYERS_MAX];
    int state[SP_LAYERS_MAX]; /* at `t`: 1 = inside, 0 = outside, -1 = unknown */
    uint32_t layer_count;
    bool is_done;
    double t;                                    /* where the current cell begins on the ray */
    struct sp_crossing found[4 * SP_LAYERS_MAX]; /* of the previous cell, in order along the ray */
    uint32_t count, next;
};

/* Starts at the begin of the ray. The view and the volume are borrowed. */
void sp_crossings_init(struct sp_crossings *self, const struct sp_ray *ray,
                       const struct sp_view *view, const struct sp_volume *volume);

/* Returns the next crossing and does not remove it; NULL = the ray has no more crossings.
 * sp_crossings_pop() removes it. */
const struct sp_crossing *sp_crossings_peek(struct sp_crossings *self);
void sp_crossings_pop(struct sp_crossings *self);

#endif
