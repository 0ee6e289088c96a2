/* SPDX-License-Identifier: Apache-2.0
 *
 * The one place of the floors: what every backend and instruction set must reach against the
 * integral, scene by scene and choice by choice, in dB (support/image.h says what PSNR is here).
 *
 * `measured` is what the scalar CPU reference reached when the floor was written, floor ≈ measured
 * - 0.5. A floor is lowered only with a reason beside it; when a change raises a measured value by
 * more than 1 dB, raise the floor with it.
 */
#ifndef TESTS_CONFORMANCE_MANIFEST_H
#define TESTS_CONFORMANCE_MANIFEST_H

#include <stddef.h>

#include "support/scene.h"

/* One image of a scene: what differs from the scene's own view. Held to the integral, which is
 * convolved with the low-pass. */
struct manifest_row {
    enum sp_filter_mode filter;
    double lowpass; /* px */
    enum sp_compositing compositing;
    double slab;   /* voxels; slabs only */
    double cutoff; /* 0 = the scene's */
    enum sp_attenuation attenuation;
    double floor, measured; /* dB */
    double apart;           /* dB, see MANIFEST_ISA_FLOOR; 0 = that */
};

struct manifest_scene {
    const char *name; /* as in scene.info.name */
    test_scene_fn *build;
    const struct manifest_row *rows;
    size_t count;
};

/* Adaptive may lose this much against ewa, both held to the integral; above MANIFEST_ALIKE dB the
 * two cannot be told apart and nothing is asked. */
enum { MANIFEST_ALIKE = 60 };
#define MANIFEST_ADAPTIVE_LOSS 0.5

/* The CPU's instruction sets against the scalar reference, and against the first of the others that
 * the machine has. Measured: 97.21 where all of them draw footprints.
 *
 * All but scalar draw sheets without footprints (postconv/postconv.h), and are `apart` dB from it
 * at least: half a decibel less than measured. Footprints end at the cutoff, and theirs do not, so
 * that neither is the nearer to the integral. A row without `apart` is drawn with footprints by
 * all: its view, or the way its bricks are seen, asks for them. */
#define MANIFEST_ISA_FLOOR 96.7

/* Any other backend against the scalar reference, in every image that it can draw. Measured:
 * 87.60 at least with llvmpipe; GPUs are given more, because their exponentials are their own. */
#define MANIFEST_BACKEND_FLOOR 80.0

extern const struct manifest_scene manifest[];
extern const size_t manifest_count;

#endif
