/* SPDX-License-Identifier: Apache-2.0
 *
 * What a splat is along the ray: its span of depth, for slabs, and the planes that cut it. Both are
 * linear forms of the pixel, so that a compositor asks one question: which share of the ray's way
 * through the kernel counts? (ewa.h has the derivation.)
 */
#ifndef SP_SPLAT_EXTENT_H
#define SP_SPLAT_EXTENT_H

#include <stdbool.h>
#include <stdint.h>

#include "base/isa.h"
#include "splat/camera.h"

enum { SP_CUTS_MAX = 6 + SP_CLIP_PLANES_MAX };

/* Depth of the kernel on the ray of a pixel at d from the splat's centre: normal, of mean
 * distance + slope·d and variance 1/sharpness². Lengths in cells. */
struct sp_span {
    float distance; /* x2 of the centre */
    float slope[2]; /* a pixel */
    float sharpness;
    float reach; /* the kernel ends this far before and behind its centre */
};

/* The half-spaces that a kernel is cut to: inside where η = e + k·d is large, share Φ(η). A plane
 * that lies across the ray bounds the depth: side +1 keeps what lies behind it, −1 what lies before
 * it; the one bound is then −η, the other η, in standard deviations. Planes along the ray (side 0)
 * are factors. */
struct sp_cut {
    struct sp_cut_plane {
        float e, k[2];
        int side;
    } planes[SP_CUTS_MAX];
};

/* The planes of a frame, in camera space: inside where normal·u ≥ offset. */
struct sp_clip_frame {
    uint32_t count;
    struct sp_clip_half {
        float normal[3], offset; /* unit length; cells */
    } planes[SP_CUTS_MAX];
};

/* Planes of the view's clip box and list; a face at 0 or 1 does not cut. `unit` is the edge of a
 * cell in world units. */
void sp_clip_frame_init(struct sp_clip_frame *clip, const struct sp_camera_frame *camera,
                        const struct sp_grid *grid, const struct sp_clip *view, double unit);

/* A kernel in camera space and on the image: what its extent follows from. */
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

/* How many planes cut the kernel: they are written to *cut. −1: nothing of it is left. */
int sp_extent_cut(const struct sp_kernel_place *place, const struct sp_clip_frame *clip,
                  struct sp_cut *cut);

#endif
