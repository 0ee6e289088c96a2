/* SPDX-License-Identifier: Apache-2.0
 *
 * The PSNR floors, in dB, of every backend and instruction set against the integral
 * (support/truth.h), for each scene and each set of view settings. support/image.h defines PSNR.
 *
 * `measured` is the PSNR of the scalar CPU reference when the floor was set; floor ≈ measured -
 * 0.5. Never lower a floor to make a test pass. If the expected image itself changes, set the new
 * floor and write the reason beside it. When a change raises a measured value by more than 1 dB,
 * raise the floor as well.
 */
#ifndef TESTS_CONFORMANCE_MANIFEST_H
#define TESTS_CONFORMANCE_MANIFEST_H

#include <stddef.h>

#include "support/scene.h"

/* One image of a scene. These settings replace the settings of the scene's view. The image is
 * compared with the integral, convolved with the low-pass filter. */
struct manifest_row {
    enum sp_filter_mode filter;
    double lowpass; /* px */
    enum sp_compositing compositing;
    double slab;   /* thickness, voxels; for compositing `slab` only */
    double cutoff; /* 0 = the cutoff of the scene's view */
    enum sp_attenuation attenuation;
    double floor, measured; /* dB */
    double isa_floor;       /* dB; 0 = MANIFEST_ISA_FLOOR, see there */
};

struct manifest_scene {
    const char *name; /* as in scene.info.name */
    test_scene_fn *build;
    const struct manifest_row *rows;
    size_t count;
};

/* Against the integral, the PSNR of `adaptive` may be at most this much below the PSNR of `ewa`
 * [dB]. An adaptive image above MANIFEST_ADAPTIVE_ENOUGH dB always passes: the difference is then
 * invisible. */
enum { MANIFEST_ADAPTIVE_ENOUGH = 60 };
#define MANIFEST_ADAPTIVE_LOSS 0.5

/* Floor of the CPU's instruction sets against the scalar reference, and against the first other
 * instruction set that the machine has [dB]. Measured: 97.21 where all of them draw footprints.
 *
 * All instruction sets except scalar draw post-convolved sheets (draw/postconv/postconv.h). Their
 * floor against scalar is the row's `isa_floor`, half a decibel below the measured value. The two
 * differ because footprints end at the cutoff and post-convolved kernels do not; neither is closer
 * to the integral. All instruction sets draw a row without `isa_floor` with footprints, because its
 * view or the perspective on its bricks requires them. */
#define MANIFEST_ISA_FLOOR 96.7

/* Floor of any other backend against the scalar reference, in every image that it supports [dB].
 * Measured: at least 87.60 with llvmpipe. The margin is for GPUs, whose exponential functions have
 * other rounding errors. */
#define MANIFEST_BACKEND_FLOOR 80.0

/* A frame of everything (mixed.h) against its brute-force image. */
struct manifest_mixed {
    const char *name;
    enum sp_projection projection;
    enum sp_compositing compositing;
    enum sp_tf_order order;
    enum sp_vectors_style style;
    double floor, measured; /* of every target against the brute force [dB] */
    double target_floor;    /* of every target against the scalar reference [dB] */
};
extern const struct manifest_mixed manifest_mixed[];
extern const size_t manifest_mixed_count;

extern const struct manifest_scene manifest[];
extern const size_t manifest_count;

#endif
