/* SPDX-License-Identifier: Apache-2.0
 *
 * The rays of a rectangle of pixels, from the ray through its centre, which is computed in double
 * precision. With x and y, the pixel's distance from the centre:
 *
 *   moved = (x·right + y·down)/(1 + x·fall[0] + y·fall[1])
 *   u = at + moved·lever,  du = change ± moved in perspective     likewise v and dv
 *
 * Rays that go far from slice to slice need a sheet half way between them, too. Such sheets change
 * the image slightly, so where rays are about as steep as the limit both images are drawn and mixed
 * per pixel:
 *
 *   share of half sheets = (steepness − steep[0])/(steep[1] − steep[0]), kept in [0, 1]
 *
 * Steepness: how far a ray goes from slice to slice, in samples or in distances of slices,
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
    bool is_too_wide;  /* some rays may never cross the slices: divide the rectangle */
    int sheets;        /* RESAMPLE_…: those that some of the rays need */
    float reference;   /* slice coordinate at s = 0 */
    double at[2], change[2];
    double right[2], down[2], fall[2];
    double lever; /* perspective: slices from the eye to s = 0; orthographic: 1 */
    double centre[2];
};

/* The coordinate of the middle of the first channel's volume along an axis: s = 0 of rays along it.
 */
float sp_resample_reference(const struct sp_resample *r, int axis);

/* `place`: x, y, width and height [px]. */
void sp_resample_rays_init(struct sp_resample_rays *rays, const struct sp_resample *r,
                           const int place[4]);

#endif
