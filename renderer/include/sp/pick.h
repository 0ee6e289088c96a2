/* SPDX-License-Identifier: Apache-2.0
 *
 * Picking: finds what the ray through a point of the image hits. The CPU computes it from the
 * samples of the visible layers.
 *
 * Every sample fills its cell, which reaches from the middle of one gap to the middle of the next.
 * The volume layer fills a cell with the extinction of the transfer function at the sample's value,
 * and at its gradient magnitude if the view uses it. A shell does the same in the cells of its
 * voxels; where the opacity reaches `high`, the shell is opaque. A surface adds its opacity
 * wherever the ray crosses it, that is, where the trilinear interpolation of the samples equals the
 * iso-value. The optical depth of the ray is the exact sum over the cells and surfaces that it
 * crosses:
 *
 *   τ(t) = Σ extinction(cell) · length of the ray in the cell − Σ ln(1 − opacity(surface))
 *   opacity(t) = 1 − e^−τ(t)
 *
 * Kernel, filter and compositing of the volume have no influence. The near plane and the clip do.
 *
 * A point or a Gaussian adds the opacity that it has in the pixel, at the depth of its centre; a
 * triangle adds its opacity where the ray meets it. All elements of a layer are tested.
 */
#ifndef SP_PICK_H
#define SP_PICK_H

#include <stdbool.h>

#include "sp/api.h"
#include "sp/status.h"
#include "sp/view.h"
#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

struct sp_pick_input {
    const struct sp_volume *volume;
    const struct sp_view *view; /* valid (sp_view_validate()) */
    uint32_t size[2];           /* size of the image [px] */
    /* A point of the image [px], finite: x to the right and y down from the upper left corner.
     * (0.5, 0.5) is the centre of the first pixel. */
    double at[2];
    /* As in sp_render_options. A layer whose volume is not found is left out. */
    struct sp_volume *(*find)(void *user, const char *id);
    void *user;
};

struct sp_pick {
    double opacity;     /* of the whole ray, [0, 1] */
    bool is_hit;        /* the opacity reaches 0.5; the fields below are set only then */
    double position[3]; /* world position where the opacity reaches 0.5 */
    double value; /* value of the surface or the point that is hit, or else of the sample whose cell
                     contains `position` [data unit]; NaN = a Gaussian or a triangle is hit */
    uint64_t elements; /* number of elements that were tested; always set */
};

/* Follows the ray through a point of the image. Takes at most dims[0] + dims[1] + dims[2] steps,
 * twice as many with surfaces, and some nanoseconds per element of the visible layers. False:
 * SP_ERR_MEMORY. Thread-safe. */
SP_API bool sp_pick_at(const struct sp_pick_input *input, struct sp_pick *pick,
                       struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
