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

/* One picture of a scene: what differs from the scene's own view. Held to the integral, which is
 * convolved with the low-pass. */
struct manifest_row {
    enum sp_filter_mode filter;
    double lowpass; /* px */
    enum sp_compositing compositing;
    double slab;   /* voxels; slabs only */
    double cutoff; /* 0 = the scene's */
    enum sp_attenuation attenuation;
    double floor, measured; /* dB */
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

/* Every instruction set of the CPU against the scalar reference, every row. Measured: 97.36 (AVX2
 * and AVX-512, which round a product and a sum once; SSE4.1 is bit-equal). */
#define MANIFEST_ISA_FLOOR 96.8

extern const struct manifest_scene manifest[];
extern const size_t manifest_count;

#endif
