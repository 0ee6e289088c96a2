/* SPDX-License-Identifier: Apache-2.0
 *
 * Frames of everything: a medium of constant extinction, streaks in it, two meshes and trained
 * Gaussians, all in one place, seen by one camera, cut by one clip box, over one background; and
 * their image by brute force.
 *
 *   per ray   hits of meshes (support/mesh.h), Gaussians (support/trained.h) and streaks
 *             (support/streaks.h) in order of depth; between two of them, and to the ends of the
 *             ray in the box, the medium's closed form c·(1 − e^−σL)
 *   pixel     the mean of MIXED_RAYS² rays; splats are evaluated at the pixel's centre
 */
#ifndef TESTS_CONFORMANCE_MIXED_H
#define TESTS_CONFORMANCE_MIXED_H

#include "conformance/manifest.h"
#include "support/image.h"
#include "support/medium.h"
#include "support/mesh.h"
#include "support/trained.h"

enum { MIXED_GAUSSIANS = 60, MIXED_RAYS = 4 };

struct mixed_frame {
    struct test_medium medium; /* its view has the layers, and its volume the vectors */
    struct sp_elements torus, cube;
    struct test_gaussian gaussians[MIXED_GAUSSIANS];
    struct sp_volume *volumes[3]; /* "torus", "cube", "gaussians" */
};

void mixed_open(struct mixed_frame *frame, const struct manifest_mixed *row);
void mixed_close(struct mixed_frame *frame);

/* The volume of a layer's id, as sp_render_options.find(). */
struct sp_volume *mixed_find(void *frame, const char *id);

/* False when out of memory. */
bool mixed_truth(const struct mixed_frame *frame, struct test_image *image);

#endif
