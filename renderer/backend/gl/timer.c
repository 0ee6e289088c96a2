/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/timer.h"

#include <epoxy/gl.h>

enum { NO_STAGE = 255 };

void gl_timer_init(struct gl_timer *timer) {
    *timer = (struct gl_timer){ 0 };
    glGenQueries(GL_STAMPS, timer->queries);
}

void gl_timer_finish(struct gl_timer *timer) {
    glDeleteQueries(GL_STAMPS, timer->queries);
}

void gl_timer_start(struct gl_timer *timer) {
    timer->count = 0;
    timer->is_over = false;
    gl_timer_stamp(timer, NO_STAGE);
}

void gl_timer_stamp(struct gl_timer *timer, unsigned stage) {
    timer->is_over = timer->count == GL_STAMPS;
    timer->count -= timer->is_over; /* all stamps are used: move the last one */
    timer->stage[timer->count] = (uint8_t)stage;
    glQueryCounter(timer->queries[timer->count++], GL_TIMESTAMP);
}

void gl_timer_read(const struct gl_timer *timer, double *ms, double *longest) {
    GLuint64 before = 0, now = 0;
    for (unsigned i = 0; i < timer->count; i++, before = now) {
        glGetQueryObjectui64v(timer->queries[i], GL_QUERY_RESULT, &now);
        unsigned stage = timer->stage[i];
        if (stage == NO_STAGE || now <= before)
            continue;
        double part = (double)(now - before) * 1e-6;
        ms[stage] += part;
        if (part > longest[stage] && !(timer->is_over && i + 1 == timer->count))
            longest[stage] = part;
    }
}
