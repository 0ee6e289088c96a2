/* SPDX-License-Identifier: Apache-2.0
 *
 * The one place of the floors: what every backend and instruction set must reach against the
 * integral, scene by scene, in dB (support/image.h says what PSNR is here).
 *
 * `measured` is what the scalar CPU reference reached when the floor was written, floor ≈ measured
 * - 0.5. A floor is lowered only with a reason beside it; when a change raises a measured value by
 * more than 1 dB, raise the floor with it.
 */
#ifndef TESTS_CONFORMANCE_MANIFEST_H
#define TESTS_CONFORMANCE_MANIFEST_H

#include <stddef.h>

#include "support/scene.h"

struct manifest_floor {
    double floor, measured; /* dB */
};

struct manifest_entry {
    const char *name;
    test_scene_fn *build;
    struct manifest_floor exact;    /* filter ewa, lowpass 0, against the integral */
    struct manifest_floor lowpass;  /* filter ewa, lowpass 1, against the convolved integral */
    struct manifest_floor adaptive; /* filter adaptive, lowpass 1, against the same */
};

/* Adaptive may lose this much against ewa, both held to the integral; above MANIFEST_ALIKE dB the
 * two cannot be told apart and nothing is asked. */
enum { MANIFEST_ALIKE = 60 };
#define MANIFEST_ADAPTIVE_LOSS 0.5

extern const struct manifest_entry manifest[];
extern const size_t manifest_count;

#endif
