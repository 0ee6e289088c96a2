/* SPDX-License-Identifier: Apache-2.0
 *
 * Computes the rays of a rectangle of pixels from the ray through its centre, which is computed in
 * double precision. x and y are the offset of a pixel from the centre:
 *
 *   moved = (x·right + y·down)/(1 + x·fall[0] + y·fall[1])
 *   u = at + moved·lever,  du = change ± moved in perspective     likewise v and dv
 *
 * Rays that go far from slice to slice also need sheets half-way between the slices. Such sheets
 * change the image slightly. Therefore, where the steepness of rays is near the limit, both images
 * are drawn and mixed per pixel:
 *
 *   share of half sheets = (steepness − steep[0])/(steep[1] − steep[0]), kept in [0, 1]
 *
 * Steepness is the length of a ray from slice to slice, in samples or in distances of slices,
 * whichever is more.
 */
#ifndef SP_RESAMPLE_RAYS_H
#define SP_RESAMPLE_RAYS_H

#include "draw/resample/resample.h"

/* Sheets per slice, as bits. */
enum { RESAMPLE_WHOLE = 1, RESAMPLE_HALVES = 2 };

struct sp_resample_rays {
    int axis[3];       /* of the volume: u, v, and the slices' axis */
    bool is_backwards; /* rays cross the slices from the last to the first */
    bool is_too_wide;  /* some rays may miss the slices: the caller must divide the rectangle */
    int sheets;        /* RESAMPLE_…: the sheets that some of the rays need */
    float reference;   /* slice coordinate at s = 0 */
    double at[2], change[2];
    double right[2], down[2], fall[2];
    double lever; /* perspective: slices from the eye to s = 0; orthographic: 1 */
    double centre[2];
};

/* Returns the coordinate of the middle of the first channel's volume along an axis. Rays along this
 * axis have s = 0 there. */
float sp_resample_reference(const struct sp_resample *r, int axis);

/* Fills *rays for a rectangle. `place`: x, y, width and height [px]. */
void sp_resample_rays_init(struct sp_resample_rays *rays, const struct sp_resample *r,
                           const int place[4]);

#endif
