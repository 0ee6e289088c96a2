/* SPDX-License-Identifier: Apache-2.0
 *
 * Shared code of the tests of image quality. Each test is a program that prints tables of measured
 * values and checks claims about them, on one backend after the other.
 */
#ifndef TESTS_CONFORMANCE_QUALITY_H
#define TESTS_CONFORMANCE_QUALITY_H

#include <stdbool.h>

#include "support/render.h"
#include "support/truth.h"

enum { QUALITY_TRUTHS = 64 };

struct quality {
    struct test_target target;
    struct test_renderer renderer; /* two threads */
    unsigned checks, failed;
    struct quality_truth {
        char scene[128];
        struct sp_camera camera;
        double lowpass;
        struct test_image image;
    } truths[QUALITY_TRUTHS]; /* in the order in which the first target requested them */
    unsigned truth_count;     /* truths computed so far */
    unsigned truth_next;      /* index of the next truth that the current target requests */
};

/* Calls `measure` for every target that starts on this machine. Returns the exit status of main().
 */
int quality_main(void (*measure)(struct quality *q));

/* Counts a claim; if it does not hold, counts and prints a failure with this text. */
__attribute__((format(printf, 3, 4))) void quality_expect(struct quality *q, bool holds,
                                                          const char *format, ...);

/* Renders an image. On failure, prints the renderer's error and exits. The caller owns the image.
 */
struct test_image quality_render(const struct quality *q, struct sp_volume *volume,
                                 const struct sp_view *view);
struct sp_volume *quality_volume(const struct test_scene *scene);

/* Returns the integral of the scene with its view, convolved with the view's low-pass filter. The
 * integral takes longer than an image, so the targets share it: all targets must request the same
 * integrals in the same order. Exits if they do not, or when out of memory. */
const struct test_image *quality_integrate(struct quality *q, const struct test_scene *scene,
                                           const struct test_truth_options *options);

/* Loads a built-in volume ("demo:…") or a file of the data folder. Returns NULL if the file does
 * not exist; exits if loading fails. */
struct sp_volume *quality_load(const char *source);

/* Turns the camera of a default view about its target, to the n-th of several positions. n = 0
 * keeps the default. */
void quality_turn(struct sp_view *view, int n);

/* Sorts the values. Returns their median; of an even number, the upper one. */
double quality_median(double *values, size_t count);

/* Evicts the volume from the renderer's caches and releases the reference. */
void quality_evict(const struct quality *q, struct sp_volume **volume);

/* Returns the name of the filter in the protocol: "ewa", "swan", … */
const char *quality_filter_name(enum sp_filter_mode mode);

#endif
