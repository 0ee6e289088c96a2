/* SPDX-License-Identifier: Apache-2.0
 *
 * How long the GPU takes for each stage: a stamp after each, read when the frame is back, so that
 * nothing waits for them.
 */
#ifndef GL_TIMER_H
#define GL_TIMER_H

#include <stdbool.h>
#include <stdint.h>

enum { GL_STAMPS = 512 };

struct gl_timer {
    unsigned queries[GL_STAMPS];
    uint8_t stage[GL_STAMPS]; /* that ended with the stamp; 255: none */
    unsigned count;
    bool is_over; /* stamps were left out: the last one's part is many */
};

/* Contexts must be current. */
void gl_timer_init(struct gl_timer *timer);
void gl_timer_finish(struct gl_timer *timer);

/* Begins anew: the first stage starts here. */
void gl_timer_start(struct gl_timer *timer);

/* What was asked of the GPU since the last stamp was this stage. Stamps that there is no room for
 * are left out: the next one that is taken counts for all since. */
void gl_timer_stamp(struct gl_timer *timer, unsigned stage);

/* Adds the times to ms[stage], and raises longest[stage] to that of the longest of its parts, from
 * stamp to stamp. The GPU must be done with what was stamped. */
void gl_timer_read(const struct gl_timer *timer, double *ms, double *longest);

#endif
