/* SPDX-License-Identifier: Apache-2.0
 *
 * Images of the tests: RGBA in double precision, associated alpha, row 0 on top. Functions to
 * compare them and to write them to files.
 */
#ifndef TESTS_SUPPORT_IMAGE_H
#define TESTS_SUPPORT_IMAGE_H

#include <stdbool.h>
#include <stddef.h>

#include "sp/frame.h"

struct test_image {
    unsigned width, height; /* px */
    double *rgba;           /* height · width · 4, owned */
};

/* All zero; false when out of memory. Sides in [1, 65536]. */
bool test_image_init(struct test_image *image, unsigned width, unsigned height);
void test_image_finish(struct test_image *image);

static inline double *test_image_at(const struct test_image *image, unsigned x, unsigned y) {
    return image->rgba + ((size_t)y * image->width + x) * 4;
}

/* Copies a frame of either format to a new image (RGBA8: values / 255, converted to associated
 * alpha). False when out of memory. */
bool test_image_from_frame(struct test_image *image, const struct sp_frame *frame);

/* Blends an associated image over a background that is not associated, in place:
 * C + (1 - A)·(rgb·a, a). */
void test_image_over(struct test_image *image, const float background[4]);

/* Mirrors the image left to right, in place. */
void test_image_mirror(struct test_image *image);

/* PSNR [dB] with peak 1: 10·log10(1 / mean (a-b)²), the mean taken over all pixels and all four
 * associated channels. INFINITY when they are equal; NAN when the sizes differ or a value is not
 * finite. */
double test_image_psnr(const struct test_image *a, const struct test_image *b);

struct test_difference {
    double largest; /* max |a-b| over pixels and channels */
    unsigned x, y;  /* where */
    unsigned channel;
    double a, b; /* the two values there */
};
struct test_difference test_image_difference(const struct test_image *a,
                                             const struct test_image *b);

/* The largest |a − 2b + c| of a channel of three frames a, b, c in a row, which have the same size.
 * A change that jumps from one frame to the next adds to it; an even change does not. */
double test_image_bend(const struct test_image frames[3]);

/* Mean and population variance of one channel, [0,3]. */
void test_image_statistics(const struct test_image *image, unsigned channel, double *mean,
                           double *variance);

/* Writes an 8-bit RGB PNG (uncompressed, over black, values clamped to [0,1]). False on failure. */
bool test_image_write_png(const struct test_image *image, const char *path);

/* Writes NAME.png with `got`, `wanted` and `gain` times their absolute difference side by side, to
 * the folder $SPLATD_TEST_DUMP (default: `dump` in the current folder). Prints the path. */
void test_image_dump(const char *name, const struct test_image *got,
                     const struct test_image *wanted, double gain);

#endif
