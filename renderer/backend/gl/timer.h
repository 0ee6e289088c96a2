/* SPDX-License-Identifier: Apache-2.0
 *
 * Measures the GPU time of each stage, with a time stamp after each stage. The stamps are read
 * after the image was read back, so that no thread waits for them.
 */
#ifndef GL_TIMER_H
#define GL_TIMER_H

#include <stdbool.h>
#include <stdint.h>

enum { GL_STAMPS = 512 };

struct gl_timer {
    unsigned queries[GL_STAMPS];
    uint8_t stage[GL_STAMPS]; /* the stage that the stamp ends; 255 = none */
    unsigned count;
    bool is_over; /* stamps were dropped: the last interval covers several dispatches */
};

/* Contexts must be current. */
void gl_timer_init(struct gl_timer *timer);
void gl_timer_finish(struct gl_timer *timer);

/* Drops all stamps. The first stage begins now. */
void gl_timer_start(struct gl_timer *timer);

/* Attributes the commands since the last stamp to this stage. When all GL_STAMPS are used, a new
 * stamp replaces the last one and covers both intervals. */
void gl_timer_stamp(struct gl_timer *timer, unsigned stage);

/* Adds the times to ms[stage] and raises longest[stage] to the longest interval between two stamps.
 * The GPU must have finished the stamped commands. */
void gl_timer_read(const struct gl_timer *timer, double *ms, double *longest);

#endif
