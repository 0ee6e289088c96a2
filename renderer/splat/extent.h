/* SPDX-License-Identifier: Apache-2.0
 *
 * The extent of a splat along the ray: its span of depth, for slabs, and the clip planes that cut
 * it. Both are linear functions of the pixel position. Both say which share of the kernel on the
 * pixel's ray counts. ewa.h has the derivation.
 */
#ifndef SP_SPLAT_EXTENT_H
#define SP_SPLAT_EXTENT_H

#include <stdbool.h>
#include <stdint.h>

#include "base/isa.h"
#include "splat/camera.h"

enum {
    SP_CUTS_MAX = 6 + SP_CLIP_PLANES_MAX,
    SP_CUT_TAIL = 4 /* a plane this far from a kernel no longer cuts it [standard deviations]: the
                       lost share is 3e-5 */
};

/* The depth of a kernel on the ray of a pixel at offset d [px] from the splat's centre: a normal
 * distribution of mean distance + slope·d and variance 1/sharpness². Lengths in cells. */
struct sp_span {
    float distance; /* x2 of the centre */
    float slope[2]; /* per pixel, along x and y */
    float sharpness;
    float reach; /* the kernel ends at distance ± reach */
};

/* The half-spaces that cut a kernel: with η = e + k·d [standard deviations] each keeps the share
 * Φ(η). A plane across the ray bounds the depth: side +1 keeps the part behind it (lower bound −η),
 * side −1 the part before it (upper bound η). A plane along the ray (side 0) is a factor. */
struct sp_cut {
    struct sp_cut_plane {
        float e, k[2];
        int side;
    } planes[SP_CUTS_MAX];
};

/* The clip planes of a frame in camera space: they keep normal·u ≥ offset. */
struct sp_clip_frame {
    uint32_t count;
    struct sp_clip_half {
        float normal[3], offset; /* unit length; cells */
    } planes[SP_CUTS_MAX];
};

/* Collects the planes of the view's clip box and list; a face at 0 or 1 does not cut. `unit` is the
 * edge of a cell [world unit]. */
void sp_clip_frame_init(struct sp_clip_frame *clip, const struct sp_camera_transform *camera,
                        const struct sp_grid *grid, const struct sp_clip *view, double unit);

/* A kernel in camera space and in the image, from which its extent is computed. */
struct sp_kernel_place {
    float u[3];         /* centre, cells */
    float kernel[3][3]; /* rows of K */
    float m[3][3];      /* J·K */
    float inverse[3];   /* (V̂ + h²I)⁻¹: xx, xy, yy */
    float h2, det;      /* of the low-pass filter; of V̂ + h²I */
    float distance;     /* x2, cells */
    float radius;       /* Mahalanobis, where the kernel ends */
};

void sp_extent_span(const struct sp_kernel_place *place, struct sp_span *span);

/* Writes the planes that cut the kernel to *cut and returns their number. Returns −1 if the planes
 * remove the whole kernel. */
int sp_extent_cut(const struct sp_kernel_place *place, const struct sp_clip_frame *clip,
                  struct sp_cut *cut);

#endif
