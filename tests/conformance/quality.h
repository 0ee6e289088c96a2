/* SPDX-License-Identifier: Apache-2.0
 *
 * What the proofs of quality share. Each is a program of its own that prints its tables of numbers
 * and compares them with what is claimed, on every backend and instruction set by turns.
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
    } truths[QUALITY_TRUTHS]; /* in the order in which the first target asked for them */
    unsigned truth_count, truth_next;
};

/* Runs `measure` on every target that starts here; the exit status of main(). */
int quality_main(void (*measure)(struct quality *q));

/* Counts a claim, and prints the text as a failure when it does not hold. */
__attribute__((format(printf, 3, 4))) void quality_expect(struct quality *q, bool holds,
                                                          const char *format, ...);

/* Renders, and ends the program with the renderer's error where that fails. */
struct test_image quality_render(const struct quality *q, struct sp_volume *volume,
                                 const struct sp_view *view);
struct sp_volume *quality_volume(const struct test_scene *scene);

/* The integral of the scene as its view has it, convolved with the view's low-pass filter. It takes
 * longer than an image, and targets share it: all ask for the same ones in the same order. Ends
 * the program where they do not, and when out of memory. */
const struct test_image *quality_integrate(struct quality *q, const struct test_scene *scene,
                                           const struct test_truth_options *options);

/* A built-in volume ("demo:…") or a real one of the folder of data; NULL when that is absent. Ends
 * the program where loading fails. */
struct sp_volume *quality_load(const char *source);

/* Turns the default view's camera about its target: n = 0, 1, … */
void quality_turn(struct sp_view *view, int n);

/* Sorts what was found; its median. */
double quality_median(double *found, size_t count);

/* Drops what was derived from the volume, and the reference. */
void quality_forget(const struct quality *q, struct sp_volume **volume);

/* "ewa", "swan", …: as in the protocol. */
const char *quality_filter_name(enum sp_filter_mode mode);

#endif
